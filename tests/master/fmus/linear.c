/* A linear FMI 2.0 co-simulation FMU with a closed-form solution, for tests of masters: what is wrong is the coupling.

   Real: 0 u (input), 1 y (output), 2 x0, 3 v0, 4 w2, 5 gain, 6 rate (fixed parameters), 7 v (output: the mass's speed). Integer: 0 n (output: steps).
   rate > 0: a lag, y' = rate (gain u - y), y(0) = x0; rate 0: a mass, y'' = w2 (gain u - y), y(0) = x0, y'(0) = v0.
   rate < 0: a gain without memory, y = x0 + gain u, at the end of a step.
   u is what was set, or goes on from there with the derivative that was set.
   $LINEAR_LIMIT: fmi2DoStep discards longer steps. $LINEAR_MAXIMUM: what fmi2GetMaxStepSize answers. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { U, Y, X0, V0, W2, GAIN, RATE, REALS };
typedef struct {
    double real[REALS], v, slope;
    int n;
} Linear;

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                             int visible, int debug) {
    (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)debug;
    return calloc(1, sizeof(Linear));
}
EXPORT void fmi2FreeInstance(Linear *p) { free(p); }
EXPORT int fmi2SetupExperiment(Linear *p, int a, double b, double c, int d, double e) {
    (void)p, (void)a, (void)b, (void)c, (void)d, (void)e;
    return 0;
}
EXPORT int fmi2EnterInitializationMode(Linear *p) {
    p->real[Y] = p->real[X0];
    p->v = p->real[V0];
    return 0;
}
EXPORT int fmi2ExitInitializationMode(Linear *p) { return (void)p, 0; }
EXPORT int fmi2Terminate(Linear *p) { return (void)p, 0; }

EXPORT int fmi2DoStep(Linear *p, double t, double h, int final) {
    (void)t, (void)final;
    const char *limit = getenv("LINEAR_LIMIT");
    if (limit && h > atof(limit) * (1 + 1e-9)) return 2;
    double *r = p->real, g = r[GAIN], s = p->slope;
    if (r[RATE] < 0) {
        r[Y] = r[X0] + g * (r[U] + s * h);
    } else if (r[RATE] > 0) {
        double first = g * r[U] - g * s / r[RATE], last = first + g * s * h;
        r[Y] = last + (r[Y] - first) * exp(-r[RATE] * h);
    } else {
        double w = sqrt(r[W2]), x = r[Y] - g * r[U], v = p->v - g * s;
        r[Y] = g * (r[U] + s * h) + x * cos(w * h) + v / w * sin(w * h);
        p->v = g * s - x * w * sin(w * h) + v * cos(w * h);
    }
    p->slope = 0.0;
    p->n++;
    return 0;
}

EXPORT int fmi2GetMaxStepSize(Linear *p, double *size) {
    const char *limit = getenv("LINEAR_MAXIMUM");
    (void)p;
    *size = limit ? atof(limit) : 0.0;
    return limit ? 0 : 3;
}

EXPORT int fmi2SetReal(Linear *p, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++) p->real[vr[i]] = value[i];
    return 0;
}
EXPORT int fmi2SetRealInputDerivatives(Linear *p, const unsigned vr[], size_t n, const int order[], const double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] != U || order[i] != 1) return 3;
        p->slope = value[i];
    }
    return 0;
}
EXPORT int fmi2GetReal(Linear *p, const unsigned vr[], size_t n, double value[]) {
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == REALS ? p->v : p->real[vr[i]];
    return 0;
}
EXPORT int fmi2GetInteger(Linear *p, const unsigned vr[], size_t n, int value[]) {
    (void)vr;
    for (size_t i = 0; i < n; i++) value[i] = p->n;
    return 0;
}

EXPORT int fmi2GetFMUstate(Linear *p, Linear **state) {
    if (!*state) *state = malloc(sizeof **state);
    **state = *p;
    return 0;
}
EXPORT int fmi2SetFMUstate(Linear *p, Linear *state) {
    *p = *state;
    return 0;
}
EXPORT int fmi2FreeFMUstate(Linear *p, Linear **state) {
    (void)p;
    free(*state);
    *state = NULL;
    return 0;
}
EXPORT int fmi2SerializedFMUstateSize(Linear *p, Linear *state, size_t *size) {
    (void)p, (void)state;
    *size = sizeof *state;
    return 0;
}
EXPORT int fmi2SerializeFMUstate(Linear *p, Linear *state, char bytes[], size_t size) {
    (void)p;
    memcpy(bytes, state, size);
    return 0;
}
EXPORT int fmi2DeSerializeFMUstate(Linear *p, const char bytes[], size_t size, Linear **state) {
    (void)p;
    *state = malloc(sizeof **state);
    memcpy(*state, bytes, size);
    return 0;
}
