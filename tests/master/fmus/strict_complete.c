/* strict.c with all functions of FMI 2.0, which libcosim wants to find even where it never calls them. */

#include "strict.c"

EXPORT int fmi2Reset(Strict *p) {
    (void)p;
    return 3;
}
EXPORT int fmi2SerializedFMUstateSize(Strict *p, void *state, size_t *size) {
    (void)p, (void)state, (void)size;
    return 3;
}
EXPORT int fmi2SerializeFMUstate(Strict *p, void *state, char bytes[], size_t size) {
    (void)p, (void)state, (void)bytes, (void)size;
    return 3;
}
EXPORT int fmi2DeSerializeFMUstate(Strict *p, const char bytes[], size_t size, void **state) {
    (void)p, (void)bytes, (void)size, (void)state;
    return 3;
}
EXPORT int fmi2GetDirectionalDerivative(Strict *p, const unsigned z[], size_t nz, const unsigned v[], size_t nv,
                                        const double dv[], double dz[]) {
    (void)p, (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz;
    return 3;
}
EXPORT int fmi2SetRealInputDerivatives(Strict *p, const unsigned vr[], size_t n, const int order[], const double value[]) {
    (void)p, (void)vr, (void)n, (void)order, (void)value;
    return 3;
}
EXPORT int fmi2GetRealOutputDerivatives(Strict *p, const unsigned vr[], size_t n, const int order[], double value[]) {
    (void)p, (void)vr, (void)n, (void)order, (void)value;
    return 3;
}
