/* A bouncing ball as an FMI 3.0 co-simulation FMU with Event Mode, in closed form, for tests of masters.

   Float64: 0 height, 1 speed, 2 last (time at which the master let it handle its last impact), 5 e (fixed parameter:
   restitution); Int32: 3 bounces, 4 announced (fixed parameter: 1 the next impact is announced as nextEventTime, 0 it is
   found out in fmi3DoStep, which returns early). g = 9.81 m/s2, it starts at rest 1 m above the ground. */

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define G 9.81
typedef struct {
    double time, from, height, speed, e, last; /* in free flight from `from` with height and speed */
    int32_t bounces, announced;
} Ball;

static double height(const Ball *p, double t) { return p->height + p->speed * (t - p->from) - G / 2 * (t - p->from) * (t - p->from); }
static double speed(const Ball *p, double t) { return p->speed - G * (t - p->from); }
static double impact(const Ball *p) { return p->from + (p->speed + sqrt(p->speed * p->speed + 2 * G * fmax(p->height, 0))) / G; }

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                         bool events, bool early, const uint32_t required[], size_t n, void *environment,
                                         void *logger, void *intermediate) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)required, (void)n, (void)environment;
    (void)logger, (void)intermediate;
    Ball *p = calloc(1, sizeof *p);
    p->height = 1.0;
    return events && early ? p : NULL;
}
EXPORT void fmi3FreeInstance(Ball *p) { free(p); }
EXPORT int fmi3EnterInitializationMode(Ball *p, bool a, double b, double start, bool c, double d) {
    (void)a, (void)b, (void)c, (void)d;
    p->time = p->from = start;
    return 0;
}
EXPORT int fmi3ExitInitializationMode(Ball *p) { return (void)p, 0; }
EXPORT int fmi3EnterEventMode(Ball *p) { return (void)p, 0; }
EXPORT int fmi3EnterStepMode(Ball *p) { return (void)p, 0; }
EXPORT int fmi3Terminate(Ball *p) { return (void)p, 0; }

EXPORT int fmi3UpdateDiscreteStates(Ball *p, bool *again, bool *ends, bool *nominals, bool *values, bool *has_next, double *next) {
    *again = *ends = *nominals = *values = false;
    if (p->time > p->from && fabs(p->time - impact(p)) < 1e-6) {
        double v = -p->e * speed(p, p->time);
        p->height = height(p, p->time), p->speed = v, p->from = p->last = p->time;
        p->bounces++;
    }
    *has_next = p->announced;
    *next = impact(p);
    return 0;
}

EXPORT int fmi3DoStep(Ball *p, double t, double h, bool final, bool *event, bool *ends, bool *early, double *last) {
    (void)final;
    double end = t + h;
    *event = *ends = *early = false;
    if (!p->announced && impact(p) <= end) *event = true, *early = impact(p) < end, end = impact(p);
    p->time = *last = end;
    return 0;
}

EXPORT int fmi3GetFloat64(Ball *p, const uint32_t vr[], size_t n, double value[], size_t m) {
    (void)m;
    for (size_t i = 0; i < n; i++)
        value[i] = vr[i] == 0 ? height(p, p->time) : vr[i] == 1 ? speed(p, p->time) : vr[i] == 2 ? p->last : p->e;
    return 0;
}
EXPORT int fmi3SetFloat64(Ball *p, const uint32_t vr[], size_t n, const double value[], size_t m) {
    (void)m;
    for (size_t i = 0; i < n; i++)
        if (vr[i] == 5) p->e = value[i];
    return 0;
}
EXPORT int fmi3GetInt32(Ball *p, const uint32_t vr[], size_t n, int32_t value[], size_t m) {
    (void)m;
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == 3 ? p->bounces : p->announced;
    return 0;
}
EXPORT int fmi3SetInt32(Ball *p, const uint32_t vr[], size_t n, const int32_t value[], size_t m) {
    (void)m;
    for (size_t i = 0; i < n; i++)
        if (vr[i] == 4) p->announced = value[i];
    return 0;
}

EXPORT int fmi3GetFMUState(Ball *p, Ball **state) {
    if (!*state) *state = malloc(sizeof **state);
    **state = *p;
    return 0;
}
EXPORT int fmi3SetFMUState(Ball *p, Ball *state) {
    *p = *state;
    return 0;
}
EXPORT int fmi3FreeFMUState(Ball *p, Ball **state) {
    (void)p;
    free(*state);
    *state = NULL;
    return 0;
}
EXPORT int fmi3SerializedFMUStateSize(Ball *p, Ball *state, size_t *size) {
    (void)p, (void)state;
    *size = sizeof *state;
    return 0;
}
EXPORT int fmi3SerializeFMUState(Ball *p, Ball *state, uint8_t bytes[], size_t size) {
    (void)p, (void)size;
    *(Ball *)bytes = *state;
    return 0;
}
EXPORT int fmi3DeserializeFMUState(Ball *p, const uint8_t bytes[], size_t size, Ball **state) {
    (void)p, (void)size;
    *state = malloc(sizeof **state);
    **state = *(const Ball *)bytes;
    return 0;
}
