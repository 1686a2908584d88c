/* An FMI 2.0 co-simulation FMU for tests: it writes down every call, and fails where it is told to.

   y = u + p, m = n + 1, c = not b, r = s and "!", f = e: in initialization mode at once, later at the end of a step.
   `mode` and `when` (s) say what goes wrong: 1 to 4: doStep returns that status; 5: y is NaN; 6: doStep raises SIGINT, once;
   10: fmi2ExitInitializationMode fails; 11: abort() in fmi2FreeInstance; 12: fmi2Terminate fails; 13: the String
   output cannot be got after `when`; 14: abort(), 15: a write to nowhere, 16: hanging, in a step from `when` on. A GUID "none" is refused, "mute" without a word, "global" gets one handle for all. */

#include "observed.h"

#include <signal.h>
#ifndef _WIN32
#include <unistd.h>
#endif

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

enum { U, N, B, S, E, P, MODE, WHEN, Y, M, C, R, F, COUNT };

typedef struct {
    char name[256];
    Callbacks callbacks;
    double real[COUNT];
    int integer[COUNT];
    char text[COUNT][256];
    int initializing;
    double time;
} Probe;

#define say(p, format, ...) write_line("PROBE_LOG", "%s: " format, (p)->name, ##__VA_ARGS__)

static Probe only; /* the one instance of the GUID "global" */

static void compute(Probe *p) {
    p->real[Y] = p->real[U] + p->real[P];
    if (p->integer[MODE] == 5 && p->time >= p->real[WHEN]) p->real[Y] = NAN;
    p->integer[M] = p->integer[N] + 1;
    p->integer[C] = !p->integer[B];
    p->integer[F] = p->integer[E];
    snprintf(p->text[R], sizeof p->text[R], "%.250s!", p->text[S]);
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const Callbacks *callbacks,
                             int visible, int debug) {
    (void)type, (void)visible, (void)debug;
    if (!strcmp(guid, "mute")) return NULL;
    if (!strcmp(guid, "none")) {
        callbacks->logger(callbacks->environment, name, 3, NULL, "refused: 100%% of\nthe reasons");
        return NULL;
    }
    Probe *p = strcmp(guid, "global") ? calloc(1, sizeof *p) : &only;
    snprintf(p->name, sizeof p->name, "%s", name);
    p->callbacks = *callbacks;
    for (int i = 0; i < COUNT; i++) p->real[i] = NAN;
    say(p, "instantiate %s", strncmp(resources, "file:///", 8) ? "without a URI" : guid);
    return p;
}

EXPORT void fmi2FreeInstance(Probe *p) {
    say(p, "free");
    if (p->integer[MODE] == 11) abort();
    if (p != &only) free(p);
}

EXPORT int fmi2SetupExperiment(Probe *p, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance, (void)tolerance;
    p->time = start;
    say(p, "setup %g to %g%s", start, stop, has_stop ? "" : " or longer");
    return 0;
}

EXPORT int fmi2EnterInitializationMode(Probe *p) {
    p->initializing = 1;
    say(p, "enter");
    return 0;
}

EXPORT int fmi2ExitInitializationMode(Probe *p) {
    compute(p);
    p->initializing = 0;
    say(p, "exit");
    if (p->integer[MODE] == 10)
        p->callbacks.logger(p->callbacks.environment, p->name, 3, "logStatusError", "no way out");
    return p->integer[MODE] == 10 ? 3 : 0;
}

EXPORT int fmi2Terminate(Probe *p) {
    say(p, "terminate");
    return p->integer[MODE] == 12 ? 3 : 0;
}

EXPORT int fmi2DoStep(Probe *p, double t, double h, int no_return) {
    (void)no_return;
    say(p, "step %g + %g", t, h);
    int mode = t >= p->real[WHEN] - 1e-9 ? p->integer[MODE] : 0;
    if (mode == 6 && t <= p->real[WHEN] + 1e-9) raise(SIGINT);
    if (mode == 14) abort();
    if (mode == 16) for (;;) sleep(1); /* no return */
    if (mode == 15) *(volatile int *)(size_t)mode = 0;
    if (mode >= 1 && mode <= 4) {
        for (int i = 0; i < 50; i++)
            p->callbacks.logger(p->callbacks.environment, p->name, mode, "logStatusError", i == 49 ? "it is over" : "tired");
        return mode;
    }
    p->time = t + h;
    compute(p);
    return 0;
}

#define NAMES "unbsepxwymcrf"

#define ACCESS(Kind, type, field, format, shown)                                                                       \
    EXPORT int fmi2Set##Kind(Probe *p, const unsigned vr[], size_t n, const type value[]) {                            \
        for (size_t i = 0; i < n; i++) {                                                                               \
            field##_set(p, vr[i], value[i]);                                                                           \
            say(p, "set %c = " format, NAMES[vr[i]], shown);                                                           \
        }                                                                                                              \
        return 0;                                                                                                      \
    }                                                                                                                  \
    EXPORT int fmi2Get##Kind(Probe *p, const unsigned vr[], size_t n, type value[]) {                                  \
        if (p->initializing) compute(p);                                                                               \
        for (size_t i = 0; i < n; i++) {                                                                               \
            value[i] = p->field[vr[i]];                                                                                \
            say(p, "get %c", NAMES[vr[i]]);                                                                            \
            if (vr[i] == R && p->integer[MODE] == 13 && p->time >= p->real[WHEN]) return 3;                            \
        }                                                                                                              \
        return 0;                                                                                                      \
    }

static void real_set(Probe *p, unsigned vr, double value) { p->real[vr] = value; }
static void integer_set(Probe *p, unsigned vr, int value) { p->integer[vr] = value; }
static void text_set(Probe *p, unsigned vr, const char *value) { snprintf(p->text[vr], sizeof p->text[vr], "%s", value); }

ACCESS(Real, double, real, "%g", value[i])
ACCESS(Integer, int, integer, "%d", value[i])
ACCESS(Boolean, int, integer, "%s", value[i] ? "true" : "false")
typedef const char *Text;
ACCESS(String, Text, text, "\"%s\"", value[i])
