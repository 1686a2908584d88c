/* FMI 3.0.2 co-simulation over a record and two kernels; see instance.h.

   Packets are Binary, i.e. bytes and not text; zero bytes mean that there is no packet. There are no clocks, events or
   structural parameters, as declared in modelDescription.xml: instantiating with eventModeUsed is an error. A call that
   the state table of sections 2.3 and 4.2 forbids, an unknown value reference, a wrong type, a wrong number of values,
   NaN or a value out of range returns fmi3Error. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef uint8_t fmi3UInt8;
typedef int16_t fmi3Int16;
typedef uint16_t fmi3UInt16;
typedef int32_t fmi3Int32;
typedef uint32_t fmi3UInt32;
typedef int64_t fmi3Int64;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef const fmi3Byte *fmi3Binary;
typedef bool fmi3Clock;
typedef int fmi3DependencyKind, fmi3IntervalQualifier;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessage)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdate)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean *, fmi3Float64 *);
typedef void (*fmi3ClockUpdate)(fmi3InstanceEnvironment);
typedef void (*fmi3Preemption)(void);

typedef fmi3Status Status;
typedef fmi3Boolean Boolean;
typedef fmi3Byte Byte;
typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessage logger;
} Environment;
#define OK fmi3OK
#define FAILURE fmi3Error
#define FMI(name) fmi3##name
#define STATE(verb, rest) fmi3##verb##FMUState##rest
#define DESERIALIZE fmi3DeserializeFMUState

#include "instance.h"

static const char *const MODE_NAMES[] = {"Instantiated", "Initialization Mode", "Step Mode", "Terminated", "error"};
#define READABLE (INSTANTIATED | INITIALIZATION | STEP | TERMINATED | ERROR)

static void log_text(const Environment *own, const char *name, const char *text) {
    (void)name;
    if (own->logger) own->logger(own->environment, fmi3Error, "logStatusError", text);
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
    fmi3Boolean early_return, const fmi3ValueReference required[], size_t n_required, fmi3InstanceEnvironment environment,
    fmi3LogMessage logger, fmi3IntermediateUpdate update) {
    (void)resources; (void)visible; (void)logging; (void)early_return; (void)required; (void)update;
    Environment own = {environment, logger};
#define REFUSE(...) return complain(&own, "", "fmi3InstantiateCoSimulation: " __VA_ARGS__), NULL
    if (!name || !*name) REFUSE("the instance name is empty");
    if (!token || strcmp(token, GUID))
        REFUSE("wrong instantiation token %s, the binary of %s has %s", token ? token : "(NULL)", MODEL, GUID);
    if (event_mode) REFUSE("this FMU has no Event Mode (hasEventMode is false)");
    if (n_required) REFUSE("this FMU has no intermediate update (providesIntermediateUpdate is false)");
#undef REFUSE
    return new_instance(name, own);
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessage logger) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging;
    complain(&(Environment){environment, logger}, "", "fmi3InstantiateModelExchange: this FMU is for Co-Simulation only");
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessage logger, fmi3ClockUpdate update, fmi3Preemption lock, fmi3Preemption unlock) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)update; (void)lock; (void)unlock;
    complain(&(Environment){environment, logger}, "", "fmi3InstantiateScheduledExecution: this FMU is for Co-Simulation only");
    return NULL;
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
    (void)has_tolerance; (void)tolerance;
    CALL("fmi3EnterInitializationMode", INSTANTIATED);
    Status status = set_times(s, "fmi3EnterInitializationMode", start, has_stop, stop);
    if (status == fmi3OK) s->progress.mode = INITIALIZATION;
    return status;
}

/* ---- values ---------------------------------------------------------------------------------------------------------- */

static const char *KIND_NAMES[] = {"Float64", "Int32", "Boolean", "Binary", "Enumeration", "Float64"};

static fmi3Status unknown(Instance *s, const char *function, fmi3ValueReference vr) {
    if (vr >= N_VARIABLES) return fail(s, "%s: value reference %u, there are 0 to %u", function, (unsigned)vr, N_VARIABLES - 1);
    return fail(s, "%s: value reference %u is %s, of type %s", function, (unsigned)vr, VARIABLES[vr].name, KIND_NAMES[VARIABLES[vr].kind]);
}

static fmi3Status miscounted(Instance *s, const char *function, size_t given, size_t wanted) {
    return fail(s, "%s: %zu values are given, the variables have %zu", function, given, wanted);
}

/* Outputs and states have no values before Initialization Mode. */
static int readable(const Instance *s, const Variable *v) { return s->progress.mode != INSTANTIATED || v->role != CALCULATED; }

static fmi3Status unreadable(Instance *s, const char *function, const Variable *v) {
    return fail(s, "%s: %s is calculated by the FMU and has no value in state Instantiated", function, v->name);
}

#define GET_PROLOGUE(function)                                                                                         \
    CALL(function, READABLE);                                                                                          \
    NEEDS(function, vr, n);                                                                                            \
    NEEDS(function, value, n_values);                                                                                  \
    START_TO_READ                                                                                                      \
    size_t at = 0
#define SET_PROLOGUE(function)                                                                                         \
    CALL(function, SETTABLE);                                                                                          \
    NEEDS(function, vr, n);                                                                                            \
    NEEDS(function, value, n_values);                                                                                  \
    size_t at = 0
#define VARIABLE(function, is_right)                                                                                   \
    if (vr[i] >= N_VARIABLES) return unknown(s, function, vr[i]);                                                      \
    const Variable *v = VARIABLES + vr[i];                                                                             \
    if (!(is_right)) return unknown(s, function, vr[i])
#define SETTABLE_VARIABLE(function, is_right)                                                                          \
    VARIABLE(function, is_right);                                                                                      \
    if (!settable(s, v)) return refuse(s, function, v)
/* Getter and setter of a type that the variables of one kind have; `stored` is the type of a record's elements. */
#define ACCESS(Type, kind_, stored, shown, cast)                                                                       \
    EXPORT fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Type value[], size_t n_values) { \
        GET_PROLOGUE("fmi3Get" #Type);                                                                                 \
        for (size_t i = 0; i < n; i++) {                                                                               \
            VARIABLE("fmi3Get" #Type, v->kind == kind_ || (kind_ == REAL && v->kind == TIME));                         \
            if (!readable(s, v)) return unreadable(s, "fmi3Get" #Type, v);                                             \
            if (v->count > n_values - at) return miscounted(s, "fmi3Get" #Type, n_values, at + v->count);              \
            const unsigned char *from = v->kind == TIME ? (const unsigned char *)&s->progress.time : s->record + v->offset; \
            for (size_t j = 0; j < v->count; j++) {                                                                    \
                stored x;                                                                                              \
                memcpy(&x, from + j * sizeof x, sizeof x);                                                             \
                value[at++] = (fmi3##Type)x;                                                                           \
            }                                                                                                          \
        }                                                                                                              \
        return at == n_values ? fmi3OK : miscounted(s, "fmi3Get" #Type, n_values, at);                                 \
    }                                                                                                                  \
    EXPORT fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Type value[], size_t n_values) { \
        SET_PROLOGUE("fmi3Set" #Type);                                                                                 \
        for (size_t i = 0; i < n; i++) {                                                                               \
            SETTABLE_VARIABLE("fmi3Set" #Type, v->kind == kind_);                                                      \
            if (v->count > n_values - at) return miscounted(s, "fmi3Set" #Type, n_values, at + v->count);              \
            for (size_t j = 0; j < v->count; j++, at++)                                                                \
                if (!(value[at] >= v->min && value[at] <= v->max))                                                     \
                    return fail(s, "fmi3Set" #Type ": %s = " shown " is not within %g to %g", v->name, (cast)value[at], v->min, v->max); \
        }                                                                                                              \
        if (at != n_values) return miscounted(s, "fmi3Set" #Type, n_values, at);                                       \
        at = 0;                                                                                                        \
        for (size_t i = 0; i < n; i++) {                                                                               \
            const Variable *v = VARIABLES + vr[i];                                                                     \
            for (size_t j = 0; j < v->count; j++) {                                                                    \
                stored x = (stored)value[at++];                                                                        \
                memcpy(s->record + v->offset + j * sizeof x, &x, sizeof x);                                            \
            }                                                                                                          \
        }                                                                                                              \
        CHANGED;                                                                                                       \
        return fmi3OK;                                                                                                 \
    }

ACCESS(Float64, REAL, double, "%g", double)
ACCESS(Int32, INTEGER, int32_t, "%d", int)
ACCESS(Int64, ENUMERATION, int32_t, "%lld", long long)
ACCESS(Boolean, BOOLEAN, unsigned char, "%d", int)

/* No variable has one of these types. */
#define NO_ACCESS(Type)                                                                                                \
    EXPORT fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Type value[], size_t n_values) { \
        CALL("fmi3Get" #Type, READABLE);                                                                               \
        NEEDS("fmi3Get" #Type, vr, n);                                                                                 \
        (void)value;                                                                                                   \
        if (n) return unknown(s, "fmi3Get" #Type, vr[0]);                                                              \
        return n_values ? miscounted(s, "fmi3Get" #Type, n_values, 0) : fmi3OK;                                        \
    }                                                                                                                  \
    EXPORT fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Type value[], size_t n_values) { \
        CALL("fmi3Set" #Type, SETTABLE);                                                                               \
        NEEDS("fmi3Set" #Type, vr, n);                                                                                 \
        (void)value;                                                                                                   \
        if (n) return unknown(s, "fmi3Set" #Type, vr[0]);                                                              \
        return n_values ? miscounted(s, "fmi3Set" #Type, n_values, 0) : fmi3OK;                                        \
    }

NO_ACCESS(Float32)
NO_ACCESS(Int8)
NO_ACCESS(UInt8)
NO_ACCESS(Int16)
NO_ACCESS(UInt16)
NO_ACCESS(UInt32)
NO_ACCESS(UInt64)
NO_ACCESS(String)

/* ---- packets --------------------------------------------------------------------------------------------------------- */

EXPORT fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t size[], fmi3Binary value[], size_t n_values) {
    GET_PROLOGUE("fmi3GetBinary");
    NEEDS("fmi3GetBinary", size, n_values);
    if (n != n_values) return miscounted(s, "fmi3GetBinary", n_values, n);
    for (size_t i = 0; i < n; i++, at++) {
        VARIABLE("fmi3GetBinary", v->kind == PACKETS);
        if (!readable(s, v)) return unreadable(s, "fmi3GetBinary", v);
        USED_BYTES(v);
        size[at] = (size_t)used;
        value[at] = s->record + v->offset;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t size[], const fmi3Binary value[], size_t n_values) {
    SET_PROLOGUE("fmi3SetBinary");
    NEEDS("fmi3SetBinary", size, n_values);
    if (n != n_values) return miscounted(s, "fmi3SetBinary", n_values, n);
    for (size_t i = 0; i < n; i++, at++) {
        SETTABLE_VARIABLE("fmi3SetBinary", v->kind == PACKETS);
        if (size[at] > v->count) return fail(s, "fmi3SetBinary: %s holds %zu bytes, not %zu", v->name, v->count, size[at]);
        if (size[at] && !value[at]) return fail(s, "fmi3SetBinary: %s: the bytes are NULL", v->name);
    }
    for (size_t i = 0; i < n; i++) {
        const Variable *v = VARIABLES + vr[i];
        int32_t used = (int32_t)size[i];
        if (used) memmove(s->record + v->offset, value[i], size[i]); /* the source may be the result of fmi3GetBinary */
        memcpy(s->record + v->length, &used, sizeof used);
    }
    CHANGED;
    return fmi3OK;
}

/* ---- stepping -------------------------------------------------------------------------------------------------------- */

EXPORT fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_prior, fmi3Boolean *event,
                             fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    (void)no_set_prior;
    CALL("fmi3DoStep", STEP);
    NEEDS("fmi3DoStep", event, 1);
    NEEDS("fmi3DoStep", terminate, 1);
    NEEDS("fmi3DoStep", early, 1);
    NEEDS("fmi3DoStep", last, 1);
    *event = *terminate = *early = false;
    Status status = advance(s, "fmi3DoStep", t, h);
    *last = s->progress.time;
    return status;
}

/* ---- not provided, as declared in modelDescription.xml ---------------------------------------------------------------- */

#define NOT_PROVIDED(name, ...)                                                                                        \
    EXPORT fmi3Status name(fmi3Instance c, ##__VA_ARGS__) {                                                            \
        Instance *s = (Instance *)c;                                                                                   \
        return s ? fail(s, "%s: this FMU does not provide it", #name) : fmi3Error;                                     \
    }
#define REFERENCES const fmi3ValueReference vr[], size_t n

NOT_PROVIDED(fmi3EnterEventMode)
NOT_PROVIDED(fmi3EnterConfigurationMode)
NOT_PROVIDED(fmi3ExitConfigurationMode)
NOT_PROVIDED(fmi3EnterStepMode)
NOT_PROVIDED(fmi3GetClock, REFERENCES, fmi3Clock value[])
NOT_PROVIDED(fmi3SetClock, REFERENCES, const fmi3Clock value[])
NOT_PROVIDED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *n)
NOT_PROVIDED(fmi3GetVariableDependencies, fmi3ValueReference vr, size_t a[], fmi3ValueReference of[], size_t b[], fmi3DependencyKind kinds[], size_t n)
NOT_PROVIDED(fmi3GetDirectionalDerivative, REFERENCES, const fmi3ValueReference of[], size_t n_of, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 value[], size_t n_value)
NOT_PROVIDED(fmi3GetAdjointDerivative, REFERENCES, const fmi3ValueReference of[], size_t n_of, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 value[], size_t n_value)
NOT_PROVIDED(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 order[], fmi3Float64 value[], size_t n_value)
NOT_PROVIDED(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 interval[], fmi3IntervalQualifier qualifier[])
NOT_PROVIDED(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 counter[], fmi3UInt64 resolution[], fmi3IntervalQualifier qualifier[])
NOT_PROVIDED(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 shift[])
NOT_PROVIDED(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 counter[], fmi3UInt64 resolution[])
NOT_PROVIDED(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 interval[])
NOT_PROVIDED(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
NOT_PROVIDED(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 shift[])
NOT_PROVIDED(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
NOT_PROVIDED(fmi3EvaluateDiscreteStates)
NOT_PROVIDED(fmi3UpdateDiscreteStates, fmi3Boolean *again, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *has_next, fmi3Float64 *next)
NOT_PROVIDED(fmi3EnterContinuousTimeMode)
NOT_PROVIDED(fmi3CompletedIntegratorStep, fmi3Boolean no_set_prior, fmi3Boolean *event, fmi3Boolean *terminate)
NOT_PROVIDED(fmi3SetTime, fmi3Float64 time)
NOT_PROVIDED(fmi3SetContinuousStates, const fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetContinuousStateDerivatives, fmi3Float64 dx[], size_t n)
NOT_PROVIDED(fmi3GetEventIndicators, fmi3Float64 z[], size_t n)
NOT_PROVIDED(fmi3GetContinuousStates, fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetNominalsOfContinuousStates, fmi3Float64 x[], size_t n)
NOT_PROVIDED(fmi3GetNumberOfEventIndicators, size_t *n)
NOT_PROVIDED(fmi3GetNumberOfContinuousStates, size_t *n)
NOT_PROVIDED(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
