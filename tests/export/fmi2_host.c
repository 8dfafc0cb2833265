/* An FMU of FMI 2 under a host that asks for what is wrong, too: instances, states, calls out of order.
   Compiled with the FMU's own sources; 0 where the motion after a restored state is the same. */

#include "fmi2.c"

#include <stdio.h>

static int refusals;

static void told(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String format, ...)
{
    (void)e, (void)name, (void)status, (void)category, (void)format;
    refusals++;
}

static double torque(fmi2Component c)
{
    unsigned first = 0;
    double value = 0.0;
    fmi2GetReal(c, &first, 1, &value);
    return value;
}

static void steps(fmi2Component c, int first, int stop)
{
    for (int k = first; k < stop; k++)
        fmi2DoStep(c, 5.0 + 0.01 * k, 0.01, 1);
}

int main(void)
{
    fmi2CallbackFunctions callbacks = {told, calloc, free, NULL, NULL};
    unsigned parameter = 20000, none = 99999;
    double value = 0.004, expected;
    size_t bytes;
    if (fmi2Instantiate("x", fmi2ModelExchange, MICROVIB_GUID, "", &callbacks, 0, 0) || fmi2Instantiate("x", fmi2CoSimulation, "", "", NULL, 0, 0))
        return 1;
    fmi2Component c = fmi2Instantiate(NULL, fmi2CoSimulation, MICROVIB_GUID, "", &callbacks, 0, 0);
    fmi2FMUstate saved = NULL, read = NULL;
    fmi2SetFMUstate(c, NULL);
    fmi2SerializedFMUstateSize(c, NULL, &bytes);
    fmi2SetupExperiment(c, 0, 0, 5.0, 0, 0);
    fmi2EnterInitializationMode(c);
    if (fmi2SetReal(c, &parameter, 1, &value) != fmi2OK)
        return 2;
    fmi2ExitInitializationMode(c);
    steps(c, 0, 30);
    fmi2GetFMUstate(c, &saved);
    fmi2SerializedFMUstateSize(c, saved, &bytes);
    char *content = malloc(bytes + 1); /* read and written from an odd address on */
    fmi2SerializeFMUstate(c, saved, content + 1, bytes);
    fmi2SerializeFMUstate(c, saved, content + 1, bytes - 1);
    steps(c, 30, 60);
    expected = torque(c);
    fmi2Reset(c);
    fmi2DeSerializeFMUstate(c, content + 1, bytes - 1, &read);
    fmi2DeSerializeFMUstate(c, content + 1, bytes, &read);
    fmi2SetFMUstate(c, read);
    fmi2GetFMUstate(c, &read);
    steps(c, 30, 60);
    int same = torque(c) == expected && expected != 0.0;
    fmi2GetReal(c, &none, 1, &value);
    fmi2Terminate(c);
    steps(c, 60, 61);
    fmi2FreeFMUstate(c, &saved);
    fmi2FreeFMUstate(c, &read);
    fmi2FreeFMUstate(c, &read);
    free(content);
    fmi2FreeInstance(c);
    fmi2FreeInstance(NULL);
    return same && refusals == 6 ? 0 : 10 + refusals;
}
