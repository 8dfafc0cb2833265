/* FMI 3.0 for co-simulation, about microvib.h. Types and constants are those of the standard's headers,
   of which these are all that is needed. */

#include <stdbool.h>

#include "fmu.h"

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef const char *fmi3String;
typedef bool fmi3Boolean;
typedef uint8_t fmi3Byte;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);

struct instance {
    struct fmu fmu;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
};

static fmi3Status failed(struct instance *c, const char *sentence)
{
    if (c && c->log)
        c->log(c->environment, fmi3Error, "logStatusError", sentence);
    return fmi3Error;
}

/* The status of a function of fmu.h. */
static fmi3Status status(struct instance *c, int wrong)
{
    return wrong ? failed(c, fmu_error(&c->fmu)) : fmi3OK;
}

static fmi3Status unknown(struct instance *c)
{
    return status(c, fmu_refuse_variable(&c->fmu));
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                                const fmi3ValueReference intermediate[], size_t n,
                                                fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, void *update)
{
    char why[256] = "there is no memory for a drive";
    struct instance *c;
    (void)name, (void)resources, (void)visible, (void)logging, (void)early_return, (void)intermediate, (void)n, (void)update;
    if (!token || strcmp(token, MICROVIB_GUID) != 0 || event_mode) {
        if (log)
            log(environment, fmi3Error, "logStatusError",
                "the token must be that of this FMU's modelDescription.xml, and there is no event mode");
        return NULL;
    }
    c = calloc(1, sizeof *c);
    if (c && !fmu_open(&c->fmu, why, sizeof why)) {
        c->environment = environment;
        c->log = log;
        return c;
    }
    if (log)
        log(environment, fmi3Error, "logStatusError", why);
    if (c)
        fmu_close(&c->fmu);
    free(c);
    return NULL;
}

EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    struct instance *c = instance;
    if (c)
        fmu_close(&c->fmu);
    free(c);
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop)
{
    struct instance *c = instance;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return status(c, fmu_set_start(&c->fmu, start) || fmu_begin_initialization(&c->fmu));
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    struct instance *c = instance;
    return status(c, fmu_end_initialization(&c->fmu));
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance instance)
{
    struct instance *c = instance;
    return status(c, fmu_terminate(&c->fmu));
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    struct instance *c = instance;
    char why[256] = "";
    return fmu_open(&c->fmu, why, sizeof why) ? failed(c, why) : fmi3OK;
}

/* ---- Variables ---- */

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t m)
{
    struct instance *c = instance;
    if (n != m)
        return unknown(c);
    for (size_t k = 0; k < n; k++)
        if (fmu_get_real(&c->fmu, vr[k], &values[k]))
            return status(c, 1);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[], size_t m)
{
    struct instance *c = instance;
    if (n != m)
        return unknown(c);
    for (size_t k = 0; k < n; k++)
        if (fmu_set_real(&c->fmu, vr[k], values[k]))
            return status(c, 1);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetInt64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, int64_t values[], size_t m)
{
    struct instance *c = instance;
    if (n != m)
        return unknown(c);
    for (size_t k = 0; k < n; k++)
        if (fmu_get_integer(&c->fmu, vr[k], &values[k]))
            return status(c, 1);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetInt64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const int64_t values[], size_t m)
{
    struct instance *c = instance;
    if (n != m)
        return unknown(c);
    for (size_t k = 0; k < n; k++)
        if (fmu_set_integer(&c->fmu, vr[k], values[k]))
            return status(c, 1);
    return fmi3OK;
}

/* There are no variables of other types. */
#define NO_VARIABLES(name, type)                                                                                          \
    EXPORT fmi3Status fmi3Get##name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, type values[], size_t m)       \
    {                                                                                                                      \
        (void)vr, (void)values, (void)m;                                                                                   \
        return n ? unknown(c) : fmi3OK;                                                                                    \
    }                                                                                                                      \
    EXPORT fmi3Status fmi3Set##name(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const type values[], size_t m) \
    {                                                                                                                      \
        (void)vr, (void)values, (void)m;                                                                                   \
        return n ? unknown(c) : fmi3OK;                                                                                    \
    }

NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(Int32, int32_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, fmi3Boolean)
NO_VARIABLES(String, fmi3String)

EXPORT fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], const fmi3Byte *values[], size_t m)
{
    (void)vr, (void)sizes, (void)values, (void)m;
    return n ? unknown(c) : fmi3OK;
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                                const fmi3Byte *const values[], size_t m)
{
    (void)vr, (void)sizes, (void)values, (void)m;
    return n ? unknown(c) : fmi3OK;
}

EXPORT fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Boolean values[])
{
    (void)vr, (void)values;
    return n ? unknown(c) : fmi3OK;
}

EXPORT fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Boolean values[])
{
    (void)vr, (void)values;
    return n ? unknown(c) : fmi3OK;
}

/* ---- States ---- */

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    struct instance *c = instance;
    return status(c, fmu_get_state(&c->fmu, state));
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    struct instance *c = instance;
    return status(c, fmu_set_state(&c->fmu, state));
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    fmu_free_state(state);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    (void)c;
    *size = fmu_bytes_of(state);
    return *size ? fmi3OK : fmi3Error;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte content[], size_t size)
{
    struct instance *c = instance;
    return status(c, fmu_to_bytes(&c->fmu, state, content, size));
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte content[], size_t size, fmi3FMUState *state)
{
    struct instance *c = instance;
    return status(c, fmu_from_bytes(&c->fmu, content, size, state));
}

/* ---- Steps ---- */

EXPORT fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    (void)c;
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 now, fmi3Float64 step, fmi3Boolean no_return, fmi3Boolean *event,
                             fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last)
{
    struct instance *c = instance;
    int wrong = fmu_do_step(&c->fmu, now, step);
    (void)no_return;
    *event = *terminate = *early = false;
    *last = microvib_time(c->fmu.drive) + c->fmu.inputs.start;
    return status(c, wrong);
}

/* ---- Not offered (modelDescription.xml says so); the library has all names of the standard ---- */

#define NOT_OFFERED(name, arguments)                                          \
    EXPORT fmi3Status name arguments;                                         \
    EXPORT fmi3Status name arguments                                          \
    {                                                                         \
        return failed(c, #name " is not offered");                            \
    }

typedef const fmi3ValueReference references[];
typedef const fmi3Float64 numbers[];
#pragma GCC diagnostic ignored "-Wunused-parameter"

EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                 fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                                      fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                                      fmi3LogMessageCallback log, void *update, void *lock, void *unlock)
{
    return NULL;
}

NOT_OFFERED(fmi3EnterEventMode, (fmi3Instance c))
NOT_OFFERED(fmi3EnterConfigurationMode, (fmi3Instance c))
NOT_OFFERED(fmi3ExitConfigurationMode, (fmi3Instance c))
NOT_OFFERED(fmi3GetNumberOfVariableDependencies, (fmi3Instance c, fmi3ValueReference vr, size_t *n))
NOT_OFFERED(fmi3GetVariableDependencies, (fmi3Instance c, fmi3ValueReference vr, size_t of[], fmi3ValueReference by[], size_t at[], int kinds[], size_t n))
NOT_OFFERED(fmi3GetDirectionalDerivative, (fmi3Instance c, references u, size_t n, references k, size_t m, numbers seed, size_t s, fmi3Float64 out[], size_t o))
NOT_OFFERED(fmi3GetAdjointDerivative, (fmi3Instance c, references u, size_t n, references k, size_t m, numbers seed, size_t s, fmi3Float64 out[], size_t o))
NOT_OFFERED(fmi3GetOutputDerivatives, (fmi3Instance c, references vr, size_t n, const int32_t orders[], fmi3Float64 values[], size_t m))
NOT_OFFERED(fmi3GetIntervalDecimal, (fmi3Instance c, references vr, size_t n, fmi3Float64 intervals[], int qualifiers[]))
NOT_OFFERED(fmi3GetIntervalFraction, (fmi3Instance c, references vr, size_t n, uint64_t counters[], uint64_t resolutions[], int qualifiers[]))
NOT_OFFERED(fmi3GetShiftDecimal, (fmi3Instance c, references vr, size_t n, fmi3Float64 shifts[]))
NOT_OFFERED(fmi3GetShiftFraction, (fmi3Instance c, references vr, size_t n, uint64_t counters[], uint64_t resolutions[]))
NOT_OFFERED(fmi3SetIntervalDecimal, (fmi3Instance c, references vr, size_t n, numbers intervals))
NOT_OFFERED(fmi3SetIntervalFraction, (fmi3Instance c, references vr, size_t n, const uint64_t counters[], const uint64_t resolutions[]))
NOT_OFFERED(fmi3SetShiftDecimal, (fmi3Instance c, references vr, size_t n, numbers shifts))
NOT_OFFERED(fmi3SetShiftFraction, (fmi3Instance c, references vr, size_t n, const uint64_t counters[], const uint64_t resolutions[]))
NOT_OFFERED(fmi3EvaluateDiscreteStates, (fmi3Instance c))
NOT_OFFERED(fmi3UpdateDiscreteStates, (fmi3Instance c, fmi3Boolean *a, fmi3Boolean *b, fmi3Boolean *d, fmi3Boolean *e, fmi3Boolean *f, fmi3Float64 *t))
NOT_OFFERED(fmi3EnterContinuousTimeMode, (fmi3Instance c))
NOT_OFFERED(fmi3CompletedIntegratorStep, (fmi3Instance c, fmi3Boolean set, fmi3Boolean *event, fmi3Boolean *terminate))
NOT_OFFERED(fmi3SetTime, (fmi3Instance c, fmi3Float64 time))
NOT_OFFERED(fmi3SetContinuousStates, (fmi3Instance c, numbers states, size_t n))
NOT_OFFERED(fmi3GetContinuousStateDerivatives, (fmi3Instance c, fmi3Float64 derivatives[], size_t n))
NOT_OFFERED(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 indicators[], size_t n))
NOT_OFFERED(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 states[], size_t n))
NOT_OFFERED(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 nominals[], size_t n))
NOT_OFFERED(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *n))
NOT_OFFERED(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *n))
NOT_OFFERED(fmi3ActivateModelPartition, (fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time))
