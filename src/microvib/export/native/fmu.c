/* What FMUs of both versions of FMI share (fmu.h). */

#include "fmu.h"

#include <stdio.h>

static int refuse(struct fmu *f, const char *sentence)
{
    snprintf(f->why, sizeof f->why, "%s", sentence);
    return 1;
}

const char *fmu_error(const struct fmu *f)
{
    return *f->why ? f->why : microvib_error(f->drive);
}

int fmu_open(struct fmu *f, char *why, size_t room)
{
    size_t bytes = microvib_memory(NULL, 0);
    memset(&f->inputs, 0, sizeof f->inputs);
    f->why[0] = 0;
    if (!f->memory)
        f->memory = bytes ? malloc(bytes) : NULL;
    f->drive = f->memory ? microvib_open(NULL, 0, f->memory, why, room) : NULL;
    return f->drive ? 0 : 1;
}

void fmu_close(struct fmu *f)
{
    free(f->memory);
}

/* ---- Phases ---- */

int fmu_set_start(struct fmu *f, double start)
{
    f->why[0] = 0;
    if (!isfinite(start))
        return refuse(f, "the start time is not a finite number");
    f->inputs.start = start;
    return 0;
}

static int go_on(struct fmu *f, int64_t from, int64_t to, const char *sentence)
{
    f->why[0] = 0;
    if (f->inputs.phase != from)
        return refuse(f, sentence);
    f->inputs.phase = to;
    return 0;
}

int fmu_begin_initialization(struct fmu *f)
{
    return go_on(f, INSTANTIATED, INITIALIZING, "initialization has begun already; reset the FMU first");
}

int fmu_end_initialization(struct fmu *f)
{
    return go_on(f, INITIALIZING, STEPPING, "initialization has not begun, or has ended already");
}

int fmu_terminate(struct fmu *f)
{
    return go_on(f, STEPPING, TERMINATED, "the simulation has not begun, or has ended already");
}

/* ---- Variables ---- */

int fmu_refuse_variable(struct fmu *f)
{
    return refuse(f, "a variable has no such value reference or type, or cannot be set now, or not to this value");
}

int fmu_get_real(struct fmu *f, unsigned which, double *value)
{
    size_t outputs = microvib_outputs(f->drive), parameters = microvib_parameters(f->drive);
    f->why[0] = 0;
    if (which < outputs)
        *value = microvib_output(f->drive, which);
    else if (which == HUB_ACCELERATION)
        *value = f->inputs.hub_acceleration;
    else if (which == SHAFT_TORQUE)
        *value = f->inputs.shaft_torque;
    else if (which >= ACCELERATIONS && which < ACCELERATIONS + 6)
        *value = f->inputs.accelerations[which - ACCELERATIONS];
    else if (which == ARRAY_RATE)
        *value = f->inputs.array_rate;
    else if (which == TIME)
        *value = microvib_time(f->drive) + f->inputs.start;
    else if (which >= PARAMETERS && which - PARAMETERS < parameters)
        *value = microvib_parameter(f->drive, which - PARAMETERS);
    else
        return fmu_refuse_variable(f);
    return 0;
}

/* Keep an input that the drive has taken. */
static int kept(int failed, double *input, double value)
{
    if (!failed)
        *input = value;
    return failed;
}

/* Commands act from the next step on; acceleration and torque are in T_d at once. */
int fmu_set_real(struct fmu *f, unsigned which, double value)
{
    f->why[0] = 0;
    if (f->inputs.phase == TERMINATED)
        return fmu_refuse_variable(f);
    if (which == HUB_ACCELERATION)
        return kept(microvib_set_hub_acceleration(f->drive, value), &f->inputs.hub_acceleration, value);
    if (which == SHAFT_TORQUE)
        return kept(microvib_set_shaft_torque(f->drive, value), &f->inputs.shaft_torque, value);
    if (which >= ACCELERATIONS && which < ACCELERATIONS + 6) {
        int component = (int)(which - ACCELERATIONS);
        return kept(microvib_set_interface_acceleration(f->drive, component, value), &f->inputs.accelerations[component], value);
    }
    if (which == ARRAY_RATE)
        return kept(0, &f->inputs.array_rate, value);
    if (which >= PARAMETERS && f->inputs.phase < STEPPING)
        return microvib_set_parameter(f->drive, which - PARAMETERS, value);
    return fmu_refuse_variable(f);
}

int fmu_get_integer(struct fmu *f, unsigned which, int64_t *value)
{
    f->why[0] = 0;
    if (which == MICROSTEPS)
        *value = f->inputs.microsteps;
    else if (which == COMMAND)
        *value = f->inputs.command;
    else if (which == INDEPENDENT)
        *value = f->inputs.independent;
    else
        return fmu_refuse_variable(f);
    return 0;
}

int fmu_set_integer(struct fmu *f, unsigned which, int64_t value)
{
    int before = f->inputs.phase < STEPPING;
    f->why[0] = 0;
    if (which == MICROSTEPS && f->inputs.phase != TERMINATED)
        f->inputs.microsteps = value;
    else if (which == COMMAND && before && value >= BY_PROFILE && value <= BY_NUMBER)
        f->inputs.command = value;
    else if (which == INDEPENDENT && before && (value == 0 || value == 1) && !microvib_set_independent(f->drive, (int)value))
        f->inputs.independent = value;
    else
        return fmu_refuse_variable(f);
    return 0;
}

/* ---- Steps ---- */

int fmu_do_step(struct fmu *f, double now, double step)
{
    double here = microvib_time(f->drive) + f->inputs.start;
    int failed = 0;
    f->why[0] = 0;
    if (f->inputs.phase != STEPPING)
        return refuse(f, "a step can be made between initialization and termination alone");
    if (!isfinite(now) || !isfinite(step))
        return refuse(f, "time and step must be finite numbers");
    if (fabs(now - here) > 1e-6 * fabs(step) + 1e-12 * fmax(1.0, fabs(here))) {
        snprintf(f->why, sizeof f->why, "the step begins at %.17g s, but the drive is at %.17g s", now, here);
        return 1;
    }
    if (f->inputs.command == BY_RATE)
        failed = microvib_set_rate(f->drive, f->inputs.array_rate);
    if (f->inputs.command == BY_NUMBER)
        failed = microvib_set_microsteps(f->drive, f->inputs.microsteps);
    return failed || microvib_do_step(f->drive, now + step - f->inputs.start);
}

/* ---- States: the inputs, then what the drive keeps ---- */

static size_t state_bytes(const struct fmu *f)
{
    return sizeof f->inputs + microvib_state_bytes(f->drive);
}

static int refuse_state(struct fmu *f)
{
    return refuse(f, "the state is none of this FMU's");
}

int fmu_get_state(struct fmu *f, void **state)
{
    size_t bytes = state_bytes(f);
    struct fmu_state *s = *state ? *state : malloc(sizeof *s + bytes);
    f->why[0] = 0;
    if (!s)
        return refuse(f, "there is no memory for a state");
    if (*state && s->bytes != bytes)
        return refuse_state(f);
    s->bytes = bytes;
    memcpy(s + 1, &f->inputs, sizeof f->inputs);
    microvib_get_state(f->drive, (char *)(s + 1) + sizeof f->inputs);
    *state = s;
    return 0;
}

int fmu_set_state(struct fmu *f, const void *state)
{
    const struct fmu_state *s = state;
    f->why[0] = 0;
    if (!s || s->bytes != state_bytes(f))
        return refuse_state(f);
    if (microvib_set_state(f->drive, (const char *)(s + 1) + sizeof f->inputs))
        return 1;
    memcpy(&f->inputs, s + 1, sizeof f->inputs);
    return 0;
}

void fmu_free_state(void **state)
{
    if (state) {
        free(*state);
        *state = NULL;
    }
}

size_t fmu_bytes_of(const void *state)
{
    const struct fmu_state *s = state;
    return s ? s->bytes : 0;
}

int fmu_to_bytes(struct fmu *f, const void *state, void *content, size_t size)
{
    const struct fmu_state *s = state;
    f->why[0] = 0;
    if (!s)
        return refuse_state(f);
    if (size < s->bytes)
        return refuse(f, "there is no room for the state");
    memcpy(content, s + 1, s->bytes);
    return 0;
}

int fmu_from_bytes(struct fmu *f, const void *content, size_t size, void **state)
{
    struct fmu_state *s;
    f->why[0] = 0;
    if (size != state_bytes(f))
        return refuse_state(f);
    s = malloc(sizeof *s + size);
    if (!s)
        return refuse(f, "there is no memory for a state");
    s->bytes = size;
    memcpy(s + 1, content, size);
    *state = s;
    return 0;
}
