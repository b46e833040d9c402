/* One instance of the model, and what FMI 2.0 and FMI 3.0 have in common. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include "model.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

/* As fmi2Status and fmi3Status count them. */
enum { OK = 0, DISCARD = 2, ERROR = 3 };
enum { CREATED, BEGINNING, RUNNING, ENDED };

/* What getting, setting and serialising a state copies: no pointers in it. */
typedef struct {
    model_state model;
    double time;
    double start; /* [s] time of tick 0 */
    double next; /* [s] at which the tool's next step begins, by the tool's own sum: over hours its rounding adds up */
    int32_t mode;
    int32_t computed; /* 0: derivatives and outputs of a model for model exchange are to be computed */
} snapshot;

typedef struct instance {
    snapshot now;
    model_state room; /* for outputs before the end of initialization */
    void (*log)(const struct instance *, int status, const char *message);
    void *environment;
    void *logger;
    char *name;
} instance;

instance *instance_new(const char *name, const char *token, void *environment, void *logger,
    void (*log)(const instance *, int, const char *));
void instance_free(instance *i);
int instance_reset(instance *i);
int instance_setup(instance *i, double start);
int instance_begin(instance *i);
int instance_get(instance *i, const uint32_t *references, size_t count, double *values, size_t room);
int instance_set(instance *i, const uint32_t *references, size_t count, const double *values, size_t room);
int instance_fail(const instance *i, const char *message);

/* Copies of the state. */
int instance_save(const instance *i, void **state);
int instance_restore(instance *i, const void *state);
size_t instance_serialised_size(void);
int instance_serialise(const instance *i, const void *state, uint8_t *bytes, size_t size);
int instance_deserialise(const instance *i, const uint8_t *bytes, size_t size, void **state);

/* Co-simulation; of model exchange it fails. */
int instance_step(instance *i, double time, double step);

/* Model exchange; of co-simulation they fail. */
int instance_set_time(instance *i, double time);
int instance_set_states(instance *i, const double *x, size_t count);
int instance_states(const instance *i, double *x, size_t count);
int instance_derivatives(instance *i, double *xd, size_t count);
int instance_indicators(instance *i, double *z, size_t count);
int instance_event(instance *i);
int instance_directional(instance *i, const uint32_t *unknowns, size_t unknown_count, const uint32_t *knowns,
    size_t known_count, const double *seed, double *sensitivity);

#endif
