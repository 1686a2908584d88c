/* Small hybrid models as FMUs, for tests of one FMU alone, of solvers and of events: -DMODEL=... -DFMI=1|2|3.

   FMI 2 and 3: Model Exchange and co-simulation; FMI 1: co-simulation (names begin with "Dynamic_"). In co-simulation
   explicit Euler steps of 1 ms, events handled at the end of the step in which they are found.
   Reals r[], Integers n[], Booleans b[] by value reference:

   DAHLQUIST  r0 x, r1 der(x) = -k x, r2 k
   VANDERPOL  r0 x, r1 y, r2 der(x) = y, r3 der(y) = mu (1 - x^2) y - x, r4 mu; directional derivatives, n3 how often they were asked for
   BALL       r0 h, r1 v, r2 der(h), r3 der(v) = g, r4 g, r5 e; n0 bounces; a state event at h = 0
   STAIR      n0 counter: one more each second, by time events; wants to end when it is 10
   DRIVE      r0 x, r1 der(x) = gain u + (on ? 10 : 0) + m, r2 u, r3 gain (tunable), r4 y = x + u; b0 on; n0 m,
              n1 m + (on ? 100 : 0) as of the last event, n2 step events (one whenever x passes a whole number); s0 text, s1 text + "!"

   What is not allowed in a mode of Model Exchange is an error. */

#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DAHLQUIST 1
#define VANDERPOL 2
#define BALL 3
#define STAIR 4
#define DRIVE 5
#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define REFUSED(name) EXPORT int name(void) { return ERROR; }

enum { OK, WARNING, DISCARD, ERROR, FATAL };
enum { INSTANTIATED = 1, INITIALIZING = 2, EVENT = 4, CONTINUOUS = 8, STEP = 16, TERMINATED = 32 };

#if MODEL == DAHLQUIST
enum { NX = 1, NZ = 0, DER = 1 };
#elif MODEL == VANDERPOL
enum { NX = 2, NZ = 0, DER = 2 };
#elif MODEL == BALL
enum { NX = 2, NZ = 1, DER = 2 };
#elif MODEL == STAIR
enum { NX = 0, NZ = 0, DER = 0 };
#else
enum { NX = 1, NZ = 0, DER = 1 };
#endif

typedef struct {
    int mode, step_events;
    double time, next, r[8], z, promised; /* promised: no state from before it is restored */
    int n[4];
    int b[1];
    char text[2][64];
    char name[64];
} Dynamic;

static int put_back(Dynamic *p, const Dynamic *state) {
    double promised = p->promised;
    if (state->time < promised - 1e-9) return ERROR;
    memcpy(p, state, sizeof *p);
    p->promised = promised;
    return OK;
}

static Dynamic *made(const char *name) {
    Dynamic *p = calloc(1, sizeof *p);
    snprintf(p->name, sizeof p->name, "%s", name);
    p->mode = INSTANTIATED;
    p->next = INFINITY, p->promised = -INFINITY;
#if MODEL == DAHLQUIST
    p->r[0] = 1, p->r[2] = 1;
#elif MODEL == VANDERPOL
    p->r[0] = 2, p->r[4] = 1;
#elif MODEL == BALL
    p->r[0] = 1, p->r[4] = -9.81, p->r[5] = 0.7;
#elif MODEL == DRIVE
    p->r[3] = 1;
#endif
    return p;
}

static void derivatives(Dynamic *p) {
#if MODEL == DAHLQUIST
    p->r[1] = -p->r[2] * p->r[0];
#elif MODEL == VANDERPOL
    p->r[2] = p->r[1];
    p->r[3] = p->r[4] * (1 - p->r[0] * p->r[0]) * p->r[1] - p->r[0];
#elif MODEL == BALL
    p->r[2] = p->r[1];
    p->r[3] = p->r[4];
#elif MODEL == DRIVE
    p->r[1] = p->r[3] * p->r[2] + (p->b[0] ? 10 : 0) + p->n[0];
    p->r[4] = p->r[0] + p->r[2];
    snprintf(p->text[1], sizeof p->text[1], "%.60s!", p->text[0]);
#endif
}

/* What happens at an event; true if states have changed. */
static bool event(Dynamic *p, bool *ends) {
    bool changed = false;
    *ends = false;
#if MODEL == BALL
    if (p->r[0] <= 0 && p->r[1] < 0) {
        p->r[0] = 0, p->r[1] = -p->r[5] * p->r[1], p->n[0]++;
        changed = true;
        if (p->r[1] < 0.01) p->r[1] = 0, p->r[4] = 0;
    }
#elif MODEL == STAIR
    if (p->next == INFINITY) p->next = p->time + 1;
    else if (p->time >= p->next) p->n[0]++, p->next += 1;
    *ends = p->n[0] >= 10;
#elif MODEL == DRIVE
    p->n[1] = p->n[0] + (p->b[0] ? 100 : 0);
    if (floor(p->r[0]) > p->step_events) p->step_events = (int)floor(p->r[0]), p->n[2]++;
#endif
    derivatives(p);
    return changed;
}

static double indicator(const Dynamic *p) { /* of the ball: not 0 while it lies on the ground */
    return MODEL == BALL ? (p->r[0] == 0 && p->r[1] == 0 ? 1 : p->r[0] == 0 && p->r[1] > 0 ? 1e-12 : p->r[0]) : 1;
}

/* Co-simulation: explicit Euler; false if the simulation ends. */
static bool advance(Dynamic *p, double t, double h) {
    long steps = lround(h / 1e-3);
    bool ends = false;
    if (steps < 1) steps = 1;
    for (long i = 0; i < steps && !ends; i++) {
        derivatives(p);
        for (int j = 0; j < NX; j++) p->r[j] += h / steps * p->r[DER + j];
        p->time = t + h * (i + 1) / steps;
        event(p, &ends);
    }
    return !ends;
}

#define VALUES(T, member, limit, WRITABLE)                                                                              \
    static int set_##member(Dynamic *p, const uint32_t *vr, size_t n, const T *v) {                                     \
        for (size_t i = 0; i < n; i++) {                                                                                \
            if (vr[i] >= limit) return ERROR;                                                                           \
            if (!(WRITABLE)) return ERROR;                                                                              \
            p->member[vr[i]] = v[i];                                                                                    \
        }                                                                                                               \
        return OK;                                                                                                      \
    }                                                                                                                   \
    static int get_##member(Dynamic *p, const uint32_t *vr, size_t n, T *v) {                                           \
        if (p->mode != INSTANTIATED) derivatives(p);                                                                    \
        for (size_t i = 0; i < n; i++) {                                                                                \
            if (vr[i] >= limit) return ERROR;                                                                           \
            v[i] = (T)p->member[vr[i]];                                                                                 \
        }                                                                                                               \
        return OK;                                                                                                      \
    }
/* In continuous-time mode only continuous inputs may be set. */
VALUES(double, r, 8, p->mode != CONTINUOUS || (MODEL == DRIVE && vr[i] == 2))
VALUES(int, n, 4, p->mode != CONTINUOUS)

#if FMI == 1 /* -------------------------------------------------------------------------------------------------- */

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct { Logger logger; void *allocate, *release, *finished; } Callbacks;
EXPORT const char *Dynamic_fmiGetVersion(void) { return "1.0"; }
EXPORT const char *Dynamic_fmiGetTypesPlatform(void) { return "standard32"; }
EXPORT void *Dynamic_fmiInstantiateSlave(const char *name, const char *guid, const char *location, const char *mime, double timeout,
                                         char visible, char interactive, Callbacks callbacks, char logging) {
    (void)timeout, (void)visible, (void)interactive, (void)logging;
    (void)location;
    if (strcmp(guid, "dynamic") || strcmp(mime, "application/x-fmu-sharedlibrary")) {
        callbacks.logger(NULL, name, ERROR, "error", "wrong GUID %s", guid);
        return NULL;
    }
    return made(name);
}
EXPORT int Dynamic_fmiInitializeSlave(Dynamic *p, double start, char stops, double stop) {
    (void)stop;
    bool ends;
    (void)stops;
    if (p->mode != INSTANTIATED) return ERROR;
    p->time = start, p->mode = STEP;
    event(p, &ends);
    return OK;
}
EXPORT int Dynamic_fmiDoStep(Dynamic *p, double t, double h, char fresh) {
    if (p->mode != STEP || !fresh || h <= 0) return ERROR;
    if (!advance(p, t, h)) return DISCARD;
    return OK;
}
EXPORT int Dynamic_fmiGetRealStatus(Dynamic *p, int kind, double *value) { return kind == 2 ? (*value = p->time, OK) : DISCARD; }
EXPORT int Dynamic_fmiGetBooleanStatus(Dynamic *p, int kind, char *value) { return (void)p, (void)kind, (void)value, DISCARD; }
EXPORT int Dynamic_fmiTerminateSlave(Dynamic *p) { return p->mode == STEP ? (p->mode = TERMINATED, OK) : ERROR; }
EXPORT int Dynamic_fmiResetSlave(Dynamic *p) { return (void)p, ERROR; }
EXPORT void Dynamic_fmiFreeSlaveInstance(Dynamic *p) { free(p); }
EXPORT int Dynamic_fmiSetReal(Dynamic *p, const uint32_t *vr, size_t n, const double *v) { return set_r(p, vr, n, v); }
EXPORT int Dynamic_fmiGetReal(Dynamic *p, const uint32_t *vr, size_t n, double *v) { return get_r(p, vr, n, v); }
EXPORT int Dynamic_fmiSetInteger(Dynamic *p, const uint32_t *vr, size_t n, const int *v) { return set_n(p, vr, n, v); }
EXPORT int Dynamic_fmiGetInteger(Dynamic *p, const uint32_t *vr, size_t n, int *v) { return get_n(p, vr, n, v); }
EXPORT int Dynamic_fmiSetBoolean(Dynamic *p, const uint32_t *vr, size_t n, const char *v) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i]) return ERROR;
        p->b[0] = v[i];
    }
    return OK;
}
EXPORT int Dynamic_fmiGetBoolean(Dynamic *p, const uint32_t *vr, size_t n, char *v) {
    for (size_t i = 0; i < n; i++) v[i] = (char)p->b[vr[i]];
    return OK;
}
EXPORT int Dynamic_fmiSetString(Dynamic *p, const uint32_t *vr, size_t n, const char *const *v) {
    for (size_t i = 0; i < n; i++) snprintf(p->text[vr[i]], sizeof p->text[0], "%s", v[i]);
    return OK;
}
EXPORT int Dynamic_fmiGetString(Dynamic *p, const uint32_t *vr, size_t n, const char **v) {
    derivatives(p);
    for (size_t i = 0; i < n; i++) v[i] = p->text[vr[i]];
    return OK;
}

/* What FMPy wants to find. */
REFUSED(Dynamic_fmiCancelStep) REFUSED(Dynamic_fmiGetIntegerStatus) REFUSED(Dynamic_fmiGetRealOutputDerivatives)
REFUSED(Dynamic_fmiGetStatus) REFUSED(Dynamic_fmiGetStringStatus) REFUSED(Dynamic_fmiSetDebugLogging)
REFUSED(Dynamic_fmiSetRealInputDerivatives)

#elif FMI == 2 /* ------------------------------------------------------------------------------------------------ */

typedef struct { int again, ends, nominals, values, has_next; double next; } EventInfo;
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT void *fmi2Instantiate(const char *name, int kind, const char *guid, const char *resources, const void *callbacks, int visible,
                             int logging) {
    (void)resources, (void)callbacks, (void)visible, (void)logging;
    if (strcmp(guid, "dynamic")) return NULL;
    Dynamic *p = made(name);
    p->z = kind;
    return p;
}
#define ME(p) ((p)->z == 0)
EXPORT void fmi2FreeInstance(Dynamic *p) { free(p); }
EXPORT int fmi2SetDebugLogging(Dynamic *p, int on, size_t n, const char *const *c) { return (void)p, (void)on, (void)n, (void)c, OK; }
EXPORT int fmi2SetupExperiment(Dynamic *p, int a, double b, double start, int c, double d) {
    (void)a, (void)b, (void)c, (void)d;
    return p->mode == INSTANTIATED ? (p->time = start, OK) : ERROR;
}
EXPORT int fmi2EnterInitializationMode(Dynamic *p) { return p->mode == INSTANTIATED ? (p->mode = INITIALIZING, OK) : ERROR; }
EXPORT int fmi2ExitInitializationMode(Dynamic *p) {
    bool ends;
    if (p->mode != INITIALIZING) return ERROR;
    p->mode = ME(p) ? EVENT : STEP;
    if (!ME(p)) event(p, &ends);
    derivatives(p);
    return OK;
}
EXPORT int fmi2Terminate(Dynamic *p) { return p->mode & (EVENT | CONTINUOUS | STEP) ? (p->mode = TERMINATED, OK) : ERROR; }
EXPORT int fmi2Reset(Dynamic *p) { return (void)p, ERROR; }
EXPORT int fmi2SetReal(Dynamic *p, const uint32_t *vr, size_t n, const double *v) { return set_r(p, vr, n, v); }
EXPORT int fmi2GetReal(Dynamic *p, const uint32_t *vr, size_t n, double *v) { return get_r(p, vr, n, v); }
EXPORT int fmi2SetInteger(Dynamic *p, const uint32_t *vr, size_t n, const int *v) { return set_n(p, vr, n, v); }
EXPORT int fmi2GetInteger(Dynamic *p, const uint32_t *vr, size_t n, int *v) { return get_n(p, vr, n, v); }
EXPORT int fmi2SetBoolean(Dynamic *p, const uint32_t *vr, size_t n, const int *v) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] || p->mode == CONTINUOUS) return ERROR;
        p->b[0] = v[i];
    }
    return OK;
}
EXPORT int fmi2GetBoolean(Dynamic *p, const uint32_t *vr, size_t n, int *v) {
    for (size_t i = 0; i < n; i++) v[i] = p->b[vr[i]];
    return OK;
}
EXPORT int fmi2SetString(Dynamic *p, const uint32_t *vr, size_t n, const char *const *v) {
    if (p->mode == CONTINUOUS) return ERROR;
    for (size_t i = 0; i < n; i++) snprintf(p->text[vr[i]], sizeof p->text[0], "%s", v[i]);
    return OK;
}
EXPORT int fmi2GetString(Dynamic *p, const uint32_t *vr, size_t n, const char **v) {
    derivatives(p);
    for (size_t i = 0; i < n; i++) v[i] = p->text[vr[i]];
    return OK;
}
EXPORT int fmi2DoStep(Dynamic *p, double t, double h, int fresh) {
    (void)fresh;
    return p->mode != STEP ? ERROR : advance(p, t, h) ? OK : DISCARD;
}
EXPORT int fmi2GetBooleanStatus(Dynamic *p, int kind, int *value) { return (void)p, kind == 3 ? (*value = 1, OK) : DISCARD; }
EXPORT int fmi2GetRealStatus(Dynamic *p, int kind, double *value) { return kind == 2 ? (*value = p->time, OK) : DISCARD; }
/* Model Exchange */
EXPORT int fmi2EnterEventMode(Dynamic *p) { return p->mode & (EVENT | CONTINUOUS) ? (p->mode = EVENT, OK) : ERROR; }
EXPORT int fmi2NewDiscreteStates(Dynamic *p, EventInfo *info) {
    bool ends;
    if (p->mode != EVENT) return ERROR;
    memset(info, 0, sizeof *info);
    info->values = event(p, &ends);
    info->ends = ends;
    info->has_next = isfinite(p->next);
    info->next = p->next;
    return OK;
}
EXPORT int fmi2EnterContinuousTimeMode(Dynamic *p) { return p->mode == EVENT ? (p->mode = CONTINUOUS, OK) : ERROR; }
EXPORT int fmi2CompletedIntegratorStep(Dynamic *p, int no_set, int *enter_event, int *ends) {
    if (no_set) p->promised = p->time;
    *ends = 0;
    *enter_event = MODEL == DRIVE && floor(p->r[0]) > p->step_events;
    return p->mode == CONTINUOUS ? OK : ERROR;
}
/* As FMUs of Dymola: in Continuous-Time Mode only. */
EXPORT int fmi2SetTime(Dynamic *p, double t) { return p->mode == CONTINUOUS ? (p->time = t, OK) : ERROR; }
EXPORT int fmi2SetContinuousStates(Dynamic *p, const double *x, size_t n) {
    if (n != NX || p->mode != CONTINUOUS) return ERROR;
    for (size_t i = 0; i < n; i++) p->r[i] = x[i];
    return OK;
}
EXPORT int fmi2GetContinuousStates(Dynamic *p, double *x, size_t n) {
    for (size_t i = 0; i < n; i++) x[i] = p->r[i];
    return n == NX ? OK : ERROR;
}
EXPORT int fmi2GetDerivatives(Dynamic *p, double *dx, size_t n) {
    derivatives(p);
    for (size_t i = 0; i < n; i++) {
        if (isnan(p->r[DER + i])) return DISCARD;
        dx[i] = p->r[DER + i];
    }
    return n == NX ? OK : ERROR;
}
EXPORT int fmi2GetEventIndicators(Dynamic *p, double *z, size_t n) {
    if (n) z[0] = indicator(p);
    return n == NZ ? OK : ERROR;
}
EXPORT int fmi2GetNominalsOfContinuousStates(Dynamic *p, double *x, size_t n) {
    (void)p;
    for (size_t i = 0; i < n; i++) x[i] = 1;
    return n == NX ? OK : ERROR;
}
EXPORT int fmi2GetFMUstate(Dynamic *p, void **state) {
    if (!*state) *state = malloc(sizeof *p);
    memcpy(*state, p, sizeof *p);
    return OK;
}
EXPORT int fmi2SetFMUstate(Dynamic *p, const void *state) { return put_back(p, state); }
EXPORT int fmi2FreeFMUstate(Dynamic *p, void **state) { return (void)p, free(*state), *state = NULL, OK; }
EXPORT int fmi2SerializedFMUstateSize(Dynamic *p, void *state, size_t *n) { return (void)state, *n = sizeof *p, OK; }
EXPORT int fmi2SerializeFMUstate(Dynamic *p, void *state, char *bytes, size_t n) {
    return n == sizeof *p ? (memcpy(bytes, state, n), OK) : ERROR;
}
EXPORT int fmi2DeSerializeFMUstate(Dynamic *p, const char *bytes, size_t n, void **state) {
    if (n != sizeof *p) return ERROR;
    *state = memcpy(malloc(n), bytes, n);
    return OK;
}
EXPORT int fmi2GetDirectionalDerivative(Dynamic *p, const uint32_t *z, size_t nz, const uint32_t *v, size_t nv, const double *dv,
                                        double *dz) {
#if MODEL == VANDERPOL
    double j[2][2] = {{0, 1}, {-2 * p->r[4] * p->r[0] * p->r[1] - 1, p->r[4] * (1 - p->r[0] * p->r[0])}};
    for (size_t i = 0; i < nz; i++) {
        if (z[i] < 2 || z[i] > 3) return ERROR;
        dz[i] = 0;
        for (size_t k = 0; k < nv; k++) dz[i] += j[z[i] - 2][v[k]] * dv[k];
    }
    p->n[3]++; /* so that tests see that it is used */
    return OK;
#else
    return (void)p, (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz, ERROR;
#endif
}

/* What FMPy wants to find. */
REFUSED(fmi2CancelStep) REFUSED(fmi2GetIntegerStatus) REFUSED(fmi2GetRealOutputDerivatives) REFUSED(fmi2GetStatus)
REFUSED(fmi2GetStringStatus) REFUSED(fmi2SetRealInputDerivatives)

#else /* FMI 3 ----------------------------------------------------------------------------------------------------- */

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                          void *environment, void *logger) {
    (void)resources, (void)visible, (void)logging, (void)environment, (void)logger;
    return strcmp(token, "dynamic") ? NULL : made(name);
}
EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                         bool events, bool early, const uint32_t required[], size_t n, void *environment,
                                         void *logger, void *intermediate) {
    (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)required, (void)n, (void)environment;
    (void)logger, (void)intermediate;
    if (strcmp(token, "dynamic")) return NULL;
    Dynamic *p = made(name);
    p->z = 1;
    return p;
}
#define ME(p) ((p)->z == 0)
EXPORT void fmi3FreeInstance(Dynamic *p) { free(p); }
EXPORT int fmi3SetDebugLogging(Dynamic *p, bool on, size_t n, const char *const *c) { return (void)p, (void)on, (void)n, (void)c, OK; }
EXPORT int fmi3EnterInitializationMode(Dynamic *p, bool a, double b, double start, bool c, double d) {
    (void)a, (void)b, (void)c, (void)d;
    return p->mode == INSTANTIATED ? (p->mode = INITIALIZING, p->time = start, OK) : ERROR;
}
EXPORT int fmi3ExitInitializationMode(Dynamic *p) {
    bool ends;
    if (p->mode != INITIALIZING) return ERROR;
    p->mode = ME(p) ? EVENT : STEP;
    if (!ME(p)) event(p, &ends);
    derivatives(p);
    return OK;
}
EXPORT int fmi3Terminate(Dynamic *p) { return p->mode & (EVENT | CONTINUOUS | STEP) ? (p->mode = TERMINATED, OK) : ERROR; }
EXPORT int fmi3Reset(Dynamic *p) { return (void)p, ERROR; }
EXPORT int fmi3SetFloat64(Dynamic *p, const uint32_t *vr, size_t n, const double *v, size_t m) { return (void)m, set_r(p, vr, n, v); }
EXPORT int fmi3GetFloat64(Dynamic *p, const uint32_t *vr, size_t n, double *v, size_t m) {
    if (n == 1 && vr[0] == 9) return *v = p->time, OK;
    return (void)m, get_r(p, vr, n, v);
}
EXPORT int fmi3SetInt32(Dynamic *p, const uint32_t *vr, size_t n, const int *v, size_t m) {
    if (p->mode == CONTINUOUS) return ERROR;
    for (size_t i = 0; i < n; i++) p->n[vr[i] - 10] = v[i];
    return (void)m, OK;
}
EXPORT int fmi3GetInt32(Dynamic *p, const uint32_t *vr, size_t n, int *v, size_t m) {
    for (size_t i = 0; i < n; i++) v[i] = p->n[vr[i] - 10];
    return (void)m, OK;
}
EXPORT int fmi3SetBoolean(Dynamic *p, const uint32_t *vr, size_t n, const bool *v, size_t m) {
    if (p->mode == CONTINUOUS) return ERROR;
    for (size_t i = 0; i < n; i++) p->b[vr[i] - 20] = v[i];
    return (void)m, OK;
}
EXPORT int fmi3GetBoolean(Dynamic *p, const uint32_t *vr, size_t n, bool *v, size_t m) {
    for (size_t i = 0; i < n; i++) v[i] = p->b[vr[i] - 20];
    return (void)m, OK;
}
EXPORT int fmi3SetString(Dynamic *p, const uint32_t *vr, size_t n, const char *const *v, size_t m) {
    if (p->mode == CONTINUOUS) return ERROR;
    for (size_t i = 0; i < n; i++) snprintf(p->text[vr[i] - 30], sizeof p->text[0], "%s", v[i]);
    return (void)m, OK;
}
EXPORT int fmi3GetString(Dynamic *p, const uint32_t *vr, size_t n, const char **v, size_t m) {
    derivatives(p);
    for (size_t i = 0; i < n; i++) v[i] = p->text[vr[i] - 30];
    return (void)m, OK;
}
EXPORT int fmi3DoStep(Dynamic *p, double t, double h, bool final, bool *event_needed, bool *ends, bool *early, double *last) {
    (void)final;
    if (p->mode != STEP) return ERROR;
    *event_needed = *early = false;
    *ends = !advance(p, t, h);
    *last = p->time;
    return OK;
}
EXPORT int fmi3EnterEventMode(Dynamic *p) { return p->mode & (EVENT | CONTINUOUS) ? (p->mode = EVENT, OK) : ERROR; }
EXPORT int fmi3UpdateDiscreteStates(Dynamic *p, bool *again, bool *ends, bool *nominals, bool *values, bool *has_next, double *next) {
    if (p->mode != EVENT) return ERROR;
    *again = *nominals = false;
    *values = event(p, ends);
    *has_next = isfinite(p->next);
    *next = p->next;
    return OK;
}
EXPORT int fmi3EnterContinuousTimeMode(Dynamic *p) { return p->mode == EVENT ? (p->mode = CONTINUOUS, OK) : ERROR; }
EXPORT int fmi3CompletedIntegratorStep(Dynamic *p, bool no_set, bool *enter_event, bool *ends) {
    if (no_set) p->promised = p->time;
    *ends = false;
    *enter_event = MODEL == DRIVE && floor(p->r[0]) > p->step_events;
    return p->mode == CONTINUOUS ? OK : ERROR;
}
EXPORT int fmi3SetTime(Dynamic *p, double t) { return p->mode & (EVENT | CONTINUOUS) ? (p->time = t, OK) : ERROR; }
EXPORT int fmi3SetContinuousStates(Dynamic *p, const double *x, size_t n) {
    if (n != NX || p->mode != CONTINUOUS) return ERROR;
    for (size_t i = 0; i < n; i++) p->r[i] = x[i];
    return OK;
}
EXPORT int fmi3GetContinuousStates(Dynamic *p, double *x, size_t n) {
    for (size_t i = 0; i < n; i++) x[i] = p->r[i];
    return n == NX ? OK : ERROR;
}
EXPORT int fmi3GetContinuousStateDerivatives(Dynamic *p, double *dx, size_t n) {
    derivatives(p);
    for (size_t i = 0; i < n; i++) dx[i] = p->r[DER + i];
    return n == NX ? OK : ERROR;
}
EXPORT int fmi3GetEventIndicators(Dynamic *p, double *z, size_t n) {
    if (n) z[0] = indicator(p);
    return n == NZ ? OK : ERROR;
}
EXPORT int fmi3GetNominalsOfContinuousStates(Dynamic *p, double *x, size_t n) {
    (void)p;
    for (size_t i = 0; i < n; i++) x[i] = 1;
    return n == NX ? OK : ERROR;
}
EXPORT int fmi3GetNumberOfContinuousStates(Dynamic *p, size_t *n) { return (void)p, *n = NX, OK; }
EXPORT int fmi3GetNumberOfEventIndicators(Dynamic *p, size_t *n) { return (void)p, *n = NZ, OK; }
EXPORT int fmi3GetFMUState(Dynamic *p, void **state) {
    if (!*state) *state = malloc(sizeof *p);
    memcpy(*state, p, sizeof *p);
    return OK;
}
EXPORT int fmi3SetFMUState(Dynamic *p, const void *state) { return put_back(p, state); }
EXPORT int fmi3FreeFMUState(Dynamic *p, void **state) { return (void)p, free(*state), *state = NULL, OK; }
EXPORT int fmi3SerializedFMUStateSize(Dynamic *p, void *state, size_t *n) { return (void)state, *n = sizeof *p, OK; }
EXPORT int fmi3SerializeFMUState(Dynamic *p, void *state, char *bytes, size_t n) {
    return n == sizeof *p ? (memcpy(bytes, state, n), OK) : ERROR;
}
EXPORT int fmi3DeserializeFMUState(Dynamic *p, const char *bytes, size_t n, void **state) {
    if (n != sizeof *p) return ERROR;
    *state = memcpy(malloc(n), bytes, n);
    return OK;
}
EXPORT int fmi3GetDirectionalDerivative(Dynamic *p, const uint32_t *z, size_t nz, const uint32_t *v, size_t nv, const double *dv,
                                        size_t n_seed, double *dz, size_t n_result) {
    (void)n_seed, (void)n_result;
#if MODEL == VANDERPOL
    double j[2][2] = {{0, 1}, {-2 * p->r[4] * p->r[0] * p->r[1] - 1, p->r[4] * (1 - p->r[0] * p->r[0])}};
    for (size_t i = 0; i < nz; i++) {
        if (z[i] < 2 || z[i] > 3) return ERROR;
        dz[i] = 0;
        for (size_t k = 0; k < nv; k++) dz[i] += j[z[i] - 2][v[k]] * dv[k];
    }
    p->n[3]++;
    return OK;
#else
    return (void)p, (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz, ERROR;
#endif
}
/* What FMPy wants to find. */
REFUSED(fmi3ActivateModelPartition) REFUSED(fmi3EnterConfigurationMode) REFUSED(fmi3EnterStepMode)
REFUSED(fmi3EvaluateDiscreteStates) REFUSED(fmi3ExitConfigurationMode) REFUSED(fmi3GetAdjointDerivative)
REFUSED(fmi3GetBinary) REFUSED(fmi3GetClock) REFUSED(fmi3GetFloat32) REFUSED(fmi3GetInt16) REFUSED(fmi3GetInt64)
REFUSED(fmi3GetInt8) REFUSED(fmi3GetIntervalDecimal) REFUSED(fmi3GetIntervalFraction)
REFUSED(fmi3GetNumberOfVariableDependencies) REFUSED(fmi3GetOutputDerivatives) REFUSED(fmi3GetShiftDecimal)
REFUSED(fmi3GetShiftFraction) REFUSED(fmi3GetUInt16) REFUSED(fmi3GetUInt32) REFUSED(fmi3GetUInt64)
REFUSED(fmi3GetUInt8) REFUSED(fmi3GetVariableDependencies) REFUSED(fmi3InstantiateScheduledExecution)
REFUSED(fmi3SetBinary) REFUSED(fmi3SetClock) REFUSED(fmi3SetFloat32) REFUSED(fmi3SetInt16) REFUSED(fmi3SetInt64)
REFUSED(fmi3SetInt8) REFUSED(fmi3SetIntervalDecimal) REFUSED(fmi3SetIntervalFraction) REFUSED(fmi3SetShiftDecimal)
REFUSED(fmi3SetShiftFraction) REFUSED(fmi3SetUInt16) REFUSED(fmi3SetUInt32) REFUSED(fmi3SetUInt64)
REFUSED(fmi3SetUInt8)
#endif
