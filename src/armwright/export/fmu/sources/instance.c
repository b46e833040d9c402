/* One instance of the model, and what FMI 2.0 and FMI 3.0 have in common. */
#include "instance.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define TOLERANCE 1e-6 /* of a tick: how far times may lie from whole ticks */

int instance_fail(const instance *i, const char *message)
{
    if (i != NULL && i->log != NULL) {
        i->log(i, ERROR, message);
    }
    return ERROR;
}

instance *instance_new(const char *name, const char *token, void *environment, void *logger,
    void (*log)(const instance *, int, const char *))
{
    instance *i = calloc(1, sizeof *i);
    if (i == NULL) {
        return NULL;
    }
    i->environment = environment;
    i->logger = logger;
    i->log = log;
    i->name = calloc(strlen(name != NULL ? name : "") + 1u, 1u);
    if (i->name != NULL && name != NULL) {
        memcpy(i->name, name, strlen(name));
    }
    if (token == NULL || strcmp(token, MODEL_TOKEN) != 0) {
        (void)instance_fail(i, "the instantiation token (GUID) is not the one of this FMU's model description");
        instance_free(i);
        return NULL;
    }
    (void)instance_reset(i);
    return i;
}

void instance_free(instance *i)
{
    if (i != NULL) {
        free(i->name);
        free(i);
    }
}

int instance_reset(instance *i)
{
    memset(&i->now, 0, sizeof i->now); /* its padding too: equal states have equal bytes */
    model_create(&i->now.model);
    i->now.mode = CREATED;
    return OK;
}

int instance_setup(instance *i, double start)
{
    if (i->now.mode != CREATED) {
        return instance_fail(i, "initialization mode is entered once, behind instantiation or reset");
    }
    i->now.start = start;
    i->now.time = start;
    i->now.next = start;
    i->now.mode = BEGINNING;
    return OK;
}

int instance_begin(instance *i)
{
    if (i->now.mode != BEGINNING) {
        return instance_fail(i, "initialization mode was not entered");
    }
    model_begin(&i->now.model);
    i->now.mode = RUNNING;
    i->now.computed = 0;
    return OK;
}

/* Outputs of the initial values are computed on a copy: what is set later may change them. */
static const model_state *ready(instance *i)
{
    if (i->now.mode == CREATED || i->now.mode == BEGINNING) {
        i->room = i->now.model;
        model_begin(&i->room);
#if !MODEL_SAMPLED
        model_outputs(&i->room);
#endif
        return &i->room;
    }
#if !MODEL_SAMPLED
    if (i->now.computed == 0) {
        model_outputs(&i->now.model);
        i->now.computed = 1;
    }
#endif
    return &i->now.model;
}

static double *place(model_state *model, uint32_t reference)
{
    return (double *)(void *)((char *)model + model_variables[reference].offset);
}

int instance_get(instance *i, const uint32_t *references, size_t count, double *values, size_t room)
{
    const model_state *model = ready(i);
    size_t k;
    if (room < count) {
        return instance_fail(i, "fewer values than variables");
    }
    for (k = 0; k < count; k++) {
        if (references[k] > MODEL_VARIABLES) {
            return instance_fail(i, "no variable has that value reference");
        }
        if (references[k] == 0u) {
            values[k] = i->now.time;
        } else {
            memcpy(&values[k], (const char *)model + model_variables[references[k]].offset, sizeof values[k]);
        }
    }
    return OK;
}

int instance_set(instance *i, const uint32_t *references, size_t count, const double *values, size_t room)
{
    size_t k;
    if (room < count) {
        return instance_fail(i, "fewer values than variables");
    }
    for (k = 0; k < count; k++) {
        char text[120];
        int kind, begun = i->now.mode != CREATED && i->now.mode != BEGINNING;
        if (references[k] == 0u || references[k] > MODEL_VARIABLES) {
            return instance_fail(i, "no variable that can be set has that value reference");
        }
        kind = model_variables[references[k]].kind;
        if (kind == COMPUTED || (kind == FIXED && begun) || (kind == STATE && !begun)) {
            (void)snprintf(text, sizeof text, "the variable with value reference %u cannot be set%s",
                (unsigned)references[k], kind == COMPUTED ? "" : kind == FIXED ? " after initialization"
                : " before initialization ends; start.q and start.qd can");
            return instance_fail(i, text);
        }
        memcpy(place(&i->now.model, references[k]), &values[k], sizeof values[k]);
    }
    i->now.computed = 0;
    return OK;
}

int instance_save(const instance *i, void **state)
{
    if (*state == NULL) {
        *state = calloc(1, sizeof(snapshot));
    }
    if (*state == NULL) {
        return instance_fail(i, "no memory for a copy of the state");
    }
    memcpy(*state, &i->now, sizeof i->now);
    return OK;
}

int instance_restore(instance *i, const void *state)
{
    if (state == NULL) {
        return instance_fail(i, "no state to go on from");
    }
    memcpy(&i->now, state, sizeof i->now);
    return OK;
}

/* Serialised: the model's token, then the numbers as this processor has them. */
size_t instance_serialised_size(void)
{
    return sizeof MODEL_TOKEN + sizeof(snapshot);
}

int instance_serialise(const instance *i, const void *state, uint8_t *bytes, size_t size)
{
    if (state == NULL || size < instance_serialised_size()) {
        return instance_fail(i, "too few bytes for a serialised state");
    }
    memcpy(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN);
    memcpy(bytes + sizeof MODEL_TOKEN, state, sizeof(snapshot));
    return OK;
}

int instance_deserialise(const instance *i, const uint8_t *bytes, size_t size, void **state)
{
    if (size < instance_serialised_size() || memcmp(bytes, MODEL_TOKEN, sizeof MODEL_TOKEN) != 0) {
        return instance_fail(i, "these bytes are no serialised state of this FMU");
    }
    if (*state == NULL) {
        *state = calloc(1, sizeof(snapshot));
    }
    if (*state == NULL) {
        return instance_fail(i, "no memory for a copy of the state");
    }
    memcpy(*state, bytes + sizeof MODEL_TOKEN, sizeof(snapshot));
    return OK;
}

static int other(const instance *i)
{
    return instance_fail(i, "this FMU is made for " MODEL_INTERFACE " alone");
}

#if MODEL_SAMPLED

int instance_step(instance *i, double time, double step)
{
    const double wanted = step / MODEL_PERIOD, whole = floor(wanted + 0.5);
    const double off = fmin(fabs(time - i->now.time), fabs(time - i->now.next)) / MODEL_PERIOD;
    const double rounding = 4.0 * DBL_EPSILON * fabs(time) / MODEL_PERIOD; /* of a step that is a difference of times */
    char text[160];
    double k;
    if (i->now.mode != RUNNING) {
        return instance_fail(i, "a step before the end of initialization");
    }
    if (!(off <= 1e3 * TOLERANCE + rounding)) {
        (void)snprintf(text, sizeof text, "a step from t = %.12g s, but the model is at t = %.12g s", time, i->now.time);
        return instance_fail(i, text);
    }
    if (!(whole >= 1.0) || !(fabs(wanted - whole) <= TOLERANCE + rounding)) {
        (void)snprintf(text, sizeof text, "a communication step of %.12g s: expected a multiple of the tick, %.12g s", step,
            MODEL_PERIOD);
        return instance_fail(i, text);
    }
    for (k = 0.0; k < whole; k += 1.0) {
        if (model_tick(&i->now.model) != 0) {
            (void)snprintf(text, sizeof text, "the arm's state became infinite or not a number, or its solver stalled, behind t = %.9g s",
                i->now.time);
            return instance_fail(i, text);
        }
        i->now.time = i->now.start + (double)i->now.model.tick_number * MODEL_PERIOD;
    }
    i->now.next = time + step;
    return OK;
}

int instance_set_time(instance *i, double time)
{
    (void)time;
    return other(i);
}

int instance_set_states(instance *i, const double *x, size_t count)
{
    (void)x, (void)count;
    return other(i);
}

int instance_states(const instance *i, double *x, size_t count)
{
    (void)x, (void)count;
    return other(i);
}

int instance_derivatives(instance *i, double *xd, size_t count)
{
    (void)xd, (void)count;
    return other(i);
}

int instance_indicators(instance *i, double *z, size_t count)
{
    (void)z, (void)count;
    return other(i);
}

int instance_event(instance *i)
{
    return other(i);
}

int instance_directional(instance *i, const uint32_t *unknowns, size_t unknown_count, const uint32_t *knowns,
    size_t known_count, const double *seed, double *sensitivity)
{
    (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count, (void)seed, (void)sensitivity;
    return other(i);
}

#else

int instance_step(instance *i, double time, double step)
{
    (void)time, (void)step;
    return other(i);
}

int instance_set_time(instance *i, double time)
{
    i->now.time = time;
    return OK;
}

int instance_set_states(instance *i, const double *x, size_t count)
{
    if (count != MODEL_STATES) {
        return instance_fail(i, "another number of continuous states");
    }
    memcpy(i->now.model.x, x, sizeof i->now.model.x);
    i->now.computed = 0;
    return OK;
}

int instance_states(const instance *i, double *x, size_t count)
{
    if (count != MODEL_STATES) {
        return instance_fail(i, "another number of continuous states");
    }
    memcpy(x, i->now.model.x, sizeof i->now.model.x);
    return OK;
}

int instance_derivatives(instance *i, double *xd, size_t count)
{
    if (count != MODEL_STATES) {
        return instance_fail(i, "another number of continuous states");
    }
    memcpy(xd, ready(i)->xd, count * sizeof *xd);
    return OK;
}

int instance_indicators(instance *i, double *z, size_t count)
{
    if (count != MODEL_INDICATORS) {
        return instance_fail(i, "another number of event indicators");
    }
#if MODEL_INDICATORS
    memcpy(z, ready(i)->z, count * sizeof *z);
#else
    (void)z;
#endif
    return OK;
}

int instance_event(instance *i)
{
    model_event(&i->now.model);
    i->now.computed = 0;
    return OK;
}

/* The tangent of derivatives and outputs along one direction of states and inputs. */
int instance_directional(instance *i, const uint32_t *unknowns, size_t unknown_count, const uint32_t *knowns,
    size_t known_count, const double *seed, double *sensitivity)
{
    static const model_direction none;
    model_direction along = none, result = none;
    size_t k;
    for (k = 0; k < known_count; k++) {
        const int32_t entry = knowns[k] > MODEL_VARIABLES ? -1 : model_variables[knowns[k]].known;
        if (entry < 0) {
            return instance_fail(i, "derivatives are known by continuous states and inputs alone");
        }
        along.values[entry] = seed[k];
    }
    model_tangent(&i->now.model, &along, &result);
    for (k = 0; k < unknown_count; k++) {
        const int32_t entry = unknowns[k] > MODEL_VARIABLES ? -1 : model_variables[unknowns[k]].unknown;
        if (entry < 0) {
            return instance_fail(i, "derivatives are known of state derivatives and outputs alone");
        }
        sensitivity[k] = result.values[entry];
    }
    return OK;
}

#endif
