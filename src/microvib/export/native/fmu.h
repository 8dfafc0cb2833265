/* What FMUs of both versions of FMI share: an instance, its inputs, and which variable is which. */

#ifndef MICROVIB_FMU_H
#define MICROVIB_FMU_H

#include <stdlib.h>
#include <string.h>

#include "microvib.h"

/* Value references (microvib.export.native.variables has the same): outputs by their number from 0 on,
   inputs, the interface's accelerations by their component from ACCELERATIONS on, and parameters by their
   number from PARAMETERS on. */
enum { HUB_ACCELERATION = 10000, ARRAY_RATE, MICROSTEPS, COMMAND, TIME, INDEPENDENT, SHAFT_TORQUE, ACCELERATIONS = 10010, PARAMETERS = 20000 };

/* Who commands: the profile of the scenario, the input array_rate, or the input microstep_command. */
enum { BY_PROFILE, BY_RATE, BY_NUMBER };

/* What a host sets, beside parameters, and what is saved with the state. */
struct inputs {
    double hub_acceleration, accelerations[6], shaft_torque, array_rate, start; /* start: the host's time at which the drive's is 0 */
    int64_t microsteps, command, independent;
};

struct fmu {
    microvib *drive;
    void *memory;
    struct inputs inputs;
    int initialized;
};

/* A drive at rest; 0, or the sentence on what went wrong in `why`. */
static inline int fmu_open(struct fmu *f, char *why, size_t room)
{
    size_t bytes = microvib_memory(NULL, 0);
    memset(&f->inputs, 0, sizeof f->inputs);
    f->initialized = 0;
    if (!f->memory)
        f->memory = bytes ? malloc(bytes) : NULL;
    f->drive = f->memory ? microvib_open(NULL, 0, f->memory, why, room) : NULL;
    return f->drive ? 0 : 1;
}

static inline int fmu_get_real(struct fmu *f, unsigned which, double *value)
{
    size_t outputs = microvib_outputs(f->drive), parameters = microvib_parameters(f->drive);
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
        return 1;
    return 0;
}

/* Commands act from the next step on; acceleration and torque are in T_d at once. */
static inline int fmu_set_real(struct fmu *f, unsigned which, double value)
{
    if (which == HUB_ACCELERATION) {
        f->inputs.hub_acceleration = value;
        return microvib_set_hub_acceleration(f->drive, value);
    }
    if (which == SHAFT_TORQUE) {
        f->inputs.shaft_torque = value;
        return microvib_set_shaft_torque(f->drive, value);
    }
    if (which >= ACCELERATIONS && which < ACCELERATIONS + 6) {
        f->inputs.accelerations[which - ACCELERATIONS] = value;
        return microvib_set_interface_acceleration(f->drive, (int)(which - ACCELERATIONS), value);
    }
    if (which == ARRAY_RATE) {
        f->inputs.array_rate = value;
        return 0;
    }
    if (which >= PARAMETERS && !f->initialized)
        return microvib_set_parameter(f->drive, which - PARAMETERS, value);
    return 1;
}

static inline int fmu_get_integer(const struct fmu *f, unsigned which, int64_t *value)
{
    if (which == MICROSTEPS)
        *value = f->inputs.microsteps;
    else if (which == COMMAND)
        *value = f->inputs.command;
    else if (which == INDEPENDENT)
        *value = f->inputs.independent;
    else
        return 1;
    return 0;
}

static inline int fmu_set_integer(struct fmu *f, unsigned which, int64_t value)
{
    if (which == MICROSTEPS)
        f->inputs.microsteps = value;
    else if (which == COMMAND && !f->initialized && value >= BY_PROFILE && value <= BY_NUMBER)
        f->inputs.command = value;
    else if (which == INDEPENDENT && !f->initialized && (value == 0 || value == 1)) {
        f->inputs.independent = value;
        return microvib_set_independent(f->drive, (int)value);
    } else
        return 1;
    return 0;
}

static inline int fmu_do_step(struct fmu *f, double stop)
{
    int failed = 0;
    if (f->inputs.command == BY_RATE)
        failed = microvib_set_rate(f->drive, f->inputs.array_rate);
    if (f->inputs.command == BY_NUMBER)
        failed = microvib_set_microsteps(f->drive, f->inputs.microsteps);
    return failed || microvib_do_step(f->drive, stop - f->inputs.start);
}

/* Saved states: the inputs, then what time changes. */
static inline size_t fmu_state_bytes(const struct fmu *f)
{
    return sizeof f->inputs + microvib_state_bytes(f->drive);
}

static inline void fmu_save(const struct fmu *f, void *state)
{
    memcpy(state, &f->inputs, sizeof f->inputs);
    microvib_get_state(f->drive, (char *)state + sizeof f->inputs);
}

static inline int fmu_restore(struct fmu *f, const void *state)
{
    memcpy(&f->inputs, state, sizeof f->inputs);
    return microvib_set_state(f->drive, (const char *)state + sizeof f->inputs);
}

#endif
