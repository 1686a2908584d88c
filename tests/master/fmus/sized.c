/* An FMI 3.0 co-simulation FMU whose arrays are sized by structural parameters, for tests.

   n and m (UInt64, fixed and tunable): u[n] -> y[n] = 2u, at the end of a step; p[n][m] (Int32 parameters) -> sums[n], over rows;
   s[n] (String) -> t[n]. A size of 0 is one for m, and for n if the FMU is instantiated as "empty...". doubled (Boolean, a structural parameter, too): y is 4u. It counts from zero again when it is resized: all values are 0 then.
   What is not allowed is written to the file that STRICT3_LOG names. */

#include "fmi3_fmu.h"

enum { INSTANTIATED = 1, CONFIGURATION = 2, INITIALIZATION = 4, STEP = 8, TERMINATED = 16 };
enum { N, M, U, Y, P, SUMS, S, T, DOUBLED, MOST = 16 };

typedef struct {
    INSTANCE;
    uint64_t n, m;
    bool doubled;
    double u[MOST], y[MOST];
    int32_t p[MOST * MOST], sums[MOST];
    char s[MOST][32], t[MOST][32];
} Sized;

static void compute(Sized *z) {
    for (uint64_t i = 0; i < z->n; i++) {
        z->y[i] = (z->doubled ? 4 : 2) * z->u[i];
        z->sums[i] = 0;
        for (uint64_t j = 0; j < z->m; j++) z->sums[i] += z->p[i * z->m + j];
        memcpy(z->t[i], z->s[i], sizeof z->t[i]);
    }
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                         bool event_mode, bool early, const uint32_t needed[], size_t n_needed, void *environment,
                                         Logger logger, void *update) {
    (void)token, (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early, (void)needed, (void)n_needed, (void)update;
    Sized *z = calloc(1, sizeof *z);
    snprintf(z->name, sizeof z->name, "%s", name);
    z->environment = environment, z->logger = logger;
    z->n = 2, z->m = 1, z->state = INSTANTIATED;
    return z;
}
EXPORT int fmi3EnterConfigurationMode(Sized *z) {
    ALLOWED(z, "fmi3EnterConfigurationMode", INSTANTIATED);
    z->state = CONFIGURATION;
    return OK;
}
EXPORT int fmi3ExitConfigurationMode(Sized *z) {
    ALLOWED(z, "fmi3ExitConfigurationMode", CONFIGURATION);
    z->state = INSTANTIATED;
    return OK;
}
EXPORT int fmi3EnterInitializationMode(Sized *z, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)start, (void)has_stop, (void)stop;
    ALLOWED(z, "fmi3EnterInitializationMode", INSTANTIATED);
    z->state = INITIALIZATION;
    return OK;
}
EXPORT int fmi3ExitInitializationMode(Sized *z) {
    ALLOWED(z, "fmi3ExitInitializationMode", INITIALIZATION);
    compute(z);
    z->state = STEP;
    return OK;
}
EXPORT int fmi3Terminate(Sized *z) {
    ALLOWED(z, "fmi3Terminate", STEP);
    z->state = TERMINATED;
    return OK;
}
EXPORT int fmi3DoStep(Sized *z, double t, double h, bool no_set_prior, bool *event, bool *terminate, bool *early, double *last) {
    (void)no_set_prior;
    ALLOWED(z, "fmi3DoStep", STEP);
    *event = *terminate = *early = false;
    *last = t + h;
    compute(z);
    return OK;
}

static uint64_t size_of(const Sized *z, uint32_t vr) { return vr <= M ? 1 : vr == P ? z->n * z->m : z->n; }
#define SIZED(function)                                                                                                \
    size_t total = 0;                                                                                                  \
    for (size_t i = 0; i < n; i++) total += size_of(z, vr[i]);                                                         \
    if (total == 0) return complain(z, "%s: of arrays without elements", function);                                    \
    if (total != n_values) return complain(z, "%s: %d values, arrays have %d", function, (int)n_values, (int)total)

EXPORT int fmi3SetUInt64(Sized *z, const uint32_t vr[], size_t n, const uint64_t value[], size_t n_values) {
    ALLOWED(z, "fmi3SetUInt64", CONFIGURATION);
    SIZED("fmi3SetUInt64");
    for (size_t i = 0; i < n; i++) {
        bool least = vr[i] == N && strncmp(z->name, "empty", 5);
        if (vr[i] > M || value[i] < least || value[i] > MOST) return complain(z, "fmi3SetUInt64 of %d", (int)vr[i]);
        *(vr[i] == N ? &z->n : &z->m) = value[i];
    }
    return OK;
}
EXPORT int fmi3SetBoolean(Sized *z, const uint32_t vr[], size_t n, const bool value[], size_t n_values) {
    ALLOWED(z, "fmi3SetBoolean", CONFIGURATION);
    if (n != 1 || n_values != 1 || vr[0] != DOUBLED) return complain(z, "fmi3SetBoolean");
    z->doubled = value[0];
    return OK;
}
EXPORT int fmi3GetUInt64(Sized *z, const uint32_t vr[], size_t n, uint64_t value[], size_t n_values) {
    SIZED("fmi3GetUInt64");
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == N ? z->n : z->m;
    return OK;
}
EXPORT int fmi3SetFloat64(Sized *z, const uint32_t vr[], size_t n, const double value[], size_t n_values) {
    ALLOWED(z, "fmi3SetFloat64", INSTANTIATED | INITIALIZATION | STEP);
    SIZED("fmi3SetFloat64");
    if (n != 1 || vr[0] != U) return complain(z, "fmi3SetFloat64");
    memcpy(z->u, value, n_values * sizeof *value);
    return OK;
}
EXPORT int fmi3GetFloat64(Sized *z, const uint32_t vr[], size_t n, double value[], size_t n_values) {
    ALLOWED(z, "fmi3GetFloat64", INITIALIZATION | STEP | TERMINATED);
    SIZED("fmi3GetFloat64");
    if (z->state == INITIALIZATION) compute(z);
    if (n != 1 || vr[0] != Y) return complain(z, "fmi3GetFloat64");
    memcpy(value, z->y, n_values * sizeof *value);
    return OK;
}
EXPORT int fmi3SetInt32(Sized *z, const uint32_t vr[], size_t n, const int32_t value[], size_t n_values) {
    ALLOWED(z, "fmi3SetInt32", INSTANTIATED | INITIALIZATION);
    SIZED("fmi3SetInt32");
    if (n != 1 || vr[0] != P) return complain(z, "fmi3SetInt32");
    memcpy(z->p, value, n_values * sizeof *value);
    return OK;
}
EXPORT int fmi3GetInt32(Sized *z, const uint32_t vr[], size_t n, int32_t value[], size_t n_values) {
    ALLOWED(z, "fmi3GetInt32", INITIALIZATION | STEP | TERMINATED);
    SIZED("fmi3GetInt32");
    if (z->state == INITIALIZATION) compute(z);
    if (n != 1 || (vr[0] != SUMS && vr[0] != P)) return complain(z, "fmi3GetInt32");
    memcpy(value, vr[0] == P ? z->p : z->sums, n_values * sizeof *value);
    return OK;
}
EXPORT int fmi3SetString(Sized *z, const uint32_t vr[], size_t n, const char *const value[], size_t n_values) {
    ALLOWED(z, "fmi3SetString", INSTANTIATED | INITIALIZATION | STEP);
    SIZED("fmi3SetString");
    if (n != 1 || vr[0] != S) return complain(z, "fmi3SetString");
    for (size_t i = 0; i < n_values; i++) snprintf(z->s[i], sizeof z->s[i], "%s", value[i]);
    return OK;
}
EXPORT int fmi3GetString(Sized *z, const uint32_t vr[], size_t n, const char *value[], size_t n_values) {
    ALLOWED(z, "fmi3GetString", INITIALIZATION | STEP | TERMINATED);
    SIZED("fmi3GetString");
    if (z->state == INITIALIZATION) compute(z);
    if (n != 1 || vr[0] != T) return complain(z, "fmi3GetString");
    for (size_t i = 0; i < n_values; i++) value[i] = z->t[i];
    return OK;
}
