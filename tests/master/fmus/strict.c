/* A strict FMI 2.0 co-simulation FMU for tests: it holds every call against the state table of FMI 2.0.5 (section 4.2.4)
   and writes what is not allowed to the file $STRICT_LOG, a line each; with $STRICT_CALLS every call to that file.

   Real: 0 u (input), 1 p (tunable parameter), 2 y (output: integral of p * u), 3 when, 4 longest (fixed parameters).
   Integer: 0 mode (fixed parameter), 1 n (output: steps done). String: 0 s (input), 1 r (output: s and "!").
   Boolean: 0 b (input), 1 c (output: not b).

   mode, from t = `when` on: 1 steps longer than `longest` are discarded, without a last successful time; 2 with one;
   3 the step is discarded and the FMU wants to end, at `when`; 4 pending; 5 error; 6 fatal; 7 every step is discarded;
   9 fmi2Terminate fails; 10 fmi2SetFMUstate forgets y; 11 warnings everywhere;
   12 the step is done, and discarded since the FMU wants to end with it; 13 as 7, and the step before it is discarded as
   well once fmi2SetFMUstate has been called.
   At any time: 8 fmi2SetReal discards values above 100. */

#include "observed.h"

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

enum { INSTANTIATED = 1, INITIALIZING = 2, COMPLETE = 4, FAILED = 8, PENDING = 16, CANCELED = 32, TERMINATED = 64, ERROR = 128 };
static const char *const NAMES[] = {"instantiated", "initializationMode", "stepComplete", "stepFailed",
                                    "stepInProgress", "stepCanceled", "terminated", "error"};
enum { U, P, Y, WHEN, LONGEST, REALS };

typedef struct {
    double real[REALS], time;
    int mode, n, b;
    char s[256];
} Values;

typedef struct {
    char name[256];
    const Callbacks *callbacks;
    Callbacks copy;
    int again, state, states, was_set, fixed, has_stop, terminated;
    double start, stop, h, last, promised; /* promised: no state from before it is restored */
    char *text;
    Values v;
} Strict;

static int corrupted = 0; /* fmi2Fatal is for all instances */

#define line(variable, name, what, why) write_line(variable, "%s: %s%s", name, what, why)

/* Whether a call may be made at all; strings handed out before are spoilt by it. */
static int entered(Strict *p, const char *function, int states) {
    if (corrupted) {
        line("STRICT_LOG", p->name, function, " after fmi2Fatal");
        return 0;
    }
    if (p->text) memset(p->text, '#', strlen(p->text));
    line("STRICT_CALLS", p->name, function, "");
    if (memcmp(p->callbacks, &p->copy, sizeof p->copy)) line("STRICT_LOG", p->name, function, " with other callbacks");
    if (!(p->state & states)) {
        char why[64];
        int i = 0;
        while (p->state >> (i + 1)) i++;
        snprintf(why, sizeof why, " in state %s", NAMES[i]);
        line("STRICT_LOG", p->name, function, why);
        return 0;
    }
    return 1;
}

static int answer(const Strict *p) { return p->v.mode == 11 ? 1 : 0; }

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const Callbacks *callbacks,
                             int visible, int debug) {
    (void)visible, (void)debug;
    if (corrupted) line("STRICT_LOG", name, "fmi2Instantiate", " after fmi2Fatal");
    if (!name || !*name || type != 1 || !callbacks->logger || strncmp(resources, "file:///", 8))
        line("STRICT_LOG", name, "fmi2Instantiate", " with wrong arguments");
    Strict *p = calloc(1, sizeof *p);
    snprintf(p->name, sizeof p->name, "%s", name);
    p->callbacks = callbacks, p->copy = *callbacks;
    p->state = INSTANTIATED;
    p->fixed = !strcmp(guid, "fixed");
    for (int i = 0; i < REALS; i++) p->v.real[i] = NAN; /* start values are the master's business */
    p->v.real[Y] = 0.0;
    return p;
}

EXPORT void fmi2FreeInstance(Strict *p) {
    if (!entered(p, "fmi2FreeInstance", ~PENDING)) return;
    if (p->states && p->state != CANCELED) line("STRICT_LOG", p->name, "fmi2FreeInstance", " before fmi2FreeFMUstate");
    free(p->text);
    free(p);
}

EXPORT int fmi2SetDebugLogging(Strict *p, int on, size_t n, const char *const categories[]) {
    (void)on, (void)n, (void)categories;
    return entered(p, "fmi2SetDebugLogging", ~0) ? answer(p) : 3;
}

EXPORT int fmi2SetupExperiment(Strict *p, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance, (void)tolerance;
    if (!entered(p, "fmi2SetupExperiment", INSTANTIATED)) return 3;
    p->start = p->v.time = p->promised = start, p->has_stop = has_stop, p->stop = stop;
    return answer(p);
}

EXPORT int fmi2EnterInitializationMode(Strict *p) {
    if (!entered(p, "fmi2EnterInitializationMode", INSTANTIATED)) return 3;
    p->state = INITIALIZING;
    return answer(p);
}

EXPORT int fmi2ExitInitializationMode(Strict *p) {
    if (!entered(p, "fmi2ExitInitializationMode", INITIALIZING)) return 3;
    for (int i = 0; i < REALS; i++)
        if (isnan(p->v.real[i])) line("STRICT_LOG", p->name, "fmi2ExitInitializationMode", " with a start value not set");
    p->state = COMPLETE;
    p->was_set = 0;
    return answer(p);
}

EXPORT int fmi2Terminate(Strict *p) {
    if (!entered(p, "fmi2Terminate", COMPLETE | FAILED)) return 3;
    p->state = p->v.mode == 9 ? ERROR : TERMINATED;
    return p->v.mode == 9 ? 3 : answer(p);
}

EXPORT int fmi2DoStep(Strict *p, double t, double h, int no_return) {
    if (!entered(p, "fmi2DoStep", COMPLETE)) return 3;
    if (no_return) p->promised = t;
    char shown[80];
    snprintf(shown, sizeof shown, " %.12g + %.12g", t, h);
    line("STRICT_CALLS", p->name, "step", shown);
    if (t != p->v.time && fabs(t - p->v.time) > 1e-12 * fabs(t)) line("STRICT_LOG", p->name, "fmi2DoStep", " at another time");
    if (!(h > 0.0)) line("STRICT_LOG", p->name, "fmi2DoStep", " backwards");
    if (p->has_stop && t + h > p->stop + 1e-12) line("STRICT_LOG", p->name, "fmi2DoStep", " past the stop time");
    if (p->fixed && p->h && fabs(h - p->h) > 1e-12) line("STRICT_LOG", p->name, "fmi2DoStep", " of another size");
    p->h = h;
    p->was_set = 0;
    int mode = t + h > p->v.real[WHEN] + 1e-9 ? p->v.mode : 0;
    p->terminated = 0;
    p->last = t;
    if (p->again && p->v.mode == 13 && t > p->v.real[WHEN] - 1.5 * h) mode = 7;
    if (mode == 7 || mode == 13 || ((mode == 1 || mode == 2) && h > p->v.real[LONGEST] * (1 + 1e-9)) || mode == 3) {
        if (mode == 2) p->last = t + p->v.real[LONGEST];
        if (mode == 3) p->terminated = 1, p->last = p->v.real[WHEN];
        p->state = FAILED;
        return 2;
    }
    if (mode == 12) { /* it can do this step, and no other */
        p->v.real[Y] += h * p->v.real[P] * p->v.real[U];
        p->v.n++;
        p->terminated = 1, p->last = t + h;
        p->state = FAILED;
        return 2;
    }
    if (mode >= 4 && mode <= 6) {
        p->state = mode == 4 ? PENDING : ERROR;
        if (mode == 6) corrupted = 1;
        return mode == 4 ? 5 : mode == 5 ? 3 : 4;
    }
    p->v.real[Y] += h * p->v.real[P] * p->v.real[U];
    p->v.time = t + h;
    p->v.n++;
    return answer(p);
}

EXPORT int fmi2CancelStep(Strict *p) {
    if (!entered(p, "fmi2CancelStep", PENDING)) return 3;
    p->state = CANCELED;
    return 0;
}

#define SOME_STATUS(Kind, type)                                                                                        \
    EXPORT int fmi2Get##Kind##Status(Strict *p, int kind, type *value) {                                               \
        (void)kind, (void)value;                                                                                       \
        return entered(p, "fmi2Get" #Kind "Status", FAILED | PENDING) ? 2 : 3;                                         \
    }
SOME_STATUS(, int)
SOME_STATUS(Integer, int)
SOME_STATUS(String, const char *)

EXPORT int fmi2GetRealStatus(Strict *p, int kind, double *value) {
    if (!entered(p, "fmi2GetRealStatus", FAILED)) return 3;
    if (kind != 2 || p->v.mode == 1) return 2;
    *value = p->last;
    return 0;
}

EXPORT int fmi2GetBooleanStatus(Strict *p, int kind, int *value) {
    if (!entered(p, "fmi2GetBooleanStatus", FAILED)) return 3;
    if (kind != 3) return 2;
    *value = p->terminated;
    return 0;
}

/* Variables: which may be set when, and got when. */
static int may_set(Strict *p, const char *function, unsigned vr, int is_input, int is_tunable, int is_output) {
    if (!entered(p, function, INSTANTIATED | INITIALIZING | COMPLETE)) return 0;
    char why[80];
    int wrong = is_output || (p->state == INSTANTIATED && is_input) || (p->state == COMPLETE && !is_input && !is_tunable);
    snprintf(why, sizeof why, " of %u is not allowed then", vr);
    if (wrong) line("STRICT_LOG", p->name, function, why);
    p->was_set = 1;
    return !wrong;
}

static int may_get(Strict *p, const char *function, unsigned vr, int is_output) {
    if (!entered(p, function, INITIALIZING | COMPLETE | FAILED | TERMINATED | ERROR)) return 0;
    char why[80];
    snprintf(why, sizeof why, " of %u is not allowed then", vr);
    if (p->state == INITIALIZING && !is_output) line("STRICT_LOG", p->name, function, why);
    if (p->state == COMPLETE && p->was_set) line("STRICT_LOG", p->name, function, " after a set, without a step");
    return 1;
}

EXPORT int fmi2SetReal(Strict *p, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_set(p, "fmi2SetReal", vr[i], vr[i] == U, vr[i] == P, vr[i] == Y)) return 3;
        if (p->v.mode == 8 && value[i] > 100.0) return 2;
        p->v.real[vr[i]] = value[i];
    }
    return answer(p);
}
EXPORT int fmi2SetInteger(Strict *p, const unsigned vr[], size_t n, const int value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_set(p, "fmi2SetInteger", vr[i], 0, 0, vr[i] == 1)) return 3;
        p->v.mode = value[i];
    }
    return answer(p);
}
EXPORT int fmi2SetBoolean(Strict *p, const unsigned vr[], size_t n, const int value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_set(p, "fmi2SetBoolean", vr[i], vr[i] == 0, 0, vr[i] == 1)) return 3;
        p->v.b = value[i];
    }
    return answer(p);
}
EXPORT int fmi2SetString(Strict *p, const unsigned vr[], size_t n, const char *const value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_set(p, "fmi2SetString", vr[i], vr[i] == 0, 0, vr[i] == 1)) return 3;
        snprintf(p->v.s, sizeof p->v.s, "%s", value[i]);
    }
    return answer(p);
}

EXPORT int fmi2GetReal(Strict *p, const unsigned vr[], size_t n, double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_get(p, "fmi2GetReal", vr[i], vr[i] == Y)) return 3;
        value[i] = p->v.real[vr[i]];
    }
    return answer(p);
}
EXPORT int fmi2GetInteger(Strict *p, const unsigned vr[], size_t n, int value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_get(p, "fmi2GetInteger", vr[i], vr[i] == 1)) return 3;
        value[i] = vr[i] ? p->v.n : p->v.mode;
    }
    return answer(p);
}
EXPORT int fmi2GetBoolean(Strict *p, const unsigned vr[], size_t n, int value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_get(p, "fmi2GetBoolean", vr[i], vr[i] == 1)) return 3;
        value[i] = vr[i] ? !p->v.b : p->v.b;
    }
    return answer(p);
}
EXPORT int fmi2GetString(Strict *p, const unsigned vr[], size_t n, const char *value[]) {
    for (size_t i = 0; i < n; i++) {
        if (!may_get(p, "fmi2GetString", vr[i], vr[i] == 1)) return 3;
        free(p->text);
        p->text = malloc(sizeof p->v.s + 2);
        sprintf(p->text, "%s!", p->v.s);
        value[i] = p->text;
    }
    return answer(p);
}

typedef struct {
    Strict *owner;
    Values v;
    int state;
} Saved;

EXPORT int fmi2GetFMUstate(Strict *p, Saved **saved) {
    if (!entered(p, "fmi2GetFMUstate", ~(PENDING | CANCELED | ERROR))) return 3;
    if (*saved && (*saved)->owner != p) line("STRICT_LOG", p->name, "fmi2GetFMUstate", " into another's state");
    if (!*saved) *saved = calloc(1, sizeof **saved), p->states++;
    (*saved)->owner = p, (*saved)->v = p->v, (*saved)->state = p->state;
    return answer(p);
}
EXPORT int fmi2SetFMUstate(Strict *p, Saved *saved) {
    if (!entered(p, "fmi2SetFMUstate", ~(PENDING | CANCELED))) return 3;
    if (!saved || saved->owner != p) line("STRICT_LOG", p->name, "fmi2SetFMUstate", " of another's state");
    if (saved->v.time < p->promised - 1e-9) line("STRICT_LOG", p->name, "fmi2SetFMUstate", " although promised not to go back");
    double y = p->v.real[Y];
    p->v = saved->v, p->state = saved->state;
    if (p->v.mode == 10) p->v.real[Y] = y;
    if (p->v.mode == 13) p->again = 1;
    p->was_set = 0;
    return answer(p);
}
EXPORT int fmi2FreeFMUstate(Strict *p, Saved **saved) {
    if (!entered(p, "fmi2FreeFMUstate", ~(PENDING | CANCELED))) return 3;
    if (*saved) p->states--;
    free(*saved);
    *saved = NULL;
    return answer(p);
}
