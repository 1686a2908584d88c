/* FMI 2.0.5 co-simulation over a record and two kernels.

   The memory of an instance is one record, and a variable is an offset into it (model.h, generated from the model's
   declaration). Therefore instances share nothing, saving the state is one memcpy, and this file is independent of the
   model. A call that the state table of section 4.2.4 forbids, an unknown value reference, a wrong type, NaN or a value
   out of range returns fmi2Error with a message, sets nothing, and puts the instance into the error state, as does a
   failed kernel. The error state permits only reading, fmi2Reset, fmi2SetFMUstate and fmi2FreeInstance. */

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *fmi2Component;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer;
typedef int fmi2Boolean;
typedef char fmi2Char;
typedef const fmi2Char *fmi2String;
typedef char fmi2Byte;
typedef void *fmi2FMUstate;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef struct {
    void (*logger)(void *, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

typedef enum { REAL, INTEGER, BOOLEAN, PACKETS } Kind;
typedef enum { FIXED, TUNABLE, INPUT, CALCULATED } Role;
typedef struct {
    const char *name;
    Kind kind;
    Role role;
    size_t offset;     /* into the record; of packets: of their bytes */
    size_t length;     /* of packets: offset of the number of bytes used */
    size_t capacity;   /* of packets: bytes */
    size_t text;       /* of packets: offset into Instance.text */
    double min, max;   /* of reals, integers and enumerations */
} Variable;
typedef struct { int code; const char *text; } KernelError;

#include "model.h" /* MODEL, GUID, RECORD_SIZE, HEAD_SIZE, TEXT_SIZE, BUSY_FROM, BUSY_TO, VARIABLES, N_VARIABLES, DEFAULTS, ERRORS, N_ERRORS, ERROR_CODES, CHECKED */

/* They return 0, or nonzero if the kernel raised an exception; then `exception` points to its text, a format for index_text.
   `code` is the kernel's return value. */
extern int model_start(int *code, const char *const **exception, void *record);
extern int model_advance(int *code, const char *const **exception, void *record, double t, double h);

/* ---- instances --------------------------------------------------------------------------------------------------- */

typedef enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP_COMPLETE = 4, TERMINATED = 8, ERROR = 16 } Mode;
static const char *mode_name(Mode mode) {
    switch (mode) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZATION: return "initialization mode";
    case STEP_COMPLETE: return "step complete";
    case TERMINATED: return "terminated";
    default: return "error";
    }
}

/* The part of the FMU state that is not in the record. */
typedef struct {
    Mode mode;
    int started;      /* `start` has run since the last value was set */
    int experiment;   /* fmi2SetupExperiment has been called */
    int has_stop;
    double time, stop;
} Progress;
typedef struct {
    unsigned char *record; /* begins a cache line; like text and name in the memory of the instance, so that thousands lie close */
    Progress progress;
    char *text;
    char *name;
    fmi2CallbackFunctions callbacks;
} Instance;
#define LINE 64
#define RECORD_LINES ((RECORD_SIZE + LINE - 1) / LINE)

static void log_text(const fmi2CallbackFunctions *callbacks, const char *name, fmi2Status status, const char *format, va_list arguments) {
    char text[1024], escaped[2048];
    size_t n = 0;
    if (!callbacks->logger) return;
    vsnprintf(text, sizeof text, format, arguments);
    for (const char *c = text; *c && n < sizeof escaped - 3; c++) { /* the logger takes a printf format */
        if (*c == '%') escaped[n++] = '%';
        escaped[n++] = *c;
    }
    escaped[n] = 0;
    callbacks->logger(callbacks->componentEnvironment, name, status, "logStatusError", escaped);
}

static fmi2Status fail(Instance *s, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    log_text(&s->callbacks, s->name, fmi2Error, format, arguments);
    va_end(arguments);
    s->progress.mode = ERROR;
    return fmi2Error;
}

static void complain(const fmi2CallbackFunctions *callbacks, const char *name, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    log_text(callbacks, name, fmi2Error, format, arguments);
    va_end(arguments);
}

/* Returns from the calling function unless the instance exists and is in one of `modes`. */
#define CALL(function, modes)                                                                                          \
    Instance *s = (Instance *)c;                                                                                       \
    if (!s) return fmi2Error;                                                                                          \
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

static fmi2Status kernel_status(Instance *s, const char *what, int raised, const char *const *exception, int code) {
    if (raised) {
        char text[1024] = "the kernel raised an exception";
        long long index = failed_index, length = failed_length;
        if (raised > 0 && exception && *exception) snprintf(text, sizeof text, *exception, index, length, -length, length - 1);
        return fail(s, "%s: %s", what, text);
    }
    if (!code) return fmi2OK;
    for (size_t i = 0; i < N_ERRORS; i++)
        if (ERRORS[i].code == code) return fail(s, "%s: %s (code %d)", what, ERRORS[i].text, code);
    return fail(s, "%s returned %d; it returns 0, or a key of errors (" ERROR_CODES ")", what, code);
}

/* In initialization mode `start` runs once before values are read after others were set. */
static fmi2Status ensure_started(Instance *s) {
    if (s->progress.started) return fmi2OK;
    memcpy(s->record + HEAD_SIZE, DEFAULTS + HEAD_SIZE, RECORD_SIZE - HEAD_SIZE);
    s->progress.started = 1;
    int code = 0;
    const char *const *exception = NULL;
    int raised = model_start(&code, &exception, s->record);
    return kernel_status(s, "start", raised, exception, code);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                     const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean debug) {
    (void)resources; (void)visible; (void)debug;
    if (!functions) return NULL;
    if (!name || !*name) { complain(functions, "", "fmi2Instantiate: the instance name is empty"); return NULL; }
    if (type != fmi2CoSimulation) { complain(functions, name, "fmi2Instantiate: this FMU is for co-simulation only"); return NULL; }
    if (!guid || strcmp(guid, GUID)) {
        complain(functions, name, "fmi2Instantiate: wrong GUID %s, the binary of " MODEL " has " GUID, guid ? guid : "(NULL)");
        return NULL;
    }
    Instance *s = calloc(1, sizeof *s + LINE + RECORD_LINES * LINE + TEXT_SIZE + 1 + strlen(name) + 1);
    if (!s) return NULL;
    s->callbacks = *functions;
    s->record = (unsigned char *)(((uintptr_t)(s + 1) + LINE - 1) / LINE * LINE);
    s->text = (char *)s->record + RECORD_LINES * LINE;
    s->name = s->text + TEXT_SIZE + 1;
    strcpy(s->name, name);
    reset(s);
    return s;
}

EXPORT void fmi2FreeInstance(fmi2Component c) {
    free(c);
}

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    CALL("fmi2SetDebugLogging", ~0);
    NEEDS("fmi2SetDebugLogging", categories, n);
    for (size_t i = 0; i < n; i++)
        if (!categories[i] || strcmp(categories[i], "logStatusError"))
            return fail(s, "fmi2SetDebugLogging: unknown category %s, there is logStatusError", categories[i] ? categories[i] : "(NULL)");
    (void)on; /* only errors are logged */
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance; (void)tolerance;
    CALL("fmi2SetupExperiment", INSTANTIATED);
    if (!(start - start == 0.0)) return fail(s, "fmi2SetupExperiment: start time %g is not finite", start);
    if (has_stop && !(stop >= start)) return fail(s, "fmi2SetupExperiment: stop time %g lies before start time %g", stop, start);
    s->progress.time = start;
    s->progress.has_stop = has_stop != 0;
    s->progress.stop = stop;
    s->progress.experiment = 1;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    CALL("fmi2EnterInitializationMode", INSTANTIATED);
    if (!s->progress.experiment) return fail(s, "fmi2EnterInitializationMode: call fmi2SetupExperiment first");
    s->progress.mode = INITIALIZATION;
    return fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    CALL("fmi2ExitInitializationMode", INITIALIZATION);
    fmi2Status status = ensure_started(s);
    if (status == fmi2OK) s->progress.mode = STEP_COMPLETE;
    return status;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component c) {
    CALL("fmi2Terminate", STEP_COMPLETE);
    s->progress.mode = TERMINATED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component c) {
    CALL("fmi2Reset", ~0);
    reset(s);
    return fmi2OK;
}

/* ---- values ---------------------------------------------------------------------------------------------------------- */

static const char *KIND_NAMES[] = {"Real", "Integer", "Boolean", "String"};
#define READABLE (INITIALIZATION | STEP_COMPLETE | TERMINATED | ERROR)
#define SETTABLE (INSTANTIATED | INITIALIZATION | STEP_COMPLETE)

static fmi2Status unknown(Instance *s, const char *function, fmi2ValueReference vr, Kind kind) {
    if (vr >= N_VARIABLES) return fail(s, "%s: value reference %u, there are 0 to %d", function, vr, N_VARIABLES - 1);
    return fail(s, "%s: value reference %u is %s, a %s, not a %s", function, vr, VARIABLES[vr].name,
                KIND_NAMES[VARIABLES[vr].kind], KIND_NAMES[kind]);
}

static int settable(const Instance *s, const Variable *v) {
    switch (v->role) {
    case FIXED: return s->progress.mode != STEP_COMPLETE;
    case TUNABLE: return 1;
    case INPUT: return 1; /* section 4.2.4 omits inputs in "instantiated"; FMPy and others set them there */
    default: return 0;
    }
}

static fmi2Status refuse(Instance *s, const char *function, const Variable *v) {
    static const char *roles[] = {"a fixed parameter", "a tunable parameter", "an input", "calculated by the FMU"};
    return fail(s, "%s: %s is %s and cannot be set in state %s", function, v->name, roles[v->role], mode_name(s->progress.mode));
}

#define GET_PROLOGUE(function)                                                                                         \
    CALL(function, READABLE);                                                                                          \
    NEEDS(function, vr, n);                                                                                            \
    NEEDS(function, value, n);                                                                                         \
    if (s->progress.mode == INITIALIZATION) {                                                                          \
        fmi2Status status = ensure_started(s);                                                                         \
        if (status != fmi2OK) return status;                                                                           \
    }
#define SET_PROLOGUE(function)                                                                                         \
    CALL(function, SETTABLE);                                                                                          \
    NEEDS(function, vr, n);                                                                                            \
    NEEDS(function, value, n)
#define VARIABLE(function, wanted)                                                                                     \
    if (vr[i] >= N_VARIABLES || VARIABLES[vr[i]].kind != wanted) return unknown(s, function, vr[i], wanted);           \
    const Variable *v = VARIABLES + vr[i]
#define SETTABLE_VARIABLE(function, wanted)                                                                            \
    VARIABLE(function, wanted);                                                                                        \
    if (!settable(s, v)) return refuse(s, function, v)
#define CHANGED                                                                                                        \
    if (s->progress.mode != STEP_COMPLETE) s->progress.started = 0

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    GET_PROLOGUE("fmi2GetReal");
    for (size_t i = 0; i < n; i++) {
        VARIABLE("fmi2GetReal", REAL);
        memcpy(value + i, s->record + v->offset, sizeof *value);
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[]) {
    GET_PROLOGUE("fmi2GetInteger");
    for (size_t i = 0; i < n; i++) {
        VARIABLE("fmi2GetInteger", INTEGER);
        memcpy(value + i, s->record + v->offset, sizeof *value);
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[]) {
    GET_PROLOGUE("fmi2GetBoolean");
    for (size_t i = 0; i < n; i++) {
        VARIABLE("fmi2GetBoolean", BOOLEAN);
        value[i] = s->record[v->offset] != 0;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    SET_PROLOGUE("fmi2SetReal");
    for (size_t i = 0; i < n; i++) {
        SETTABLE_VARIABLE("fmi2SetReal", REAL);
        if (!(value[i] >= v->min && value[i] <= v->max))
            return fail(s, "fmi2SetReal: %s = %g is not within %g to %g", v->name, value[i], v->min, v->max);
    }
    for (size_t i = 0; i < n; i++) memcpy(s->record + VARIABLES[vr[i]].offset, value + i, sizeof *value);
    CHANGED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[]) {
    SET_PROLOGUE("fmi2SetInteger");
    for (size_t i = 0; i < n; i++) {
        SETTABLE_VARIABLE("fmi2SetInteger", INTEGER);
        if (!(value[i] >= v->min && value[i] <= v->max))
            return fail(s, "fmi2SetInteger: %s = %d is not within %.0f to %.0f", v->name, value[i], v->min, v->max);
    }
    for (size_t i = 0; i < n; i++) memcpy(s->record + VARIABLES[vr[i]].offset, value + i, sizeof *value);
    CHANGED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[]) {
    SET_PROLOGUE("fmi2SetBoolean");
    for (size_t i = 0; i < n; i++) {
        SETTABLE_VARIABLE("fmi2SetBoolean", BOOLEAN);
    }
    for (size_t i = 0; i < n; i++) s->record[VARIABLES[vr[i]].offset] = value[i] != 0;
    CHANGED;
    return fmi2OK;
}

/* ---- packets: base64 text outside, bytes inside (RFC 4648 section 4, padding required, nothing else accepted) ------- */

static const char ALPHABET[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

static void encode(const unsigned char *bytes, size_t n, char *text) {
    size_t i = 0;
    for (; i + 2 < n; i += 3) {
        unsigned group = (unsigned)bytes[i] << 16 | (unsigned)bytes[i + 1] << 8 | bytes[i + 2];
        *text++ = ALPHABET[group >> 18];
        *text++ = ALPHABET[group >> 12 & 63];
        *text++ = ALPHABET[group >> 6 & 63];
        *text++ = ALPHABET[group & 63];
    }
    if (i < n) {
        unsigned group = (unsigned)bytes[i] << 16 | (i + 1 < n ? (unsigned)bytes[i + 1] << 8 : 0);
        *text++ = ALPHABET[group >> 18];
        *text++ = ALPHABET[group >> 12 & 63];
        *text++ = i + 1 < n ? ALPHABET[group >> 6 & 63] : '=';
        *text++ = '=';
    }
    *text = 0;
}

static int digit(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

/* Returns the number of bytes decoded, -1 for malformed text, -2 for more than `capacity`; stops at the first fault.
   With `bytes` NULL, it only counts. */
static long decode(const char *text, unsigned char *bytes, size_t capacity) {
    size_t n = 0;
    while (*text) {
        int a = digit(text[0]), b = a < 0 ? -1 : digit(text[1]);
        if (b < 0 || !text[2] || !text[3]) return -1;
        int last = text[3] == '=', pad = last ? 1 + (text[2] == '=') : 0;
        int x = pad == 2 ? 0 : digit(text[2]), y = pad ? 0 : digit(text[3]);
        if (x < 0 || y < 0 || (pad && text[4])) return -1;
        unsigned group = (unsigned)a << 18 | (unsigned)b << 12 | (unsigned)x << 6 | (unsigned)y;
        if (n + 3 - pad > capacity) return -2;
        if (bytes) {
            bytes[n] = group >> 16;
            if (pad < 2) bytes[n + 1] = group >> 8 & 255;
            if (pad < 1) bytes[n + 2] = group & 255;
        }
        n += 3 - pad;
        text += 4;
    }
    return (long)n;
}

EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    GET_PROLOGUE("fmi2GetString");
    for (size_t i = 0; i < n; i++) {
        VARIABLE("fmi2GetString", PACKETS);
        int32_t used;
        memcpy(&used, s->record + v->length, sizeof used);
        if (used < 0 || (size_t)used > v->capacity)
            return fail(s, "%s: the kernel reports %d bytes, its capacity is %d", v->name, (int)used, (int)v->capacity);
        encode(s->record + v->offset, (size_t)used, s->text + v->text);
        value[i] = s->text + v->text;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    SET_PROLOGUE("fmi2SetString");
    for (size_t i = 0; i < n; i++) {
        SETTABLE_VARIABLE("fmi2SetString", PACKETS);
        if (!value[i]) return fail(s, "fmi2SetString: %s: the text is NULL", v->name);
        long used = decode(value[i], NULL, v->capacity);
        if (used == -1) return fail(s, "fmi2SetString: %s: the text is not base64", v->name);
        if (used == -2) return fail(s, "fmi2SetString: %s holds %d bytes, the text has more", v->name, (int)v->capacity);
    }
    for (size_t i = 0; i < n; i++) {
        const Variable *v = VARIABLES + vr[i];
        int32_t used = (int32_t)decode(value[i], s->record + v->offset, v->capacity);
        memcpy(s->record + v->length, &used, sizeof used);
    }
    CHANGED;
    return fmi2OK;
}

/* ---- stepping -------------------------------------------------------------------------------------------------------- */

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_prior) {
    (void)no_set_prior;
    CALL("fmi2DoStep", STEP_COMPLETE);
    double slack = 1e-6 * h + 1e-12 * (t < 0 ? -t : t);
    if (!(h > 0.0) || !(h - h == 0.0)) return fail(s, "fmi2DoStep: the step size %g is not positive and finite", h);
    if (!(t - s->progress.time <= slack && s->progress.time - t <= slack))
        return fail(s, "fmi2DoStep: the communication point is %.9g, the FMU is at %.9g", t, s->progress.time);
    if (s->progress.has_stop && t + h > s->progress.stop + slack)
        return fail(s, "fmi2DoStep: %.9g + %.9g is after the stop time %.9g", t, h, s->progress.stop);
    /* With many instances, most records are not cached: prefetch all lines at once instead of one by one in the kernel. */
    for (size_t at = BUSY_FROM / LINE * LINE; at < BUSY_TO; at += LINE) __builtin_prefetch(s->record + at, 1);
    int code = 0;
    const char *const *exception = NULL;
    int raised = model_advance(&code, &exception, s->record, t, h);
    if (raised || code) return kernel_status(s, "advance", raised, exception, code);
    s->progress.time = t + h;
    return fmi2OK;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) {
    CALL("fmi2CancelStep", 0);
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    CALL("fmi2GetStatus", STEP_COMPLETE | TERMINATED | ERROR);
    NEEDS("fmi2GetStatus", value, 1);
    if (kind != fmi2DoStepStatus) return fail(s, "fmi2GetStatus: kind %d is not a status", (int)kind);
    *value = s->progress.mode == ERROR ? fmi2Error : fmi2OK;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    CALL("fmi2GetRealStatus", STEP_COMPLETE | TERMINATED | ERROR);
    NEEDS("fmi2GetRealStatus", value, 1);
    if (kind != fmi2LastSuccessfulTime) return fail(s, "fmi2GetRealStatus: kind %d is not a real", (int)kind);
    *value = s->progress.time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    CALL("fmi2GetIntegerStatus", STEP_COMPLETE | TERMINATED | ERROR);
    (void)value;
    return fail(s, "fmi2GetIntegerStatus: kind %d is not an integer", (int)kind);
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    CALL("fmi2GetBooleanStatus", STEP_COMPLETE | TERMINATED | ERROR);
    NEEDS("fmi2GetBooleanStatus", value, 1);
    if (kind != fmi2Terminated) return fail(s, "fmi2GetBooleanStatus: kind %d is not a boolean", (int)kind);
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    CALL("fmi2GetStringStatus", STEP_COMPLETE | TERMINATED | ERROR);
    NEEDS("fmi2GetStringStatus", value, 1);
    if (kind != fmi2PendingStatus) return fail(s, "fmi2GetStringStatus: kind %d is not a string", (int)kind);
    *value = "";
    return fmi2OK;
}

/* ---- not provided, as declared in modelDescription.xml ---------------------------------------------------------------- */

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]) {
    CALL("fmi2SetRealInputDerivatives", 0);
    (void)vr; (void)n; (void)order; (void)value;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]) {
    CALL("fmi2GetRealOutputDerivatives", 0);
    (void)vr; (void)n; (void)order; (void)value;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference z[], size_t nz, const fmi2ValueReference v[], size_t nv, const fmi2Real dv[], fmi2Real dz[]) {
    CALL("fmi2GetDirectionalDerivative", 0);
    (void)z; (void)nz; (void)v; (void)nv; (void)dv; (void)dz;
    return fmi2Error;
}

/* ---- FMU state ----------------------------------------------------------------------------------------------------------- */

/* fmi2GetFMUstate returns one block: the GUID, by which states of other FMUs are rejected, Progress, and the record.
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

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    CALL("fmi2GetFMUstate", ~0);
    NEEDS("fmi2GetFMUstate", state, 1);
    if (*state) {
        OWN_STATE("fmi2GetFMUstate", *state);
    } else if (!(*state = malloc(STATE_SIZE))) {
        return fail(s, "fmi2GetFMUstate: out of memory");
    }
    unsigned char *to = *state;
    memcpy(to, GUID, sizeof GUID);
    memcpy(to + PROGRESS_AT, &s->progress, sizeof s->progress);
    memcpy(to + RECORD_AT, s->record, RECORD_SIZE);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    CALL("fmi2SetFMUstate", ~0);
    OWN_STATE("fmi2SetFMUstate", state);
    const unsigned char *from = state;
    memcpy(&s->progress, from + PROGRESS_AT, sizeof s->progress);
    memcpy(s->record, from + RECORD_AT, RECORD_SIZE);
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    CALL("fmi2FreeFMUstate", ~0);
    if (state && *state) {
        OWN_STATE("fmi2FreeFMUstate", *state);
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    CALL("fmi2SerializedFMUstateSize", ~0);
    OWN_STATE("fmi2SerializedFMUstateSize", state);
    NEEDS("fmi2SerializedFMUstateSize", size, 1);
    *size = SERIALIZED_SIZE;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    CALL("fmi2SerializeFMUstate", ~0);
    OWN_STATE("fmi2SerializeFMUstate", state);
    NEEDS("fmi2SerializeFMUstate", bytes, 1);
    if (size < SERIALIZED_SIZE)
        return fail(s, "fmi2SerializeFMUstate: %zu bytes are too few, %zu are needed", size, SERIALIZED_SIZE);
    uint64_t sum = checksum(state, STATE_SIZE);
    memcpy(bytes, state, STATE_SIZE);
    memcpy(bytes + STATE_SIZE, &sum, sizeof sum);
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    CALL("fmi2DeSerializeFMUstate", ~0);
    NEEDS("fmi2DeSerializeFMUstate", state, 1);
    NEEDS("fmi2DeSerializeFMUstate", bytes, 1);
    if (size != SERIALIZED_SIZE || memcmp(bytes, GUID, sizeof GUID))
        return fail(s, "fmi2DeSerializeFMUstate: these %zu bytes are not a state of " MODEL " " GUID, size);
    uint64_t sum;
    memcpy(&sum, bytes + STATE_SIZE, sizeof sum);
    if (sum != checksum(bytes, STATE_SIZE)) return fail(s, "fmi2DeSerializeFMUstate: the bytes are damaged");
    if (*state) {
        OWN_STATE("fmi2DeSerializeFMUstate", *state);
    } else if (!(*state = malloc(STATE_SIZE))) {
        return fail(s, "fmi2DeSerializeFMUstate: out of memory");
    }
    memcpy(*state, bytes, STATE_SIZE);
    return fmi2OK;
}
