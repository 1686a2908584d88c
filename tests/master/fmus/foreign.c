/* An FMI 2.0 co-simulation FMU with habits of FMUs that other tools export, for tests.

   Real: 0 u (input), 1 p (parameter, 5 by itself), 2 y (output: p), 3 t and 4 h (outputs: where its last step ended,
   and its size), 5 x (output: integral of u by explicit Euler), 6 silent (parameter: from that time on y is NaN).
   Integer: 0 n (output: steps done), 1 i (input), 2 j (output: i). Boolean: 0 b (input), 1 on (output: n is odd).

   The GUID says what becomes of parameters: "setup": they are initialized anew in fmi2SetupExperiment, as FMUs of 20-sim
   do; "enter": in fmi2EnterInitializationMode; "deaf": p stays 5 whatever is set;
   "mute": fmi2GetReal of p fails; "stern": so do all steps after that, as FMI 2.0.5 has it of an error (2.1.3). */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { U, P, Y, T, H, X, SILENT, REALS };
typedef struct {
    double real[REALS];
    int whole[3], truth[2];
    char habit[16];
} Foreign;

static void anew(Foreign *f) {
    f->real[P] = 5.0;
    f->real[SILENT] = 1e9;
}

static void show(Foreign *f) {
    f->real[Y] = f->real[T] < f->real[SILENT] - 1e-9 ? f->real[P] : NAN;
    f->truth[1] = f->whole[0] % 2;
    f->whole[2] = f->whole[1];
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
                             int visible, int debug) {
    (void)name, (void)type, (void)resources, (void)callbacks, (void)visible, (void)debug;
    Foreign *f = calloc(1, sizeof *f);
    strncpy(f->habit, guid, sizeof f->habit - 1);
    anew(f);
    return f;
}

EXPORT void fmi2FreeInstance(Foreign *f) { free(f); }

EXPORT int fmi2SetupExperiment(Foreign *f, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    f->real[T] = start;
    if (!strcmp(f->habit, "setup")) anew(f);
    return 0;
}

EXPORT int fmi2EnterInitializationMode(Foreign *f) {
    if (!strcmp(f->habit, "enter")) anew(f);
    return 0;
}

EXPORT int fmi2ExitInitializationMode(Foreign *f) {
    show(f);
    return 0;
}

EXPORT int fmi2DoStep(Foreign *f, double t, double h, int no_return) {
    (void)no_return;
    if (!strcmp(f->habit, "stuck")) return 3;
    f->real[X] += h * f->real[U];
    f->real[T] = t + h;
    f->real[H] = h;
    f->whole[0]++;
    show(f);
    return 0;
}

EXPORT int fmi2Terminate(Foreign *f) { return (void)f, 0; }

EXPORT int fmi2SetReal(Foreign *f, const unsigned vr[], size_t n, const double value[]) {
    for (size_t i = 0; i < n; i++)
        if (vr[i] != P || strcmp(f->habit, "deaf")) f->real[vr[i]] = value[i];
    return 0;
}

EXPORT int fmi2GetReal(Foreign *f, const unsigned vr[], size_t n, double value[]) {
    for (size_t i = 0; i < n; i++) {
        if (vr[i] == P && !strcmp(f->habit, "stern")) strcpy(f->habit, "stuck");
        if (vr[i] == P && (!strcmp(f->habit, "mute") || !strcmp(f->habit, "stuck"))) return 3; /* fmi2Error */
        value[i] = f->real[vr[i]];
    }
    return 0;
}

#define ACCESS(Kind, field)                                                                                            \
    EXPORT int fmi2Set##Kind(Foreign *f, const unsigned vr[], size_t n, const int value[]) {                           \
        for (size_t i = 0; i < n; i++) f->field[vr[i]] = value[i];                                                     \
        return 0;                                                                                                      \
    }                                                                                                                  \
    EXPORT int fmi2Get##Kind(Foreign *f, const unsigned vr[], size_t n, int value[]) {                                 \
        for (size_t i = 0; i < n; i++) value[i] = f->field[vr[i]];                                                     \
        return 0;                                                                                                      \
    }

ACCESS(Integer, whole)
ACCESS(Boolean, truth)

/* What FMPy looks for in every binary, and nobody calls. */
#define ABSENT(name)                                                                                                   \
    EXPORT int name(Foreign *f) { return (void)f, 3; }
ABSENT(fmi2SetDebugLogging)
ABSENT(fmi2Reset)
ABSENT(fmi2GetString)
ABSENT(fmi2SetString)
ABSENT(fmi2GetFMUstate)
ABSENT(fmi2SetFMUstate)
ABSENT(fmi2FreeFMUstate)
ABSENT(fmi2SerializedFMUstateSize)
ABSENT(fmi2SerializeFMUstate)
ABSENT(fmi2DeSerializeFMUstate)
ABSENT(fmi2GetDirectionalDerivative)
ABSENT(fmi2SetRealInputDerivatives)
ABSENT(fmi2GetRealOutputDerivatives)
ABSENT(fmi2CancelStep)
ABSENT(fmi2GetStatus)
ABSENT(fmi2GetRealStatus)
ABSENT(fmi2GetIntegerStatus)
ABSENT(fmi2GetBooleanStatus)
ABSENT(fmi2GetStringStatus)
