/* What FMUs of both versions of FMI share: an instance, its inputs and states, and which variable is which. */

#ifndef MICROVIB_FMU_H
#define MICROVIB_FMU_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "microvib.h"

/* Value references (microvib.export.native.variables has the same): outputs by their number from 0 on,
   inputs, the interface's accelerations by their component from ACCELERATIONS on, and parameters by their
   number from PARAMETERS on. */
enum { HUB_ACCELERATION = 10000, ARRAY_RATE, MICROSTEPS, COMMAND, TIME, INDEPENDENT, SHAFT_TORQUE, ACCELERATIONS = 10010, PARAMETERS = 20000 };

/* Who commands: the profile of the scenario, the input array_rate, or the input microstep_command. */
enum { BY_PROFILE, BY_RATE, BY_NUMBER };

/* Where an instance is between its making and its end. */
enum { INSTANTIATED, INITIALIZING, STEPPING, TERMINATED };

/* What a host sets, beside parameters, and what is saved with the state. */
struct inputs {
    double hub_acceleration, accelerations[6], shaft_torque, array_rate, start; /* start: the host's time at which the drive's is 0 */
    int64_t microsteps, command, independent, phase;
};

struct fmu {
    microvib *drive;
    void *memory;
    struct inputs inputs;
    char why[160]; /* what went wrong outside of the drive; empty: the drive says it */
};

struct fmu_state {
    size_t bytes;
    /* what is saved follows */
};

#define HIDDEN __attribute__((visibility("hidden")))
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Functions that can fail give 1 or NULL; fmu_error has the sentence. */
HIDDEN const char *fmu_error(const struct fmu *f);

/* A drive at rest; again for one that is open. 1: the sentence is in `why`. */
HIDDEN int fmu_open(struct fmu *f, char *why, size_t room);
HIDDEN void fmu_close(struct fmu *f);

HIDDEN int fmu_set_start(struct fmu *f, double start);
HIDDEN int fmu_begin_initialization(struct fmu *f);
HIDDEN int fmu_end_initialization(struct fmu *f);
HIDDEN int fmu_terminate(struct fmu *f);

HIDDEN int fmu_get_real(struct fmu *f, unsigned which, double *value);
HIDDEN int fmu_set_real(struct fmu *f, unsigned which, double value);
HIDDEN int fmu_get_integer(struct fmu *f, unsigned which, int64_t *value);
HIDDEN int fmu_set_integer(struct fmu *f, unsigned which, int64_t value);
HIDDEN int fmu_refuse_variable(struct fmu *f);

/* A step of a length [s] from the host's time `now` on. */
HIDDEN int fmu_do_step(struct fmu *f, double now, double step);

/* States: `*state` is made where it is NULL. */
HIDDEN int fmu_get_state(struct fmu *f, void **state);
HIDDEN int fmu_set_state(struct fmu *f, const void *state);
HIDDEN void fmu_free_state(void **state);
HIDDEN size_t fmu_bytes_of(const void *state);
HIDDEN int fmu_to_bytes(struct fmu *f, const void *state, void *content, size_t size);
HIDDEN int fmu_from_bytes(struct fmu *f, const void *content, size_t size, void **state);

#endif
