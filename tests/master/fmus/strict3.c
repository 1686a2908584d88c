/* A strict FMI 3.0 co-simulation FMU for tests: every type, arrays, and a state table that complains.

   Each output is its input: f32, f64, i8 ... u64, b (arrays of two), s, d (Binary), e (Enumeration, item values 1 and 5),
   with 1 added to numbers. In Initialization Mode at once, later at the end of a step. `events` counts updates of discrete
   states. `mode` and `when` (s) say what happens in the step that begins at `when` or later:
   1 discard of steps longer than `longest`, 2 fmi3Error, 3 fmi3Fatal, 4 terminateSimulation, 5 early return although it is
   not allowed, 6 f64 is NaN, 7 e is 2^40, 8 fmi3Warning, 9 lastSuccessfulTime a little before the end of the step,
   10 a state event in the middle of the step, 11 a time event every `longest` s from `when` on, 12 an event at the end of the step, with
   two updates of discrete states, 13 updates without end, 14 terminateSimulation in Event Mode, 15 an event at the beginning
   of the step: early return at once. 20: fmi3Terminate fails.
   A call that is not allowed is written to the file that STRICT3_LOG names, and is fmi3Error. */

#include "fmi3_fmu.h"

enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, STEP = 8, TERMINATED = 16, DISCARDED = 32 };
/* Value references: inputs of the numeric types from 1 on, outputs from 21 on. */
enum { MODE = 40, WHEN, LONGEST, TIME, EVENTS, S_IN = 50, S_OUT, D_IN, D_OUT, E_IN, E_OUT };

typedef struct {
    INSTANCE;
    int updates, saved_valid, done;
    bool event_mode, early;
    double stop, next, number[40][2];
    int64_t wide[40][2];
    int mode, events;
    double when, longest, returned;
    char text[2][64];
    unsigned char bytes[2][64];
    size_t sizes[2];
    int64_t item[2];
} Strict;

static void compute(Strict *s) {
    for (int i = 1; i < 20; i++)
        for (int j = 0; j < 2; j++) {
            s->number[20 + i][j] = s->number[i][j] + 1;
            s->wide[20 + i][j] = i == 11 ? s->wide[i][j] : s->wide[i][j] + 1;
        }
    memcpy(s->text[1], s->text[0], sizeof s->text[0]);
    memcpy(s->bytes[1], s->bytes[0], sizeof s->bytes[0]);
    s->sizes[1] = s->sizes[0];
    s->item[1] = s->item[0];
    if (s->mode == 6 && s->time >= s->when) s->number[22][1] = NAN;
    if (s->mode == 7 && s->time >= s->when) s->item[1] = (int64_t)1 << 40;
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                         bool event_mode, bool early, const uint32_t needed[], size_t n_needed, void *environment,
                                         Logger logger, void *update) {
    (void)visible, (void)logging, (void)needed;
    Strict *s = calloc(1, sizeof *s);
    snprintf(s->name, sizeof s->name, "%s", name);
    s->environment = environment, s->logger = logger, s->event_mode = event_mode, s->early = early;
    s->state = INSTANTIATED;
    if (!update && n_needed) complain(s, "instantiated with %d intermediate variables and no callback", (int)n_needed);
    if (update) complain(s, "instantiated with a callback that nobody asked for");
    s->longest = 1, s->next = INFINITY, s->returned = -1, s->item[0] = 1;
    if (strcmp(token, "strict3") || (resources && resources[strlen(resources) - 1] != '/')) {
        complain(s, "instantiated with token %s, resources %s, %d required variables", token, resources ? resources : "NULL", (int)n_needed);
        free(s);
        return NULL;
    }
    note(s, resources ? "instantiated with resources" : "instantiated without resources", event_mode);
    return s;
}

EXPORT int fmi3EnterInitializationMode(Strict *s, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    (void)has_tolerance, (void)tolerance;
    ALLOWED(s, "fmi3EnterInitializationMode", INSTANTIATED);
    s->time = start, s->stop = has_stop ? stop : INFINITY, s->state = INITIALIZATION;
    return OK;
}
EXPORT int fmi3ExitInitializationMode(Strict *s) {
    ALLOWED(s, "fmi3ExitInitializationMode", INITIALIZATION);
    compute(s);
    s->state = s->event_mode ? EVENT : STEP;
    s->updates = 0;
    return OK;
}
EXPORT int fmi3Terminate(Strict *s) {
    ALLOWED(s, "fmi3Terminate", EVENT | STEP);
    s->state = TERMINATED;
    note(s, "terminate", s->time);
    return s->mode == 20 ? ERROR : OK;
}
EXPORT int fmi3EnterEventMode(Strict *s) {
    ALLOWED(s, "fmi3EnterEventMode", STEP);
    if (!s->event_mode) return complain(s, "fmi3EnterEventMode without eventModeUsed");
    s->state = EVENT, s->updates = 0;
    note(s, "event", s->time);
    return OK;
}
EXPORT int fmi3EnterStepMode(Strict *s) {
    ALLOWED(s, "fmi3EnterStepMode", EVENT);
    if (!s->updates || s->done) return complain(s, "fmi3EnterStepMode before the discrete states are updated");
    s->state = STEP;
    return OK;
}
EXPORT int fmi3UpdateDiscreteStates(Strict *s, bool *again, bool *terminate, bool *nominals, bool *values, bool *has_next, double *next) {
    ALLOWED(s, "fmi3UpdateDiscreteStates", EVENT);
    bool active = s->time >= s->when - 1e-9;
    *nominals = *values = false;
    s->updates++;
    s->events++;
    *again = (s->mode == 12 && active && s->updates < 2) || s->mode == 13;
    s->done = *again;
    *terminate = s->mode == 14 && active;
    if (s->mode == 11) s->next = s->when + s->longest * (s->time < s->when - 1e-9 ? 0 : floor((s->time - s->when) / s->longest + 1e-6) + 1);
    *has_next = s->mode == 11;
    *next = s->next;
    compute(s);
    return OK;
}

EXPORT int fmi3DoStep(Strict *s, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    ALLOWED(s, "fmi3DoStep", STEP | DISCARDED);
    if (no_set_prior) s->promised = t, s->has_promised = true;
    if (!(h > 0) || fabs(t - s->time) > 1e-9 || t + h > s->stop + 1e-9) return complain(s, "fmi3DoStep from %g by %g, time is %g", t, h, s->time);
    if (s->event_mode && t + h > s->next + 1e-9) return complain(s, "fmi3DoStep to %g, beyond the next event at %g", t + h, s->next);
    note(s, "step", h);
    *event = *terminate = *early = false;
    int mode = t >= s->when - 1e-9 ? s->mode : 0;
    if (mode == 1 && h > s->longest + 1e-9) return DISCARD;
    if (mode == 2 || mode == 3) {
        s->logger(s->environment, mode + 1, "logStatusError", "it is over");
        s->state = TERMINATED;
        return mode + 1;
    }
    double end = t + h, shown = end;
    if (mode == 5 || (mode == 10 && s->early && t < s->when + 1e-9)) {
        end = shown = t + h / 2;
        *early = true;
    }
    if (mode == 15 && s->early && s->returned < t) {
        end = shown = s->returned = t;
        *early = true;
    }
    if (mode == 9) shown = end - 1e-3 * h;
    *event = s->event_mode && ((mode == 15 && end <= t) || mode == 10 || mode == 12 || mode == 13 || mode == 14 || (s->mode == 11 && end > s->next - 1e-9));
    *terminate = mode == 4;
    s->time = end;
    *last = shown;
    compute(s);
    return mode == 8 ? WARNING : OK;
}

/* ---- values ------------------------------------------------------------------------------------------------------ */

#define GETTABLE (INITIALIZATION | EVENT | STEP | TERMINATED)
#define SETTABLE (INSTANTIATED | INITIALIZATION | EVENT | STEP)

/* 2.4.7: where Event Mode is used, discrete inputs change in it only. */
#define IN_EVENT_MODE(s, function)                                                                                     \
    if ((s)->event_mode && (s)->state == STEP) return complain(s, function ": a discrete input in Step Mode")

#define NUMBERS(Type, type, place, field)                                                                              \
    EXPORT int fmi3Get##Type(Strict *s, const uint32_t vr[], size_t n, type value[], size_t n_values) {                \
        ALLOWED(s, "fmi3Get" #Type, GETTABLE);                                                                            \
        if (s->state == INITIALIZATION) compute(s);                                                                    \
        if (n_values != 2 * n) return complain(s, "fmi3Get" #Type ": %d values of %d arrays", (int)n_values, (int)n);  \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (vr[i] != place && vr[i] != place + 20) return complain(s, "fmi3Get" #Type ": value reference %d", (int)vr[i]); \
            for (int j = 0; j < 2; j++) *value++ = (type)s->field[vr[i]][j];                                           \
        }                                                                                                              \
        return OK;                                                                                                     \
    }                                                                                                                  \
    EXPORT int fmi3Set##Type(Strict *s, const uint32_t vr[], size_t n, const type value[], size_t n_values) {          \
        ALLOWED(s, "fmi3Set" #Type, SETTABLE);                                                                            \
        if (place > 2) IN_EVENT_MODE(s, "fmi3Set" #Type);                                                              \
        if (n_values != 2 * n) return complain(s, "fmi3Set" #Type ": %d values of %d arrays", (int)n_values, (int)n);  \
        for (size_t i = 0; i < n; i++) {                                                                               \
            if (vr[i] != place) return complain(s, "fmi3Set" #Type ": value reference %d", (int)vr[i]);                \
            for (int j = 0; j < 2; j++) s->field[vr[i]][j] = *value++;                                                 \
        }                                                                                                              \
        return OK;                                                                                                     \
    }

NUMBERS(Float32, float, 1, number)
NUMBERS(Int8, int8_t, 3, wide)
NUMBERS(UInt8, uint8_t, 4, wide)
NUMBERS(Int16, int16_t, 5, wide)
NUMBERS(UInt16, uint16_t, 6, wide)
NUMBERS(UInt32, uint32_t, 8, wide)
NUMBERS(UInt64, uint64_t, 10, wide)
NUMBERS(Boolean, bool, 11, wide)

#define FIXED(s, vr) ((vr) >= MODE && (vr) <= LONGEST && !((s)->state & (INSTANTIATED | INITIALIZATION)))

EXPORT int fmi3GetFloat64(Strict *s, const uint32_t vr[], size_t n, double value[], size_t n_values) {
    ALLOWED(s, "fmi3GetFloat64", GETTABLE);
    if (s->state == INITIALIZATION) compute(s);
    const double *end = value + n_values;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == TIME || vr[i] == WHEN || vr[i] == LONGEST) *value++ = vr[i] == TIME ? s->time : vr[i] == WHEN ? s->when : s->longest;
        else if (vr[i] == 2 || vr[i] == 22) for (int j = 0; j < 2; j++) *value++ = s->number[vr[i]][j];
        else return complain(s, "fmi3GetFloat64: value reference %d", (int)vr[i]);
    }
    return value == end ? OK : complain(s, "fmi3GetFloat64: %d values", (int)n_values);
}
EXPORT int fmi3SetFloat64(Strict *s, const uint32_t vr[], size_t n, const double value[], size_t n_values) {
    ALLOWED(s, "fmi3SetFloat64", SETTABLE);
    const double *end = value + n_values;
    for (size_t i = 0; i < n; i++) {
        if (FIXED(s, vr[i])) return complain(s, "fmi3SetFloat64 of a fixed parameter");
        if (vr[i] == WHEN) s->when = *value++;
        else if (vr[i] == LONGEST) s->longest = *value++;
        else if (vr[i] == 2) for (int j = 0; j < 2; j++) s->number[2][j] = *value++;
        else return complain(s, "fmi3SetFloat64: value reference %d", (int)vr[i]);
    }
    return value == end ? OK : complain(s, "fmi3SetFloat64: %d values", (int)n_values);
}
EXPORT int fmi3GetInt32(Strict *s, const uint32_t vr[], size_t n, int32_t value[], size_t n_values) {
    ALLOWED(s, "fmi3GetInt32", GETTABLE);
    if (s->state == INITIALIZATION) compute(s);
    const int32_t *end = value + n_values;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == MODE || vr[i] == EVENTS) *value++ = vr[i] == MODE ? s->mode : s->events;
        else for (int j = 0; j < 2; j++) *value++ = (int32_t)s->wide[vr[i]][j];
    }
    return value == end ? OK : complain(s, "fmi3GetInt32: %d values", (int)n_values);
}
EXPORT int fmi3SetInt32(Strict *s, const uint32_t vr[], size_t n, const int32_t value[], size_t n_values) {
    ALLOWED(s, "fmi3SetInt32", SETTABLE);
    IN_EVENT_MODE(s, "fmi3SetInt32");
    const int32_t *end = value + n_values;
    for (size_t i = 0; i < n; i++) {
        if (FIXED(s, vr[i])) return complain(s, "fmi3SetInt32 of a fixed parameter");
        if (vr[i] == MODE) s->mode = *value++;
        else for (int j = 0; j < 2; j++) s->wide[7][j] = *value++;
    }
    return value == end ? OK : complain(s, "fmi3SetInt32: %d values", (int)n_values);
}
EXPORT int fmi3GetInt64(Strict *s, const uint32_t vr[], size_t n, int64_t value[], size_t n_values) {
    ALLOWED(s, "fmi3GetInt64", GETTABLE);
    if (s->state == INITIALIZATION) compute(s);
    const int64_t *end = value + n_values;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == E_IN || vr[i] == E_OUT) *value++ = s->item[vr[i] - E_IN];
        else for (int j = 0; j < 2; j++) *value++ = s->wide[vr[i]][j];
    }
    return value == end ? OK : complain(s, "fmi3GetInt64: %d values", (int)n_values);
}
EXPORT int fmi3SetInt64(Strict *s, const uint32_t vr[], size_t n, const int64_t value[], size_t n_values) {
    ALLOWED(s, "fmi3SetInt64", SETTABLE);
    IN_EVENT_MODE(s, "fmi3SetInt64");
    const int64_t *end = value + n_values;
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == E_IN) s->item[0] = *value++;
        else for (int j = 0; j < 2; j++) s->wide[9][j] = *value++;
    }
    return value == end ? OK : complain(s, "fmi3SetInt64: %d values", (int)n_values);
}
EXPORT int fmi3GetString(Strict *s, const uint32_t vr[], size_t n, const char *value[], size_t n_values) {
    ALLOWED(s, "fmi3GetString", GETTABLE);
    if (s->state == INITIALIZATION) compute(s);
    for (size_t i = 0; i < n; i++) value[i] = s->text[vr[i] - S_IN];
    return n == n_values ? OK : complain(s, "fmi3GetString: %d values", (int)n_values);
}
EXPORT int fmi3SetString(Strict *s, const uint32_t vr[], size_t n, const char *const value[], size_t n_values) {
    ALLOWED(s, "fmi3SetString", SETTABLE);
    IN_EVENT_MODE(s, "fmi3SetString");
    if (n != 1 || n_values != 1 || vr[0] != S_IN) return complain(s, "fmi3SetString");
    snprintf(s->text[0], sizeof s->text[0], "%s", value[0]);
    return OK;
}
EXPORT int fmi3GetBinary(Strict *s, const uint32_t vr[], size_t n, size_t size[], const unsigned char *value[], size_t n_values) {
    ALLOWED(s, "fmi3GetBinary", GETTABLE);
    if (s->state == INITIALIZATION) compute(s);
    for (size_t i = 0; i < n; i++) value[i] = s->bytes[vr[i] - D_IN], size[i] = s->sizes[vr[i] - D_IN];
    return n == n_values ? OK : complain(s, "fmi3GetBinary: %d values", (int)n_values);
}
EXPORT int fmi3SetBinary(Strict *s, const uint32_t vr[], size_t n, const size_t size[], const unsigned char *const value[], size_t n_values) {
    ALLOWED(s, "fmi3SetBinary", SETTABLE);
    IN_EVENT_MODE(s, "fmi3SetBinary");
    if (n != 1 || n_values != 1 || vr[0] != D_IN || size[0] > sizeof s->bytes[0]) return complain(s, "fmi3SetBinary");
    memcpy(s->bytes[0], value[0], size[0]);
    s->sizes[0] = size[0];
    return OK;
}

STATES(Strict)
