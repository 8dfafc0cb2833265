/* Lines alone: sums of cosines behind the same functions as a drive's (microvib.h), of which an FMU asks
   no more than these. The table is 64-bit words: magic, version, words, outputs, tones; then of each tone
   its output, frequency [Hz], amplitude, and phase at time 0 [rad]. */

#include "microvib.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

extern const uint64_t microvib_image[] __attribute__((visibility("hidden")));

#define MAGIC UINT64_C(0x0053454e4f54564d) /* "MVTONES" */
enum { H_MAGIC, H_VERSION, H_WORDS, H_OUTPUTS, H_TONES, HEADER = 8, TONE_WORDS = 4 };

struct microvib {
    double time, before; /* of the last communication points [s] */
    char why[160];
};

size_t microvib_memory(const void *image, size_t bytes)
{
    (void)image, (void)bytes;
    return sizeof(microvib);
}

microvib *microvib_open(const void *image, size_t bytes, void *memory, char *why, size_t room)
{
    (void)image, (void)bytes;
    if (microvib_image[H_MAGIC] != MAGIC || microvib_image[H_VERSION] != 1) {
        if (room)
            snprintf(why, room, "the table of lines is none of microvib's, or of another version than 1");
        return NULL;
    }
    return memset(memory, 0, sizeof(microvib));
}

const char *microvib_error(const microvib *m)
{
    return m->why;
}

static int fails(microvib *m, const char *text)
{
    snprintf(m->why, sizeof m->why, "%s", text);
    return 1;
}

size_t microvib_outputs(const microvib *m)
{
    (void)m;
    return 2 * (size_t)microvib_image[H_OUTPUTS];
}

/* Values first, then their means over the last step, in the same order. */
double microvib_output(microvib *m, size_t which)
{
    size_t outputs = (size_t)microvib_image[H_OUTPUTS], channel = which % outputs;
    double total = 0.0, step = m->time - m->before;
    for (uint64_t k = 0; k < microvib_image[H_TONES]; k++) {
        double tone[TONE_WORDS];
        memcpy(tone, microvib_image + HEADER + TONE_WORDS * k, sizeof tone);
        double w = 6.283185307179586 * tone[1];
        if (tone[0] != (double)channel)
            continue;
        if (which < outputs || step == 0.0)
            total += tone[2] * cos(w * m->time + tone[3]);
        else
            total += tone[2] * (sin(w * m->time + tone[3]) - sin(w * m->before + tone[3])) / (w * step);
    }
    return total;
}

double microvib_time(const microvib *m)
{
    return m->time;
}

int microvib_do_step(microvib *m, double stop)
{
    m->why[0] = 0;
    if (!isfinite(stop) || stop < m->time)
        return fails(m, "a step must end after it begins");
    m->before = m->time;
    m->time = stop;
    return 0;
}

size_t microvib_state_bytes(const microvib *m)
{
    (void)m;
    return 2 * sizeof(double);
}

void microvib_get_state(const microvib *m, void *state)
{
    memcpy(state, &m->time, 2 * sizeof(double));
}

int microvib_set_state(microvib *m, const void *state)
{
    memcpy(&m->time, state, 2 * sizeof(double));
    return 0;
}

/* ---- There are neither parameters nor inputs ---- */

size_t microvib_parameters(const microvib *m)
{
    (void)m;
    return 0;
}

double microvib_parameter(const microvib *m, size_t which)
{
    (void)m, (void)which;
    return NAN;
}

int microvib_set_parameter(microvib *m, size_t which, double value)
{
    (void)which, (void)value;
    return fails(m, "there is no such parameter");
}

int microvib_set_hub_acceleration(microvib *m, double acceleration)
{
    (void)acceleration;
    return fails(m, "lines take no input");
}

int microvib_set_interface_acceleration(microvib *m, int component, double acceleration)
{
    (void)component, (void)acceleration;
    return fails(m, "lines take no input");
}

int microvib_set_shaft_torque(microvib *m, double torque)
{
    (void)torque;
    return fails(m, "lines take no input");
}

int microvib_set_independent(microvib *m, int on)
{
    (void)on;
    return fails(m, "lines have no steps");
}

int microvib_set_rate(microvib *m, double rate)
{
    (void)rate;
    return fails(m, "lines take no input");
}

int microvib_set_microsteps(microvib *m, int64_t count)
{
    (void)count;
    return fails(m, "lines take no input");
}
