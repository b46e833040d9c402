/* The functions of FMI 2.0, as its standard declares them. All variables are of the type Real. */
#include <stdlib.h>
#include <string.h>

#include "instance.h"

typedef int status;
typedef int boolean;
typedef const char *string;
typedef void (*log_callback)(void *environment, string name, status, string category, string message, ...);

/* What a tool gives at instantiation; memory is taken from the C library. */
typedef struct {
    log_callback log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, status);
    void *environment;
} callbacks;

static void log_message(const instance *i, int level, const char *message)
{
    if (i->logger != NULL) {
        log_callback call;
        memcpy(&call, &i->logger, sizeof call);
        call(i->environment, i->name != NULL ? i->name : "", level, "logStatusError", message); /* no text of ours has a % */
    }
}

EXPORTED string fmi2GetTypesPlatform(void)
{
    return "default";
}

EXPORTED string fmi2GetVersion(void)
{
    return "2.0";
}

EXPORTED status fmi2SetDebugLogging(instance *i, boolean on, size_t count, const string categories[])
{
    (void)i, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORTED instance *fmi2Instantiate(string name, int type, string token, string resources, const callbacks *functions,
    boolean visible, boolean logging)
{
    void *logger = NULL;
    (void)resources, (void)visible, (void)logging;
    if (type != MODEL_SAMPLED) {
        return NULL; /* 0: model exchange, 1: co-simulation */
    }
    if (functions == NULL) {
        return instance_new(name, token, NULL, NULL, log_message);
    }
    memcpy(&logger, &functions->log, sizeof logger);
    return instance_new(name, token, functions->environment, logger, log_message);
}

EXPORTED void fmi2FreeInstance(instance *i)
{
    instance_free(i);
}

EXPORTED status fmi2SetupExperiment(instance *i, boolean tolerance_defined, double tolerance, double start,
    boolean stop_defined, double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    i->now.start = start;
    return OK;
}

EXPORTED status fmi2EnterInitializationMode(instance *i)
{
    return instance_setup(i, i->now.start);
}

EXPORTED status fmi2ExitInitializationMode(instance *i)
{
    return instance_begin(i);
}

EXPORTED status fmi2Terminate(instance *i)
{
    i->now.mode = ENDED;
    return OK;
}

EXPORTED status fmi2Reset(instance *i)
{
    return instance_reset(i);
}

EXPORTED status fmi2GetReal(instance *i, const uint32_t references[], size_t count, double values[])
{
    return instance_get(i, references, count, values, count);
}

EXPORTED status fmi2SetReal(instance *i, const uint32_t references[], size_t count, const double values[])
{
    return instance_set(i, references, count, values, count);
}

/* No variable has one of these types. */
#define WITHOUT(name, type)                                                                                            \
    EXPORTED status fmi2Get##name(instance *i, const uint32_t references[], size_t count, type values[])               \
    {                                                                                                                  \
        (void)references, (void)values;                                                                                \
        return count == 0u ? OK : instance_fail(i, "no variable has that type");                                       \
    }                                                                                                                  \
    EXPORTED status fmi2Set##name(instance *i, const uint32_t references[], size_t count, const type values[])         \
    {                                                                                                                  \
        (void)references, (void)values;                                                                                \
        return count == 0u ? OK : instance_fail(i, "no variable has that type");                                       \
    }
WITHOUT(Integer, int)
WITHOUT(Boolean, boolean)
WITHOUT(String, string)

EXPORTED status fmi2GetFMUstate(instance *i, void **state)
{
    return instance_save(i, state);
}

EXPORTED status fmi2SetFMUstate(instance *i, void *state)
{
    return instance_restore(i, state);
}

EXPORTED status fmi2FreeFMUstate(instance *i, void **state)
{
    (void)i;
    free(*state);
    *state = NULL;
    return OK;
}

EXPORTED status fmi2SerializedFMUstateSize(instance *i, void *state, size_t *size)
{
    (void)i, (void)state;
    *size = instance_serialised_size();
    return OK;
}

EXPORTED status fmi2SerializeFMUstate(instance *i, void *state, char serialised[], size_t size)
{
    return instance_serialise(i, state, (uint8_t *)serialised, size);
}

EXPORTED status fmi2DeSerializeFMUstate(instance *i, const char serialised[], size_t size, void **state)
{
    return instance_deserialise(i, (const uint8_t *)serialised, size, state);
}

EXPORTED status fmi2GetDirectionalDerivative(instance *i, const uint32_t unknowns[], size_t unknown_count,
    const uint32_t knowns[], size_t known_count, const double seed[], double sensitivity[])
{
    return instance_directional(i, unknowns, unknown_count, knowns, known_count, seed, sensitivity);
}

#define NOT_OFFERED(name, parameters)                                                                                  \
    EXPORTED status name parameters                                                                                    \
    {                                                                                                                  \
        return instance_fail(i, #name " is not offered");                                                              \
    }

EXPORTED status fmi2DoStep(instance *i, double time, double step, boolean no_return)
{
    (void)no_return;
    return instance_step(i, time, step);
}

EXPORTED status fmi2CancelStep(instance *i)
{
    return instance_fail(i, "no step is under way");
}

NOT_OFFERED(fmi2SetRealInputDerivatives, (instance *i, const uint32_t references[], size_t count, const int orders[],
    const double values[]))
NOT_OFFERED(fmi2GetRealOutputDerivatives, (instance *i, const uint32_t references[], size_t count, const int orders[],
    double values[]))

EXPORTED status fmi2GetRealStatus(instance *i, int kind, double *value)
{
    (void)kind;
    *value = i->now.time; /* the last successful time */
    return OK;
}

EXPORTED status fmi2GetBooleanStatus(instance *i, int kind, boolean *value)
{
    (void)i, (void)kind;
    *value = 0; /* not terminated */
    return OK;
}

NOT_OFFERED(fmi2GetStatus, (instance *i, int kind, status *value))
NOT_OFFERED(fmi2GetIntegerStatus, (instance *i, int kind, int *value))
NOT_OFFERED(fmi2GetStringStatus, (instance *i, int kind, string *value))

/* What fmi2NewDiscreteStates tells. */
typedef struct {
    boolean again, terminate, nominals, values, next_defined;
    double next;
} event_info;

EXPORTED status fmi2EnterEventMode(instance *i)
{
    (void)i;
    return OK;
}

EXPORTED status fmi2NewDiscreteStates(instance *i, event_info *info)
{
    memset(info, 0, sizeof *info);
    return instance_event(i);
}

EXPORTED status fmi2EnterContinuousTimeMode(instance *i)
{
    (void)i;
    return OK;
}

EXPORTED status fmi2CompletedIntegratorStep(instance *i, boolean no_return, boolean *event, boolean *terminate)
{
    (void)i, (void)no_return;
    *event = *terminate = 0;
    return OK;
}

EXPORTED status fmi2SetTime(instance *i, double time)
{
    return instance_set_time(i, time);
}

EXPORTED status fmi2SetContinuousStates(instance *i, const double x[], size_t count)
{
    return instance_set_states(i, x, count);
}

EXPORTED status fmi2GetDerivatives(instance *i, double xd[], size_t count)
{
    return instance_derivatives(i, xd, count);
}

EXPORTED status fmi2GetEventIndicators(instance *i, double z[], size_t count)
{
    return instance_indicators(i, z, count);
}

EXPORTED status fmi2GetContinuousStates(instance *i, double x[], size_t count)
{
    return instance_states(i, x, count);
}

EXPORTED status fmi2GetNominalsOfContinuousStates(instance *i, double nominals[], size_t count)
{
    size_t k;
    (void)i;
    for (k = 0; k < count; k++) {
        nominals[k] = 1.0;
    }
    return OK;
}
