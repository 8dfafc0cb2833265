/* FMI 2.0 for co-simulation, about microvib.h. Types and constants are those of the standard's headers,
   of which these are all that is needed. */

#include "fmu.h"

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

struct component {
    struct fmu fmu;
    const fmi2CallbackFunctions *callbacks;
    char *name;
};

static void tell(const fmi2CallbackFunctions *to, const char *name, const char *sentence)
{
    if (to && to->logger)
        to->logger(to->componentEnvironment, name, fmi2Error, "logStatusError", "%s", sentence);
}

static fmi2Status failed(struct component *c, const char *sentence)
{
    tell(c->callbacks, c->name, sentence);
    return fmi2Error;
}

/* The status of a function of fmu.h. */
static fmi2Status status(struct component *c, int wrong)
{
    return wrong ? failed(c, fmu_error(&c->fmu)) : fmi2OK;
}

static fmi2Status unknown(struct component *c)
{
    return status(c, fmu_refuse_variable(&c->fmu));
}

EXPORT const char *fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORT const char *fmi2GetVersion(void)
{
    return "2.0";
}

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    char why[256] = "there is no memory for a drive";
    struct component *c;
    (void)resources, (void)visible, (void)logging;
    name = name ? name : "";
    if (type != fmi2CoSimulation || !guid || strcmp(guid, MICROVIB_GUID) != 0) {
        tell(callbacks, name, "this FMU is for co-simulation, and its binary is of one modelDescription.xml: type and guid must be its own");
        return NULL;
    }
    c = calloc(1, sizeof *c);
    if (c && (c->name = malloc(strlen(name) + 1)) && !fmu_open(&c->fmu, why, sizeof why)) {
        strcpy(c->name, name);
        c->callbacks = callbacks;
        return c;
    }
    tell(callbacks, name, why);
    if (c) {
        free(c->name);
        fmu_close(&c->fmu);
        free(c);
    }
    return NULL;
}

EXPORT void fmi2FreeInstance(fmi2Component component)
{
    struct component *c = component;
    if (!c)
        return;
    fmu_close(&c->fmu);
    free(c->name);
    free(c);
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop)
{
    struct component *c = component;
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return status(c, fmu_set_start(&c->fmu, start));
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    struct component *c = component;
    return status(c, fmu_begin_initialization(&c->fmu));
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    struct component *c = component;
    return status(c, fmu_end_initialization(&c->fmu));
}

EXPORT fmi2Status fmi2Terminate(fmi2Component component)
{
    struct component *c = component;
    return status(c, fmu_terminate(&c->fmu));
}

EXPORT fmi2Status fmi2Reset(fmi2Component component)
{
    struct component *c = component;
    char why[256] = "";
    return fmu_open(&c->fmu, why, sizeof why) ? failed(c, why) : fmi2OK;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    struct component *c = component;
    for (size_t k = 0; k < n; k++)
        if (fmu_get_real(&c->fmu, vr[k], &value[k]))
            return status(c, 1);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    struct component *c = component;
    for (size_t k = 0; k < n; k++)
        if (fmu_set_real(&c->fmu, vr[k], value[k]))
            return status(c, 1);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    struct component *c = component;
    for (size_t k = 0; k < n; k++) {
        int64_t found;
        if (fmu_get_integer(&c->fmu, vr[k], &found))
            return status(c, 1);
        value[k] = (fmi2Integer)found;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    struct component *c = component;
    for (size_t k = 0; k < n; k++)
        if (fmu_set_integer(&c->fmu, vr[k], value[k]))
            return status(c, 1);
    return fmi2OK;
}

/* There are no variables of these types. */

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    (void)vr, (void)value;
    return n ? unknown(c) : fmi2OK;
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    (void)vr, (void)value;
    return n ? unknown(c) : fmi2OK;
}

EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)vr, (void)value;
    return n ? unknown(c) : fmi2OK;
}

EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)vr, (void)value;
    return n ? unknown(c) : fmi2OK;
}

/* ---- States ---- */

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    struct component *c = component;
    return status(c, fmu_get_state(&c->fmu, state));
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    struct component *c = component;
    return status(c, fmu_set_state(&c->fmu, state));
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    fmu_free_state(state);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    (void)c;
    *size = fmu_bytes_of(state);
    return *size ? fmi2OK : fmi2Error;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte content[], size_t size)
{
    struct component *c = component;
    return status(c, fmu_to_bytes(&c->fmu, state, content, size));
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte content[], size_t size, fmi2FMUstate *state)
{
    struct component *c = component;
    return status(c, fmu_from_bytes(&c->fmu, content, size, state));
}

/* ---- Steps ---- */

EXPORT fmi2Status fmi2DoStep(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean no_return)
{
    struct component *c = component;
    (void)no_return;
    return status(c, fmu_do_step(&c->fmu, now, step));
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c)
{
    (void)c;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    struct component *c = component;
    if (kind != fmi2LastSuccessfulTime)
        return fmi2Discard;
    return fmu_get_real(&c->fmu, TIME, value) ? fmi2Error : fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

/* ---- Not offered (modelDescription.xml says so) ---- */

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t n, const fmi2ValueReference k[],
                                               size_t m, const fmi2Real du[], fmi2Real dv[])
{
    (void)u, (void)n, (void)k, (void)m, (void)du, (void)dv;
    return failed(c, "directional derivatives are not offered");
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                              const fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return failed(c, "derivatives of inputs are not taken");
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                               fmi2Real value[])
{
    (void)vr, (void)n, (void)order, (void)value;
    return failed(c, "derivatives of outputs are not offered");
}
