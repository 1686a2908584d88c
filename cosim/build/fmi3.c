/* FMI 3.0.2 co-simulation over a record and two kernels, the counterpart of fmi2.c.

   The memory of an instance is one record, and a variable is an offset into it and a number of elements (model.h).
   Packets are Binary, i.e. bytes and not text; zero bytes mean that there is no packet. There are no clocks, events or
   structural parameters, as declared in modelDescription.xml: instantiating with eventModeUsed is an error. A call that
   the state table of sections 2.3 and 4.2 forbids, an unknown value reference, a wrong type, a wrong number of values,
   NaN or a value out of range returns fmi3Error with a message, sets nothing, and puts the instance into the error
   state, as does a failed kernel. The error state permits only reading, fmi3Reset, fmi3SetFMUState and
   fmi3FreeInstance. */

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

typedef enum { FLOAT64, INT32, BOOLEAN, ENUMERATION, BINARY, TIME } Kind;
typedef enum { FIXED, TUNABLE, INPUT, CALCULATED } Role;
typedef struct {
    const char *name;
    Kind kind;
    Role role;
    size_t offset;   /* into the record; of packets: of their bytes */
    size_t length;   /* of packets: offset of the number of bytes used */
    size_t count;    /* elements; of packets: capacity in bytes */
    double min, max; /* of numbers and enumerations */
} Variable;
typedef struct { int code; const char *text; } KernelError;
#define LINE 64 /* bytes of a cache line */

#include "model.h" /* MODEL, GUID, RECORD_SIZE, HEAD_SIZE, BUSY_FROM, BUSY_TO, VARIABLES, N_VARIABLES, DEFAULTS, ERRORS, N_ERRORS, ERROR_CODES, CHECKED */

/* They return 0, or nonzero if the kernel raised an exception; then `exception` points to its text, a format for index_text.
   `code` is the kernel's return value. */
extern int model_start(int *code, const char *const **exception, void *record);
extern int model_advance(int *code, const char *const **exception, void *record, double t, double h);

/* ---- instances --------------------------------------------------------------------------------------------------- */

typedef enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, ERROR = 16 } Mode;
#define ANY (~0)
#define READABLE (INSTANTIATED | INITIALIZATION | STEP | TERMINATED | ERROR)
#define SETTABLE (INSTANTIATED | INITIALIZATION | STEP)

static const char *mode_name(Mode mode) {
    switch (mode) {
    case INSTANTIATED: return "Instantiated";
    case INITIALIZATION: return "Initialization Mode";
    case STEP: return "Step Mode";
    case TERMINATED: return "Terminated";
    default: return "error";
    }
}

/* The part of the FMU state that is not in the record. */
typedef struct {
    Mode mode;
    int started; /* `start` has run since the last value was set */
    int has_stop;
    double time, stop;
} Progress;
typedef struct {
    unsigned char *record;
    Progress progress;
    fmi3InstanceEnvironment environment;
    fmi3LogMessage logger;
} Instance;

static void log_text(fmi3InstanceEnvironment environment, fmi3LogMessage logger, const char *format, va_list arguments) {
    char text[1024];
    if (!logger) return;
    vsnprintf(text, sizeof text, format, arguments);
    logger(environment, fmi3Error, "logStatusError", text);
}

static fmi3Status fail(Instance *s, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    log_text(s->environment, s->logger, format, arguments);
    va_end(arguments);
    s->progress.mode = ERROR;
    return fmi3Error;
}

static fmi3Instance refuse_instance(fmi3InstanceEnvironment environment, fmi3LogMessage logger, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    log_text(environment, logger, format, arguments);
    va_end(arguments);
    return NULL;
}

/* Returns from the calling function unless the instance exists and is in one of `modes`. */
#define CALL(function, modes)                                                                                          \
    Instance *s = (Instance *)c;                                                                                       \
    if (!s) return fmi3Error;                                                                                          \
    if (!(s->progress.mode & (modes)))                                                                                 \
        return fail(s, "%s is not allowed in state %s", function, mode_name(s->progress.mode))
#define NEEDS(function, pointer, n)                                                                                    \
    if ((n) && !(pointer)) return fail(s, "%s: %s is NULL", function, #pointer)

static void reset(Instance *s) {
    memcpy(s->record, DEFAULTS, RECORD_SIZE);
    memset(&s->progress, 0, sizeof s->progress);
    s->progress.mode = INSTANTIATED;
}

#if CHECKED
/* A checked kernel calls this before it raises an exception for an index outside its array. */
static _Thread_local long long failed_index, failed_length;
void model_index_failed(int64_t index, int64_t length);
void model_index_failed(int64_t index, int64_t length) {
    failed_index = index;
    failed_length = length;
}
#else
enum { failed_index, failed_length = 0 };
#endif

static fmi3Status kernel_status(Instance *s, const char *what, int raised, const char *const *exception, int code) {
    if (raised) {
        char text[1024] = "the kernel raised an exception";
        long long index = failed_index, length = failed_length;
        if (raised > 0 && exception && *exception) snprintf(text, sizeof text, *exception, index, length, -length, length - 1);
        return fail(s, "%s: %s", what, text);
    }
    if (!code) return fmi3OK;
    for (size_t i = 0; i < N_ERRORS; i++)
        if (ERRORS[i].code == code) return fail(s, "%s: %s (code %d)", what, ERRORS[i].text, code);
    return fail(s, "%s returned %d; it returns 0, or a key of errors (" ERROR_CODES ")", what, code);
}

/* In Initialization Mode `start` runs once before values are read after others were set. */
static fmi3Status ensure_started(Instance *s) {
    if (s->progress.started) return fmi3OK;
    memcpy(s->record + HEAD_SIZE, DEFAULTS + HEAD_SIZE, RECORD_SIZE - HEAD_SIZE);
    s->progress.started = 1;
    int code = 0;
    const char *const *exception = NULL;
    int raised = model_start(&code, &exception, s->record);
    return kernel_status(s, "start", raised, exception, code);
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean event_mode,
    fmi3Boolean early_return, const fmi3ValueReference required[], size_t n_required, fmi3InstanceEnvironment environment,
    fmi3LogMessage logger, fmi3IntermediateUpdate update) {
    (void)resources; (void)visible; (void)logging; (void)early_return; (void)required; (void)update;
#define REFUSE(...) return refuse_instance(environment, logger, "fmi3InstantiateCoSimulation: " __VA_ARGS__)
    if (!name || !*name) REFUSE("the instance name is empty");
    if (!token || strcmp(token, GUID))
        REFUSE("wrong instantiation token %s, the binary of " MODEL " has " GUID, token ? token : "(NULL)");
    if (event_mode) REFUSE("this FMU has no Event Mode (hasEventMode is false)");
    if (n_required) REFUSE("this FMU has no intermediate update (providesIntermediateUpdate is false)");
#undef REFUSE
    Instance *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->environment = environment;
    s->logger = logger;
    s->record = malloc(RECORD_SIZE);
    if (!s->record) {
        free(s);
        return NULL;
    }
    reset(s);
    return s;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessage logger) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging;
    return refuse_instance(environment, logger, "fmi3InstantiateModelExchange: this FMU is for Co-Simulation only");
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessage logger, fmi3ClockUpdate update, fmi3Preemption lock, fmi3Preemption unlock) {
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)update; (void)lock; (void)unlock;
    return refuse_instance(environment, logger, "fmi3InstantiateScheduledExecution: this FMU is for Co-Simulation only");
}

EXPORT void fmi3FreeInstance(fmi3Instance c) {
    Instance *s = (Instance *)c;
    if (!s) return;
    free(s->record);
    free(s);
}

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    CALL("fmi3SetDebugLogging", ANY);
    NEEDS("fmi3SetDebugLogging", categories, n);
    for (size_t i = 0; i < n; i++)
        if (!categories[i] || strcmp(categories[i], "logStatusError"))
            return fail(s, "fmi3SetDebugLogging: unknown category %s, there is logStatusError", categories[i] ? categories[i] : "(NULL)");
    (void)on; /* only errors are logged */
    return fmi3OK;
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                              fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
    (void)has_tolerance; (void)tolerance;
    CALL("fmi3EnterInitializationMode", INSTANTIATED);
    if (!(start - start == 0.0)) return fail(s, "fmi3EnterInitializationMode: start time %g is not finite", start);
    if (has_stop && !(stop >= start))
        return fail(s, "fmi3EnterInitializationMode: stop time %g lies before start time %g", stop, start);
    s->progress.time = start;
    s->progress.has_stop = has_stop;
    s->progress.stop = stop;
    s->progress.mode = INITIALIZATION;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    CALL("fmi3ExitInitializationMode", INITIALIZATION);
    fmi3Status status = ensure_started(s);
    if (status == fmi3OK) s->progress.mode = STEP;
    return status;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance c) {
    CALL("fmi3Terminate", STEP);
    s->progress.mode = TERMINATED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance c) {
    CALL("fmi3Reset", ANY);
    reset(s);
    return fmi3OK;
}

/* ---- values ---------------------------------------------------------------------------------------------------------- */

static const char *KIND_NAMES[] = {"Float64", "Int32", "Boolean", "Enumeration", "Binary", "Float64"};

static fmi3Status unknown(Instance *s, const char *function, fmi3ValueReference vr) {
    if (vr >= N_VARIABLES) return fail(s, "%s: value reference %u, there are 0 to %d", function, (unsigned)vr, N_VARIABLES - 1);
    return fail(s, "%s: value reference %u is %s, of type %s", function, (unsigned)vr, VARIABLES[vr].name, KIND_NAMES[VARIABLES[vr].kind]);
}

static fmi3Status miscounted(Instance *s, const char *function, size_t given, size_t wanted) {
    return fail(s, "%s: %zu values are given, the variables have %zu", function, given, wanted);
}

/* Outputs and states have no values before Initialization Mode. */
static int readable(const Instance *s, const Variable *v) { return s->progress.mode != INSTANTIATED || v->role != CALCULATED; }

static int settable(const Instance *s, const Variable *v) {
    return v->role == TUNABLE || v->role == INPUT || (v->role == FIXED && s->progress.mode != STEP);
}

static fmi3Status unreadable(Instance *s, const char *function, const Variable *v) {
    return fail(s, "%s: %s is calculated by the FMU and has no value in state Instantiated", function, v->name);
}

static fmi3Status refuse(Instance *s, const char *function, const Variable *v) {
    static const char *roles[] = {"a fixed parameter", "a tunable parameter", "an input", "calculated by the FMU"};
    return fail(s, "%s: %s is %s and cannot be set in state %s", function, v->name, roles[v->role], mode_name(s->progress.mode));
}

#define GET_PROLOGUE(function)                                                                                         \
    CALL(function, READABLE);                                                                                          \
    NEEDS(function, vr, n);                                                                                            \
    NEEDS(function, value, n_values);                                                                                  \
    if (s->progress.mode == INITIALIZATION) {                                                                          \
        fmi3Status status = ensure_started(s);                                                                         \
        if (status != fmi3OK) return status;                                                                           \
    }                                                                                                                  \
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
#define CHANGED                                                                                                        \
    if (s->progress.mode != STEP) s->progress.started = 0

/* Getter and setter of a type that the variables of one kind have; `stored` is the type of a record's elements. */
#define ACCESS(Type, kind_, stored, shown, cast)                                                                       \
    EXPORT fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Type value[], size_t n_values) { \
        GET_PROLOGUE("fmi3Get" #Type);                                                                                 \
        for (size_t i = 0; i < n; i++) {                                                                               \
            VARIABLE("fmi3Get" #Type, v->kind == kind_ || (kind_ == FLOAT64 && v->kind == TIME));                      \
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

ACCESS(Float64, FLOAT64, double, "%g", double)
ACCESS(Int32, INT32, int32_t, "%d", int)
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
        VARIABLE("fmi3GetBinary", v->kind == BINARY);
        if (!readable(s, v)) return unreadable(s, "fmi3GetBinary", v);
        int32_t used;
        memcpy(&used, s->record + v->length, sizeof used);
        if (used < 0 || (size_t)used > v->count)
            return fail(s, "%s: the kernel reports %d bytes, its capacity is %d", v->name, (int)used, (int)v->count);
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
        SETTABLE_VARIABLE("fmi3SetBinary", v->kind == BINARY);
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
    for (size_t at = BUSY_FROM / LINE * LINE; at < BUSY_TO; at += LINE) __builtin_prefetch(s->record + at, 1);
    NEEDS("fmi3DoStep", event, 1);
    NEEDS("fmi3DoStep", terminate, 1);
    NEEDS("fmi3DoStep", early, 1);
    NEEDS("fmi3DoStep", last, 1);
    double slack = 1e-6 * h + 1e-12 * (t < 0 ? -t : t);
    *event = *terminate = *early = false;
    *last = s->progress.time;
    if (!(h > 0.0) || !(h - h == 0.0)) return fail(s, "fmi3DoStep: the step size %g is not positive and finite", h);
    if (!(t - s->progress.time <= slack && s->progress.time - t <= slack))
        return fail(s, "fmi3DoStep: the communication point is %.9g, the FMU is at %.9g", t, s->progress.time);
    if (s->progress.has_stop && t + h > s->progress.stop + slack)
        return fail(s, "fmi3DoStep: %.9g + %.9g is after the stop time %.9g", t, h, s->progress.stop);
    int code = 0;
    const char *const *exception = NULL;
    int raised = model_advance(&code, &exception, s->record, t, h);
    if (raised || code) return kernel_status(s, "advance", raised, exception, code);
    s->progress.time = *last = t + h;
    return fmi3OK;
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

/* ---- FMU state ----------------------------------------------------------------------------------------------------------- */

/* fmi3GetFMUState returns one block: the token, by which states of other FMUs are rejected, Progress, and the record.
   It can be restored in any instance of this FMU. The serialised form ends with a checksum. */
#define PROGRESS_AT sizeof GUID
#define RECORD_AT (PROGRESS_AT + sizeof(Progress))
#define STATE_SIZE (RECORD_AT + RECORD_SIZE)
#define SERIALIZED_SIZE (STATE_SIZE + sizeof(uint64_t))

static uint64_t checksum(const void *bytes, size_t n) { /* FNV-1a */
    const unsigned char *b = bytes;
    uint64_t sum = 14695981039346656037u;
    for (size_t i = 0; i < n; i++) sum = (sum ^ b[i]) * 1099511628211u;
    return sum;
}

#define OWN_STATE(function, state)                                                                                     \
    NEEDS(function, state, 1);                                                                                         \
    if (memcmp(state, GUID, sizeof GUID)) return fail(s, "%s: this is not a state of " MODEL " " GUID, function)

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) {
    CALL("fmi3GetFMUState", ANY);
    NEEDS("fmi3GetFMUState", state, 1);
    if (*state) {
        OWN_STATE("fmi3GetFMUState", *state);
    } else if (!(*state = malloc(STATE_SIZE))) {
        return fail(s, "fmi3GetFMUState: out of memory");
    }
    unsigned char *to = *state;
    memcpy(to, GUID, sizeof GUID);
    memcpy(to + PROGRESS_AT, &s->progress, sizeof s->progress);
    memcpy(to + RECORD_AT, s->record, RECORD_SIZE);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) {
    CALL("fmi3SetFMUState", ANY);
    OWN_STATE("fmi3SetFMUState", state);
    const unsigned char *from = state;
    memcpy(&s->progress, from + PROGRESS_AT, sizeof s->progress);
    memcpy(s->record, from + RECORD_AT, RECORD_SIZE);
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    CALL("fmi3FreeFMUState", ANY);
    if (state && *state) {
        OWN_STATE("fmi3FreeFMUState", *state);
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    CALL("fmi3SerializedFMUStateSize", ANY);
    OWN_STATE("fmi3SerializedFMUStateSize", state);
    NEEDS("fmi3SerializedFMUStateSize", size, 1);
    *size = SERIALIZED_SIZE;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    CALL("fmi3SerializeFMUState", ANY);
    OWN_STATE("fmi3SerializeFMUState", state);
    NEEDS("fmi3SerializeFMUState", bytes, 1);
    if (size < SERIALIZED_SIZE)
        return fail(s, "fmi3SerializeFMUState: %zu bytes are too few, %zu are needed", size, SERIALIZED_SIZE);
    uint64_t sum = checksum(state, STATE_SIZE);
    memcpy(bytes, state, STATE_SIZE);
    memcpy(bytes + STATE_SIZE, &sum, sizeof sum);
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    CALL("fmi3DeserializeFMUState", ANY);
    NEEDS("fmi3DeserializeFMUState", state, 1);
    NEEDS("fmi3DeserializeFMUState", bytes, 1);
    if (size != SERIALIZED_SIZE || memcmp(bytes, GUID, sizeof GUID))
        return fail(s, "fmi3DeserializeFMUState: these %zu bytes are not a state of " MODEL " " GUID, size);
    uint64_t sum;
    memcpy(&sum, bytes + STATE_SIZE, sizeof sum);
    if (sum != checksum(bytes, STATE_SIZE)) return fail(s, "fmi3DeserializeFMUState: the bytes are damaged");
    if (*state) {
        OWN_STATE("fmi3DeserializeFMUState", *state);
    } else if (!(*state = malloc(STATE_SIZE))) {
        return fail(s, "fmi3DeserializeFMUState: out of memory");
    }
    memcpy(*state, bytes, STATE_SIZE);
    return fmi3OK;
}
