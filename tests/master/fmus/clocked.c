/* An FMI 3.0 co-simulation FMU with every kind of Clock for tests, that looks at what is done with them.

   Input Clocks: constant, fixed, asked (fixed, its interval is asked for), tunable, retuned (tunable, asked for), changing,
   countdown, go (triggered); output Clock: fire. `uses` says which are in its description, bit by bit. Periodic ones that are
   not set tick every `period` s from `shift` on, changing ones after 1, 2, 3, ... times `delay`, countdown `delay` after a tick of
   constant (`delay` 0: at the same time). `ticks_...` count ticks and belong to their Clocks, `all` counts all of them and
   belongs to none. `u` and `y` = u + 1 belong to constant, go and fire; `v` to none, and belongs to nothing `w` = v + 1.
   `rule`: fire ticks 1 with constant, 2 with go, 3 at every event that is signalled at the end of a step that begins at `when` or
   later, 4 at the start, once. 5, a relay: go begins countdown; `bytes_in` belongs to go, `bytes_out` to countdown, and once it has
   been got, neither Clock nor input may be set in this instant. 6: as 1, and `bytes_out` is one byte, how often fire has ticked. `early`: such a step ends in its middle, if it may. `text` and `bytes` belong to go and hold what
   was given before.
   What is not allowed is written to the file that STRICT3_LOG names, ticks and steps to that of STRICT3_CALLS. */

#include "fmi3_fmu.h"

enum { INSTANTIATED = 1, INITIALIZATION = 2, EVENT = 4, STEP = 8, TERMINATED = 16 };
enum { NOT_YET_KNOWN, UNCHANGED, CHANGED };
enum { CONSTANT, FIXED, ASKED, TUNABLE, RETUNED, CHANGING, COUNTDOWN, GO, FIRE, CLOCKS };
static const char *NAME[] = {"constant", "fixed", "asked", "tunable", "retuned", "changing", "countdown", "go", "fire"};
/* Value references: Clocks from 1 on, their counters from 101 on. */
enum { U = 20, Y, V, W, ALL, TEXT_IN, TEXT_OUT, BYTES_IN, BYTES_OUT, PERIOD = 40, SHIFT, DELAY, WHEN, USES, RULE, EARLY, TIME };

typedef struct {
    INSTANCE;
    int uses, rule, all, updates, early, fired;
    bool event_mode, may_return, more, signalled, given, active[CLOCKS], asked[CLOCKS], ticked[CLOCKS], told[CLOCKS];
    int qualifier[CLOCKS], count[CLOCKS], since[CLOCKS];
    double stop, period, shift, delay, when, u, v, w, first[CLOCKS], interval[CLOCKS], next[CLOCKS];
    char text[64];
    unsigned char bytes[64], relayed[64];
    size_t size, relayed_size;
} Clocked;

static bool used(const Clocked *s, int clock) { return s->uses >> clock & 1; }
static bool periodic(int clock) { return clock <= RETUNED; }
static bool same(double a, double b) { return fabs(a - b) < 6e-10; }
/* Whether something that belongs to constant, go and fire may be set and got. */
static bool open(const Clocked *s) {
    bool any = used(s, CONSTANT) || used(s, GO) || used(s, FIRE);
    return !any || s->state == INITIALIZATION || s->active[CONSTANT] || s->active[GO] || s->active[FIRE];
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                         bool event_mode, bool early, const uint32_t needed[], size_t n_needed, void *environment,
                                         Logger logger, void *update) {
    (void)token, (void)resources, (void)visible, (void)logging, (void)needed, (void)n_needed, (void)update;
    Clocked *s = calloc(1, sizeof *s);
    snprintf(s->name, sizeof s->name, "%s", name);
    s->environment = environment, s->logger = logger, s->event_mode = event_mode, s->may_return = early;
    s->state = INSTANTIATED;
    for (int i = 0; i < CLOCKS; i++) s->next[i] = INFINITY, s->qualifier[i] = NOT_YET_KNOWN;
    if (!event_mode) complain(s, "instantiated without Event Mode");
    note(s, "instantiated", early);
    return s;
}

static void restart(Clocked *s, int clock, double first, double interval) {
    s->first[clock] = s->next[clock] = first, s->interval[clock] = interval, s->since[clock] = 0;
}
EXPORT int fmi3EnterInitializationMode(Clocked *s, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    (void)has_tolerance, (void)tolerance;
    ALLOWED(s, "fmi3EnterInitializationMode", INSTANTIATED);
    s->time = start, s->stop = has_stop ? stop : INFINITY, s->state = INITIALIZATION;
    for (int i = CONSTANT; i <= RETUNED; i++)
        if (used(s, i)) restart(s, i, start + s->shift, s->period);
    s->next[CHANGING] = used(s, CHANGING) ? start + s->delay : INFINITY;
    s->qualifier[ASKED] = s->qualifier[RETUNED] = s->qualifier[CHANGING] = CHANGED;
    return OK;
}
EXPORT int fmi3ExitInitializationMode(Clocked *s) {
    ALLOWED(s, "fmi3ExitInitializationMode", INITIALIZATION);
    for (int i = ASKED; i <= COUNTDOWN; i++)
        if (used(s, i) && i != TUNABLE && !s->asked[i]) complain(s, "the interval of %s was not asked for", NAME[i]);
    for (int i = FIXED; i <= TUNABLE; i += TUNABLE - FIXED)
        if (used(s, i) && !s->told[i]) complain(s, "the interval of %s was not set", NAME[i]);
    s->state = EVENT, s->updates = 0;
    memset(s->asked, 0, sizeof s->asked);
    s->active[FIRE] = s->rule == 4;
    return OK;
}
EXPORT int fmi3Terminate(Clocked *s) {
    ALLOWED(s, "fmi3Terminate", EVENT | STEP);
    s->state = TERMINATED;
    return OK;
}
EXPORT int fmi3EnterEventMode(Clocked *s) {
    ALLOWED(s, "fmi3EnterEventMode", STEP);
    s->state = EVENT, s->updates = 0;
    memset(s->asked, 0, sizeof s->asked);
    memset(s->ticked, 0, sizeof s->ticked);
    s->active[FIRE] = s->rule == 3 && s->signalled;
    note(s, "event", s->time);
    return OK;
}
EXPORT int fmi3EnterStepMode(Clocked *s) {
    ALLOWED(s, "fmi3EnterStepMode", EVENT);
    if (!s->updates) return complain(s, "fmi3EnterStepMode before the discrete states are updated");
    for (int i = 0; i < CLOCKS; i++)
        if (s->active[i]) return complain(s, "fmi3EnterStepMode while %s ticks", NAME[i]);
    for (int i = 0; i < GO; i++)
        if (used(s, i) && s->next[i] <= s->time) return complain(s, "%s has not ticked at %.9g", NAME[i], s->next[i]);
    if (used(s, COUNTDOWN) && !s->asked[COUNTDOWN]) return complain(s, "the interval of countdown was not asked for");
    if (used(s, CHANGING) && s->ticked[CHANGING] && !s->asked[CHANGING]) return complain(s, "the interval of changing was not asked for");
    s->state = STEP, s->signalled = false;
    return OK;
}
EXPORT int fmi3UpdateDiscreteStates(Clocked *s, bool *again, bool *terminate, bool *nominals, bool *values, bool *has_next, double *next) {
    ALLOWED(s, "fmi3UpdateDiscreteStates", EVENT);
    *again = *terminate = *nominals = *values = *has_next = false;
    *next = 0;
    s->updates++;
    if (s->active[FIRE] && !s->ticked[FIRE]) complain(s, "fire ticks, and nobody has asked");
    if (s->active[CONSTANT] && used(s, COUNTDOWN)) s->qualifier[COUNTDOWN] = CHANGED, s->next[COUNTDOWN] = s->time + s->delay;
    if (s->active[GO] && s->rule == 5) {
        s->qualifier[COUNTDOWN] = CHANGED, s->next[COUNTDOWN] = s->time + s->delay;
        memcpy(s->relayed, s->bytes, s->size);
        s->relayed_size = s->size;
    }
    s->given = false;
    for (int i = 0; i < CLOCKS; i++) s->active[i] = false;
    s->asked[COUNTDOWN] = s->asked[CHANGING] = false;
    s->w = s->v + 1;
    return OK;
}

EXPORT int fmi3DoStep(Clocked *s, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    (void)no_set_prior;
    ALLOWED(s, "fmi3DoStep", STEP);
    if (!(h > 0) || !same(t, s->time) || t + h > s->stop + 1e-9) return complain(s, "fmi3DoStep from %.9g by %.9g", t, h);
    for (int i = 0; i < GO; i++)
        if (used(s, i) && t + h > s->next[i] + 6e-10) return complain(s, "fmi3DoStep to %.9g, beyond the tick of %s at %.9g", t + h, NAME[i], s->next[i]);
    note(s, "step", h);
    *event = *terminate = *early = false;
    double end = t + h;
    if (s->rule == 3 && t >= s->when - 1e-9) {
        *event = s->signalled = true;
        if (s->early && s->may_return && t < s->when + 1e-9) end = t + h / 2, *early = true;
    }
    s->w = s->v + 1;
    s->time = *last = end;
    return OK;
}

/* ---- Clocks ------------------------------------------------------------------------------------------------------ */

EXPORT int fmi3SetClock(Clocked *s, const uint32_t vr[], size_t n, const bool value[]) {
    ALLOWED(s, "fmi3SetClock", EVENT);
    for (size_t k = 0; k < n; k++) {
        int i = (int)vr[k] - 1;
        if (i < 0 || i >= FIRE || !used(s, i)) return complain(s, "fmi3SetClock of %d", (int)vr[k]);
        if (!value[k]) return complain(s, "%s cannot be deactivated", NAME[i]);
        if (s->given) return complain(s, "%s was set behind an output", NAME[i]);
        if (s->active[i]) return complain(s, "%s ticks already", NAME[i]);
        if (i < GO && !same(s->time, s->next[i])) return complain(s, "%s ticks at %.9g, not now", NAME[i], s->next[i]);
        if (periodic(i) && s->ticked[i]) return complain(s, "%s has ticked in this Event Mode", NAME[i]);
        note(s, NAME[i], s->time);
        s->active[i] = s->ticked[i] = true;
        s->count[i]++, s->all++, s->since[i]++;
        if (periodic(i)) s->next[i] = s->first[i] + s->since[i] * s->interval[i];
        if (i == CHANGING) s->qualifier[i] = CHANGED, s->next[i] = s->time + (1 + s->count[i]) * s->delay;
        if (i == COUNTDOWN) s->qualifier[i] = NOT_YET_KNOWN, s->next[i] = INFINITY;
        if (((s->rule == 1 || s->rule == 6) && i == CONSTANT) || (s->rule == 2 && i == GO)) s->active[FIRE] = true;
    }
    return OK;
}
EXPORT int fmi3GetClock(Clocked *s, const uint32_t vr[], size_t n, bool value[]) {
    ALLOWED(s, "fmi3GetClock", EVENT);
    for (size_t k = 0; k < n; k++) {
        if (vr[k] != FIRE + 1) return complain(s, "fmi3GetClock of %d", (int)vr[k]);
        value[k] = s->active[FIRE];
        if (!s->active[FIRE] || s->ticked[FIRE]) continue;
        note(s, "fire", s->time);
        s->ticked[FIRE] = true;
        s->count[FIRE]++;
    }
    return OK;
}
static int interval_of(Clocked *s, uint32_t vr, double *interval, int *qualifier) {
    int i = (int)vr - 1;
    ALLOWED(s, "fmi3GetInterval", INITIALIZATION | EVENT);
    if (i < 0 || i >= GO || !used(s, i)) return complain(s, "the interval of %d was asked for", (int)vr);
    s->asked[i] = true;
    *qualifier = s->qualifier[i];
    if (s->qualifier[i] == CHANGED) s->qualifier[i] = UNCHANGED;
    if (periodic(i)) *interval = s->interval[i];
    else if (*qualifier != NOT_YET_KNOWN) *interval = s->next[i] - s->time;
    return OK;
}
EXPORT int fmi3GetIntervalDecimal(Clocked *s, const uint32_t vr[], size_t n, double interval[], int qualifier[]) {
    int status = OK;
    for (size_t k = 0; k < n && status == OK; k++) status = interval_of(s, vr[k], interval + k, qualifier + k);
    return status;
}
EXPORT int fmi3GetIntervalFraction(Clocked *s, const uint32_t vr[], size_t n, uint64_t counter[], uint64_t resolution[], int qualifier[]) {
    int status = OK;
    for (size_t k = 0; k < n && status == OK; k++) {
        double interval = 0;
        status = interval_of(s, vr[k], &interval, qualifier + k);
        /* Thirds of a second can be said, and so can all times of the tests. */
        counter[k] = (uint64_t)llround(interval * 3e6), resolution[k] = qualifier[k] == NOT_YET_KNOWN ? 0 : 3000000;
    }
    return status;
}
EXPORT int fmi3GetShiftDecimal(Clocked *s, const uint32_t vr[], size_t n, double shift[]) {
    ALLOWED(s, "fmi3GetShiftDecimal", INITIALIZATION);
    for (size_t k = 0; k < n; k++) {
        if (!periodic((int)vr[k] - 1)) return complain(s, "the shift of %d was asked for", (int)vr[k]);
        shift[k] = s->shift;
    }
    return OK;
}
EXPORT int fmi3GetShiftFraction(Clocked *s, const uint32_t vr[], size_t n, uint64_t counter[], uint64_t resolution[]) {
    ALLOWED(s, "fmi3GetShiftFraction", INITIALIZATION);
    for (size_t k = 0; k < n; k++) {
        if (!periodic((int)vr[k] - 1)) return complain(s, "the shift of %d was asked for", (int)vr[k]);
        counter[k] = (uint64_t)llround(s->shift * 3e6), resolution[k] = 3000000;
    }
    return OK;
}
static int set_interval(Clocked *s, uint32_t vr, double interval) {
    int i = (int)vr - 1;
    bool here = s->state == INITIALIZATION || (s->state == EVENT && i == TUNABLE);
    if ((i != FIXED && i != TUNABLE) || !used(s, i) || !here) return complain(s, "the interval of %d was set", (int)vr);
    note(s, i == FIXED ? "interval of fixed" : "interval of tunable", interval);
    s->told[i] = true;
    restart(s, i, s->state == EVENT ? s->time + interval : s->first[i], interval);
    return OK;
}
EXPORT int fmi3SetIntervalDecimal(Clocked *s, const uint32_t vr[], size_t n, const double interval[]) {
    int status = OK;
    for (size_t k = 0; k < n && status == OK; k++) status = set_interval(s, vr[k], interval[k]);
    return status;
}
EXPORT int fmi3SetIntervalFraction(Clocked *s, const uint32_t vr[], size_t n, const uint64_t counter[], const uint64_t resolution[]) {
    int status = OK;
    for (size_t k = 0; k < n && status == OK; k++) status = set_interval(s, vr[k], (double)counter[k] / (double)resolution[k]);
    return status;
}

/* ---- values ------------------------------------------------------------------------------------------------------ */

#define GETTABLE (INITIALIZATION | EVENT | STEP | TERMINATED)
#define SETTABLE (INSTANTIATED | INITIALIZATION | EVENT | STEP)

EXPORT int fmi3GetFloat64(Clocked *s, const uint32_t vr[], size_t n, double value[], size_t n_values) {
    ALLOWED(s, "fmi3GetFloat64", GETTABLE);
    for (size_t k = 0; k < n; k++) {
        if (vr[k] == Y && !open(s)) return complain(s, "y was got, and its Clocks do not tick");
        const double *place = vr[k] == W ? &s->w : vr[k] == PERIOD ? &s->period : vr[k] == SHIFT ? &s->shift
                            : vr[k] == DELAY ? &s->delay : vr[k] == WHEN ? &s->when : NULL;
        if (vr[k] != Y && !place) return complain(s, "fmi3GetFloat64 of %d", (int)vr[k]);
        value[k] = vr[k] == Y ? s->u + 1 : *place;
    }
    return n == n_values ? OK : complain(s, "fmi3GetFloat64: %d values", (int)n_values);
}
EXPORT int fmi3SetFloat64(Clocked *s, const uint32_t vr[], size_t n, const double value[], size_t n_values) {
    ALLOWED(s, "fmi3SetFloat64", SETTABLE);
    for (size_t k = 0; k < n; k++) {
        if (vr[k] == U && s->state != INSTANTIATED && !open(s)) return complain(s, "u was set, and its Clocks do not tick");
        if (vr[k] >= PERIOD && vr[k] <= WHEN && vr[k] != PERIOD && s->state > INITIALIZATION) return complain(s, "a fixed parameter was set");
        double *place = vr[k] == U ? &s->u : vr[k] == V ? &s->v : vr[k] == PERIOD ? &s->period : vr[k] == SHIFT ? &s->shift
                      : vr[k] == DELAY ? &s->delay : vr[k] == WHEN ? &s->when : NULL;
        if (!place) return complain(s, "fmi3SetFloat64 of %d", (int)vr[k]);
        *place = value[k];
        if (vr[k] == PERIOD && s->state > INITIALIZATION && used(s, RETUNED)) {
            /* The new interval counts from the Event Mode in which it is asked for. */
            s->qualifier[RETUNED] = CHANGED;
            restart(s, RETUNED, s->time + s->period, s->period);
        }
    }
    return n == n_values ? OK : complain(s, "fmi3SetFloat64: %d values", (int)n_values);
}
EXPORT int fmi3GetInt32(Clocked *s, const uint32_t vr[], size_t n, int32_t value[], size_t n_values) {
    ALLOWED(s, "fmi3GetInt32", GETTABLE);
    for (size_t k = 0; k < n; k++) {
        int i = (int)vr[k] - 101;
        const int *place = vr[k] == ALL ? &s->all : vr[k] == USES ? &s->uses : vr[k] == RULE ? &s->rule : vr[k] == EARLY ? &s->early : NULL;
        if (place) value[k] = *place;
        else if (i < 0 || i >= CLOCKS || !used(s, i)) return complain(s, "fmi3GetInt32 of %d", (int)vr[k]);
        else if (!s->active[i] && s->state != INITIALIZATION) return complain(s, "ticks_%s was got, and it does not tick", NAME[i]);
        else value[k] = s->count[i];
    }
    return n == n_values ? OK : complain(s, "fmi3GetInt32: %d values", (int)n_values);
}
EXPORT int fmi3SetInt32(Clocked *s, const uint32_t vr[], size_t n, const int32_t value[], size_t n_values) {
    ALLOWED(s, "fmi3SetInt32", INSTANTIATED | INITIALIZATION);
    for (size_t k = 0; k < n; k++) {
        int *place = vr[k] == USES ? &s->uses : vr[k] == RULE ? &s->rule : vr[k] == EARLY ? &s->early : NULL;
        if (!place) return complain(s, "fmi3SetInt32 of %d", (int)vr[k]);
        *place = value[k];
    }
    return n == n_values ? OK : complain(s, "fmi3SetInt32: %d values", (int)n_values);
}
EXPORT int fmi3GetString(Clocked *s, const uint32_t vr[], size_t n, const char *value[], size_t n_values) {
    ALLOWED(s, "fmi3GetString", GETTABLE);
    if (n != 1 || n_values != 1 || vr[0] != TEXT_OUT || !open(s)) return complain(s, "fmi3GetString");
    value[0] = s->text;
    return OK;
}
EXPORT int fmi3SetString(Clocked *s, const uint32_t vr[], size_t n, const char *const value[], size_t n_values) {
    ALLOWED(s, "fmi3SetString", SETTABLE);
    if (n != 1 || n_values != 1 || vr[0] != TEXT_IN || (s->state > INITIALIZATION && !open(s))) return complain(s, "fmi3SetString");
    snprintf(s->text, sizeof s->text, "%s", value[0]);
    return OK;
}
EXPORT int fmi3GetBinary(Clocked *s, const uint32_t vr[], size_t n, size_t size[], const unsigned char *value[], size_t n_values) {
    ALLOWED(s, "fmi3GetBinary", GETTABLE);
    bool may = s->rule == 5 ? s->state == INITIALIZATION || s->active[COUNTDOWN] : open(s);
    if (n != 1 || n_values != 1 || vr[0] != BYTES_OUT || !may) return complain(s, "fmi3GetBinary");
    if (s->rule == 5) {
        s->given = s->state == EVENT;
        value[0] = s->relayed, size[0] = s->relayed_size;
        return OK;
    }
    if (s->rule == 6) s->bytes[0] = (unsigned char)s->count[FIRE], s->size = 1;
    value[0] = s->bytes, size[0] = s->size;
    return OK;
}
EXPORT int fmi3SetBinary(Clocked *s, const uint32_t vr[], size_t n, const size_t size[], const unsigned char *const value[], size_t n_values) {
    ALLOWED(s, "fmi3SetBinary", SETTABLE);
    if (n != 1 || n_values != 1 || vr[0] != BYTES_IN || size[0] > sizeof s->bytes || (s->state > INITIALIZATION && !open(s))) return complain(s, "fmi3SetBinary");
    if (s->given) return complain(s, "bytes_in was set behind an output");
    memcpy(s->bytes, value[0], size[0]);
    s->size = size[0];
    return OK;
}

STATES(Clocked)
EXPORT int fmi3SerializedFMUStateSize(Clocked *s, const void *state, size_t *size) {
    (void)state;
    *size = sizeof *s;
    return OK;
}
EXPORT int fmi3SerializeFMUState(Clocked *s, const void *state, uint8_t bytes[], size_t size) {
    (void)s;
    memcpy(bytes, state, size);
    return OK;
}
EXPORT int fmi3DeserializeFMUState(Clocked *s, const uint8_t bytes[], size_t size, void **state) {
    Clocked *made = malloc(sizeof *s);
    memcpy(made, bytes, size);
    made->environment = s->environment, made->logger = s->logger;
    *state = made;
    return OK;
}
