/* The functions of FMI 3.0, as its standard declares them. All variables are of the type Float64. */
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "instance.h"

typedef int status;
typedef void (*log_callback)(void *environment, status, const char *category, const char *message);
typedef const void *callback;

static void log_message(const instance *i, int level, const char *message)
{
    if (i->logger != NULL) {
        log_callback call;
        memcpy(&call, &i->logger, sizeof call);
        call(i->environment, level, "logStatus", message);
    }
}

static instance *create(const char *name, const char *token, void *environment, log_callback call)
{
    void *logger = NULL;
    memcpy(&logger, &call, sizeof logger);
    return instance_new(name, token, environment, logger, log_message);
}

EXPORTED const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORTED status fmi3SetDebugLogging(instance *i, bool on, size_t count, const char *const categories[])
{
    (void)i, (void)on, (void)count, (void)categories;
    return OK;
}

EXPORTED instance *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
    bool logging, void *environment, log_callback call)
{
    (void)resources, (void)visible, (void)logging;
    return MODEL_SAMPLED ? NULL : create(name, token, environment, call);
}

EXPORTED instance *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
    bool logging, bool event_mode, bool early_return, const uint32_t required[], size_t count, void *environment,
    log_callback call, callback intermediate)
{
    (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return, (void)required, (void)count;
    (void)intermediate;
    return MODEL_SAMPLED ? create(name, token, environment, call) : NULL;
}

EXPORTED instance *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources,
    bool visible, bool logging, void *environment, log_callback call, callback update, callback lock, callback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)call, (void)update;
    (void)lock, (void)unlock;
    return NULL;
}

EXPORTED void fmi3FreeInstance(instance *i)
{
    instance_free(i);
}

EXPORTED status fmi3EnterInitializationMode(instance *i, bool tolerance_defined, double tolerance, double start,
    bool stop_defined, double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    return instance_setup(i, start);
}

EXPORTED status fmi3ExitInitializationMode(instance *i)
{
    return instance_begin(i);
}

EXPORTED status fmi3EnterEventMode(instance *i)
{
    (void)i;
    return MODEL_SAMPLED ? ERROR : OK;
}

EXPORTED status fmi3Terminate(instance *i)
{
    i->now.mode = ENDED;
    return OK;
}

EXPORTED status fmi3Reset(instance *i)
{
    return instance_reset(i);
}

EXPORTED status fmi3GetFloat64(instance *i, const uint32_t references[], size_t count, double values[], size_t room)
{
    return instance_get(i, references, count, values, room);
}

EXPORTED status fmi3SetFloat64(instance *i, const uint32_t references[], size_t count, const double values[], size_t room)
{
    return instance_set(i, references, count, values, room);
}

/* No variable has one of these types. */
#define WITHOUT(name, type)                                                                                            \
    EXPORTED status fmi3Get##name(instance *i, const uint32_t references[], size_t count, type values[], size_t room)  \
    {                                                                                                                  \
        (void)references, (void)values, (void)room;                                                                    \
        return count == 0u ? OK : instance_fail(i, "no variable has that type");                                       \
    }                                                                                                                  \
    EXPORTED status fmi3Set##name(instance *i, const uint32_t references[], size_t count, const type values[],         \
        size_t room)                                                                                                   \
    {                                                                                                                  \
        (void)references, (void)values, (void)room;                                                                    \
        return count == 0u ? OK : instance_fail(i, "no variable has that type");                                       \
    }
typedef const char *text;
WITHOUT(Float32, float)
WITHOUT(Int8, int8_t)
WITHOUT(UInt8, uint8_t)
WITHOUT(Int16, int16_t)
WITHOUT(UInt16, uint16_t)
WITHOUT(Int32, int32_t)
WITHOUT(UInt32, uint32_t)
WITHOUT(Int64, int64_t)
WITHOUT(UInt64, uint64_t)
WITHOUT(Boolean, bool)
WITHOUT(String, text)

typedef const uint8_t *bytes;

EXPORTED status fmi3GetBinary(instance *i, const uint32_t references[], size_t count, size_t sizes[], bytes values[],
    size_t room)
{
    (void)references, (void)sizes, (void)values, (void)room;
    return count == 0u ? OK : instance_fail(i, "no variable has that type");
}

EXPORTED status fmi3SetBinary(instance *i, const uint32_t references[], size_t count, const size_t sizes[],
    const bytes values[], size_t room)
{
    (void)references, (void)sizes, (void)values, (void)room;
    return count == 0u ? OK : instance_fail(i, "no variable has that type");
}

EXPORTED status fmi3GetClock(instance *i, const uint32_t references[], size_t count, bool values[])
{
    (void)references, (void)values;
    return count == 0u ? OK : instance_fail(i, "there are no clocks");
}

EXPORTED status fmi3SetClock(instance *i, const uint32_t references[], size_t count, const bool values[])
{
    (void)references, (void)values;
    return count == 0u ? OK : instance_fail(i, "there are no clocks");
}

#define NOT_OFFERED(name, parameters)                                                                                  \
    EXPORTED status name parameters                                                                                    \
    {                                                                                                                  \
        return instance_fail(i, #name " is not offered");                                                              \
    }
NOT_OFFERED(fmi3GetNumberOfVariableDependencies, (instance *i, uint32_t reference, size_t *count))
NOT_OFFERED(fmi3GetVariableDependencies, (instance *i, uint32_t dependent, size_t elements[], uint32_t independents[],
    size_t independent_elements[], int kinds[], size_t count))
NOT_OFFERED(fmi3GetAdjointDerivative, (instance *i, const uint32_t unknowns[], size_t unknown_count,
    const uint32_t knowns[], size_t known_count, const double seed[], size_t seeds, double sensitivity[], size_t room))
NOT_OFFERED(fmi3EnterConfigurationMode, (instance *i))
NOT_OFFERED(fmi3ExitConfigurationMode, (instance *i))
NOT_OFFERED(fmi3GetIntervalDecimal, (instance *i, const uint32_t references[], size_t count, double intervals[],
    int qualifiers[]))
NOT_OFFERED(fmi3GetIntervalFraction, (instance *i, const uint32_t references[], size_t count, uint64_t counters[],
    uint64_t resolutions[], int qualifiers[]))
NOT_OFFERED(fmi3GetShiftDecimal, (instance *i, const uint32_t references[], size_t count, double shifts[]))
NOT_OFFERED(fmi3GetShiftFraction, (instance *i, const uint32_t references[], size_t count, uint64_t counters[],
    uint64_t resolutions[]))
NOT_OFFERED(fmi3SetIntervalDecimal, (instance *i, const uint32_t references[], size_t count, const double intervals[]))
NOT_OFFERED(fmi3SetIntervalFraction, (instance *i, const uint32_t references[], size_t count, const uint64_t counters[],
    const uint64_t resolutions[]))
NOT_OFFERED(fmi3SetShiftDecimal, (instance *i, const uint32_t references[], size_t count, const double shifts[]))
NOT_OFFERED(fmi3SetShiftFraction, (instance *i, const uint32_t references[], size_t count, const uint64_t counters[],
    const uint64_t resolutions[]))
NOT_OFFERED(fmi3EnterStepMode, (instance *i))
NOT_OFFERED(fmi3GetOutputDerivatives, (instance *i, const uint32_t references[], size_t count, const int32_t orders[],
    double values[], size_t room))
NOT_OFFERED(fmi3ActivateModelPartition, (instance *i, uint32_t clock, double time))

EXPORTED status fmi3EvaluateDiscreteStates(instance *i)
{
    (void)i;
    return OK;
}

EXPORTED status fmi3GetFMUState(instance *i, void **state)
{
    return instance_save(i, state);
}

EXPORTED status fmi3SetFMUState(instance *i, void *state)
{
    return instance_restore(i, state);
}

EXPORTED status fmi3FreeFMUState(instance *i, void **state)
{
    (void)i;
    free(*state);
    *state = NULL;
    return OK;
}

EXPORTED status fmi3SerializedFMUStateSize(instance *i, void *state, size_t *size)
{
    (void)i, (void)state;
    *size = instance_serialised_size();
    return OK;
}

EXPORTED status fmi3SerializeFMUState(instance *i, void *state, uint8_t serialised[], size_t size)
{
    return instance_serialise(i, state, serialised, size);
}

EXPORTED status fmi3DeserializeFMUState(instance *i, const uint8_t serialised[], size_t size, void **state)
{
    return instance_deserialise(i, serialised, size, state);
}

EXPORTED status fmi3UpdateDiscreteStates(instance *i, bool *again, bool *terminate, bool *nominals, bool *values,
    bool *next_defined, double *next)
{
    *again = *terminate = *nominals = *values = *next_defined = false;
    *next = 0.0;
    return MODEL_SAMPLED ? OK : instance_event(i);
}

EXPORTED status fmi3DoStep(instance *i, double time, double step, bool no_return, bool *event, bool *terminate, bool *early,
    double *last)
{
    const status result = instance_step(i, time, step);
    (void)no_return;
    *event = *terminate = *early = false;
    *last = i->now.time;
    return result;
}

EXPORTED status fmi3GetDirectionalDerivative(instance *i, const uint32_t unknowns[], size_t unknown_count,
    const uint32_t knowns[], size_t known_count, const double seed[], size_t seeds, double sensitivity[], size_t room)
{
    if (seeds < known_count || room < unknown_count) {
        return instance_fail(i, "fewer values than variables");
    }
    return instance_directional(i, unknowns, unknown_count, knowns, known_count, seed, sensitivity);
}

EXPORTED status fmi3EnterContinuousTimeMode(instance *i)
{
    (void)i;
    return OK;
}

EXPORTED status fmi3CompletedIntegratorStep(instance *i, bool no_return, bool *event, bool *terminate)
{
    (void)i, (void)no_return;
    *event = *terminate = false;
    return OK;
}

EXPORTED status fmi3SetTime(instance *i, double time)
{
    return instance_set_time(i, time);
}

EXPORTED status fmi3SetContinuousStates(instance *i, const double x[], size_t count)
{
    return instance_set_states(i, x, count);
}

EXPORTED status fmi3GetContinuousStateDerivatives(instance *i, double xd[], size_t count)
{
    return instance_derivatives(i, xd, count);
}

EXPORTED status fmi3GetEventIndicators(instance *i, double z[], size_t count)
{
    return instance_indicators(i, z, count);
}

EXPORTED status fmi3GetContinuousStates(instance *i, double x[], size_t count)
{
    return instance_states(i, x, count);
}

EXPORTED status fmi3GetNominalsOfContinuousStates(instance *i, double nominals[], size_t count)
{
    size_t k;
    (void)i;
    for (k = 0; k < count; k++) {
        nominals[k] = 1.0;
    }
    return OK;
}

EXPORTED status fmi3GetNumberOfEventIndicators(instance *i, size_t *count)
{
    (void)i;
    *count = MODEL_INDICATORS;
    return OK;
}

EXPORTED status fmi3GetNumberOfContinuousStates(instance *i, size_t *count)
{
    (void)i;
    *count = MODEL_STATES;
    return OK;
}
