/* FMI 2.0.5 co-simulation over a record and two kernels; see instance.h.

   A call that the state table of section 4.2.4 forbids, an unknown value reference, a wrong type, NaN or a value out of
   range returns fmi2Error. Packets are base64 text in a String. */

#include <math.h>
#include <stddef.h>

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

typedef fmi2Status Status;
typedef fmi2Boolean Boolean;
typedef fmi2Byte Byte;
typedef fmi2CallbackFunctions Environment;
#define OK fmi2OK
#define FAILURE fmi2Error
#define FMI(name) fmi2##name
#define STATE(verb, rest) fmi2##verb##FMUstate##rest
#define DESERIALIZE fmi2DeSerializeFMUstate

#include "instance.h"

static const char *const MODE_NAMES[] = {"instantiated", "initialization mode", "step complete", "terminated", "error"};

static void log_text(const Environment *callbacks, const char *name, const char *text) {
    char escaped[2048];
    size_t n = 0;
    if (!callbacks->logger) return;
    for (const char *c = text; *c && n < sizeof escaped - 3; c++) { /* the logger takes a printf format */
        if (*c == '%') escaped[n++] = '%';
        escaped[n++] = *c;
    }
    escaped[n] = 0;
    callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError", escaped);
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
        complain(functions, name, "fmi2Instantiate: wrong GUID %s, the binary of %s has %s", guid ? guid : "(NULL)", MODEL, GUID);
        return NULL;
    }
    return new_instance(name, *functions);
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                                      fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance; (void)tolerance;
    CALL("fmi2SetupExperiment", INSTANTIATED);
    return set_times(s, "fmi2SetupExperiment", start, has_stop != 0, stop);
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    CALL("fmi2EnterInitializationMode", INSTANTIATED);
    if (!s->progress.experiment) return fail(s, "fmi2EnterInitializationMode: call fmi2SetupExperiment first");
    s->progress.mode = INITIALIZATION;
    return fmi2OK;
}

/* ---- values ---------------------------------------------------------------------------------------------------------- */

static const char *KIND_NAMES[] = {"Real", "Integer", "Boolean", "String"};
#define READABLE (INITIALIZATION | STEP | TERMINATED | ERROR)

static fmi2Status unknown(Instance *s, const char *function, fmi2ValueReference vr, Kind kind) {
    if (vr >= N_VARIABLES) return fail(s, "%s: value reference %u, there are 0 to %u", function, vr, N_VARIABLES - 1);
    return fail(s, "%s: value reference %u is %s, a %s, not a %s", function, vr, VARIABLES[vr].name,
                KIND_NAMES[VARIABLES[vr].kind], KIND_NAMES[kind]);
}

#define GET_PROLOGUE(function)                                                                                         \
    CALL(function, READABLE);                                                                                          \
    NEEDS(function, vr, n);                                                                                            \
    NEEDS(function, value, n);                                                                                         \
    START_TO_READ
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
/* Returns how many of `n` Reals from `vr[0]` on are neighbours in the record as well, of one role and without limits: 1 or
   more. Masters get and set whole arrays in each step, which are then checked and copied at once. */
static size_t together(const fmi2ValueReference vr[], size_t n) {
    size_t most = TOGETHER[vr[0]] < n ? TOGETHER[vr[0]] : n, number = 1;
    while (number < most && vr[number] == vr[0] + (fmi2ValueReference)number) number++;
    return number;
}

EXPORT fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    GET_PROLOGUE("fmi2GetReal");
    for (size_t i = 0, number; i < n; i += number) {
        VARIABLE("fmi2GetReal", REAL);
        number = together(vr + i, n - i);
        memcpy(value + i, s->record + v->offset, number * sizeof *value);
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

/* Returns whether each of `n` values is within limits; a NaN is not. */
static int are_within(const fmi2Real value[], size_t n, fmi2Real min, fmi2Real max) {
    int64_t outside = 0; /* as wide as a Real, so that the loops test several at a time */
    if (min == -INFINITY && max == INFINITY)
        for (size_t i = 0; i < n; i++) outside |= value[i] != value[i];
    else
        for (size_t i = 0; i < n; i++) outside |= !(value[i] >= min) | !(value[i] <= max);
    return !outside;
}

EXPORT fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    SET_PROLOGUE("fmi2SetReal");
    size_t number = 0;
    for (size_t i = 0; i < n; i += number) {
        SETTABLE_VARIABLE("fmi2SetReal", REAL);
        number = together(vr + i, n - i);
        if (are_within(value + i, number, v->min, v->max)) continue;
        while (are_within(value + i, 1, v->min, v->max)) i++;
        return fail(s, "fmi2SetReal: %s = %g is not within %g to %g", VARIABLES[vr[i]].name, value[i], v->min, v->max);
    }
    if (n && number == n) memcpy(s->record + VARIABLES[vr[0]].offset, value, n * sizeof *value);
    else for (size_t i = 0; i < n; i++) memcpy(s->record + VARIABLES[vr[i]].offset, value + i, sizeof *value);
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

/* The values of the characters; BAD marks those outside the alphabet. */
#define BAD 128
static const unsigned char DIGIT[256] = {
    [0 ... 255] = BAD,
    ['A'] = 0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25,
    ['a'] = 26, 27, 28, 29, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 43, 44, 45, 46, 47, 48, 49, 50, 51,
    ['0'] = 52, 53, 54, 55, 56, 57, 58, 59, 60, 61, ['+'] = 62, ['/'] = 63,
};

/* Returns the number of bytes decoded, -1 for malformed text, -2 for more than `capacity`; stops at the first fault.
   With `bytes` NULL, it only counts. */
static long decode(const char *from, unsigned char *bytes, size_t capacity) {
    const unsigned char *text = (const unsigned char *)from;
    size_t n = 0;
    size_t groups = strlen(from) / 4;
    if (groups > capacity / 3) groups = capacity / 3;
    for (; groups > 0; groups--, text += 4, n += 3) {
        unsigned a = DIGIT[text[0]], b = DIGIT[text[1]], x = DIGIT[text[2]], y = DIGIT[text[3]];
        if ((a | b | x | y) & BAD) break;
        if (!bytes) continue;
        unsigned group = a << 18 | b << 12 | x << 6 | y;
        bytes[n] = group >> 16, bytes[n + 1] = group >> 8 & 255, bytes[n + 2] = group & 255;
    }
    /* What is left: padding, faults, bytes that do not fit. */
    while (*text) {
        unsigned a = DIGIT[text[0]], b = a & BAD ? BAD : DIGIT[text[1]];
        if (b & BAD || !text[2] || !text[3]) return -1;
        int last = text[3] == '=', pad = last ? 1 + (text[2] == '=') : 0;
        unsigned x = pad == 2 ? 0 : DIGIT[text[2]], y = pad ? 0 : DIGIT[text[3]];
        if ((x | y) & BAD || (pad && text[4])) return -1;
        unsigned group = a << 18 | b << 12 | x << 6 | y;
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

static fmi2String text_of(Instance *s, const Variable *v, int32_t used) {
    if (!used) return ""; /* as in most steps: with many instances, the text is not cached */
    encode(s->record + v->offset, (size_t)used, s->text + v->text);
    return s->text + v->text;
}

EXPORT fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]) {
    GET_PROLOGUE("fmi2GetString");
    for (size_t i = 0; i < n; i++) {
        VARIABLE("fmi2GetString", PACKETS);
        USED_BYTES(v);
        value[i] = text_of(s, v, used);
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]) {
    SET_PROLOGUE("fmi2SetString");
    for (size_t i = 0; i < n; i++) {
        SETTABLE_VARIABLE("fmi2SetString", PACKETS);
        if (!value[i]) return fail(s, "fmi2SetString: %s: the text is NULL", v->name);
        long used = decode(value[i], NULL, v->count);
        if (used == -1) return fail(s, "fmi2SetString: %s: the text is not base64", v->name);
        if (used == -2) return fail(s, "fmi2SetString: %s holds %d bytes, the text has more", v->name, (int)v->count);
    }
    for (size_t i = 0; i < n; i++) {
        const Variable *v = VARIABLES + vr[i];
        int32_t used = (int32_t)decode(value[i], s->record + v->offset, v->count);
        memcpy(s->record + v->length, &used, sizeof used);
    }
    CHANGED;
    return fmi2OK;
}

/* ---- stepping -------------------------------------------------------------------------------------------------------- */

EXPORT fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_prior) {
    (void)no_set_prior;
    CALL("fmi2DoStep", STEP);
    return advance(s, "fmi2DoStep", t, h);
}

/* ---- whole steps ----------------------------------------------------------------------------------------------------- */

/* In each step, a master sets the same inputs and gets the same outputs of many instances of this FMU. It may do so in one
   call: `uav_cosim_note_step` notes once where the values are in the record, and `uav_cosim_make_step` sets, steps and gets.
   Packets are bytes in it, and not text. */

enum { SET_REALS, SET_INTEGERS, SET_BOOLEANS, SET_PACKETS, GET_REALS, GET_INTEGERS, GET_BOOLEANS, GET_PACKETS, GROUPS };
typedef struct {
    double min, max;
    uint32_t offset; /* into the record; of packets: into VARIABLES */
    uint32_t count;  /* values in a row */
} Move;
typedef struct {
    uint32_t moves[GROUPS];
    Move move[];
} Moves;
typedef struct { /* got: in the record, until its instance is called again */
    const unsigned char *bytes;
    uint64_t size;
} Packets;
typedef struct { /* of one instance, written by the master: values of each group in a row */
    Instance *instance;
    const Moves *moves;
    const fmi2Real *set_reals;
    const fmi2Integer *set_integers;
    const fmi2Boolean *set_booleans;
    const Packets *set_packets;
    fmi2Real *get_reals;
    fmi2Integer *get_integers;
    fmi2Boolean *get_booleans;
    Packets *get_packets;
} Exchange;
enum { NOT_BEGUN = -1, NOT_READ = -2 }; /* instead of a status: no step is made, or its outputs are not got. The calls of FMI say why */

/* Writes the places of the variables `vr`, numbers[g] of group g, to memory of `sizeof(Moves)` and a Move for each. Returns
   0, or 1 if one of them is not of its group's type, or cannot be set in a step. */
EXPORT int uav_cosim_note_step(const uint32_t numbers[GROUPS], const fmi2ValueReference vr[], Moves *to) {
    static const Kind kinds[] = {REAL, INTEGER, BOOLEAN, PACKETS, REAL, INTEGER, BOOLEAN, PACKETS};
    static const size_t sizes[] = {sizeof(fmi2Real), sizeof(fmi2Integer), 1}; /* in the record */
    Move *move = to->move;
    for (int g = 0; g < GROUPS; g++) {
        Move *first = move;
        for (uint32_t i = 0; i < numbers[g]; i++, vr++) {
            if (*vr >= N_VARIABLES || VARIABLES[*vr].kind != kinds[g]) return 1;
            const Variable *v = VARIABLES + *vr;
            if (g < GET_REALS && v->role != INPUT && v->role != TUNABLE) return 1;
            Move own = {v->min, v->max, kinds[g] == PACKETS ? *vr : (uint32_t)v->offset, 1};
            Move *last = move > first && kinds[g] != PACKETS ? move - 1 : NULL;
            if (last && last->min == own.min && last->max == own.max &&
                last->offset + last->count * sizes[kinds[g]] == own.offset)
                last->count++;
            else
                *move++ = own;
        }
        to->moves[g] = (uint32_t)(move - first);
    }
    return 0;
}

/* Makes a step. `with_packets`: sets packets, too; otherwise, they stay as they are. */
EXPORT int uav_cosim_make_step(const Exchange *x, fmi2Real t, fmi2Real h, int32_t with_packets) {
    Instance *s = x->instance;
    if (s->progress.mode != STEP) return NOT_BEGUN;
    unsigned char *record = s->record;
    const uint32_t *moves = x->moves->moves;
    const Move *move = x->moves->move, *end;
    int outside = 0;
    const fmi2Real *real = x->set_reals;
    for (end = move + moves[SET_REALS]; move < end; real += move++->count) {
        outside |= !are_within(real, move->count, move->min, move->max);
        memcpy(record + move->offset, real, move->count * sizeof *real);
    }
    const fmi2Integer *integer = x->set_integers;
    for (end = move + moves[SET_INTEGERS]; move < end; integer += move++->count)
        for (uint32_t i = 0; i < move->count; i++) {
            outside |= !(integer[i] >= move->min) | !(integer[i] <= move->max);
            memcpy(record + move->offset + i * sizeof *integer, integer + i, sizeof *integer);
        }
    const fmi2Boolean *boolean = x->set_booleans;
    for (end = move + moves[SET_BOOLEANS]; move < end; boolean += move++->count)
        for (uint32_t i = 0; i < move->count; i++) record[move->offset + i] = boolean[i] != 0;
    const Packets *given = x->set_packets;
    for (end = move + moves[SET_PACKETS]; move < end; move++, given++) {
        const Variable *v = VARIABLES + move->offset;
        if (!with_packets) continue;
        if (given->size > v->count) return NOT_BEGUN;
        int32_t used = (int32_t)given->size;
        memcpy(record + v->offset, given->bytes, given->size);
        memcpy(record + v->length, &used, sizeof used);
    }
    if (outside) return NOT_BEGUN;
    Status status = advance(s, "fmi2DoStep", t, h);
    if (status != OK) return status;
    fmi2Real *real_out = x->get_reals;
    for (end = move + moves[GET_REALS]; move < end; real_out += move++->count)
        memcpy(real_out, record + move->offset, move->count * sizeof *real_out);
    fmi2Integer *integer_out = x->get_integers;
    for (end = move + moves[GET_INTEGERS]; move < end; integer_out += move++->count)
        memcpy(integer_out, record + move->offset, move->count * sizeof *integer_out);
    fmi2Boolean *boolean_out = x->get_booleans;
    for (end = move + moves[GET_BOOLEANS]; move < end; boolean_out += move++->count)
        for (uint32_t i = 0; i < move->count; i++) boolean_out[i] = record[move->offset + i] != 0;
    Packets *got = x->get_packets;
    for (end = move + moves[GET_PACKETS]; move < end; move++) {
        const Variable *v = VARIABLES + move->offset;
        int32_t used;
        memcpy(&used, record + v->length, sizeof used);
        if (used < 0 || (size_t)used > v->count) return NOT_READ;
        *got++ = (Packets){record + v->offset, (uint64_t)used};
    }
    return OK;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component c) {
    CALL("fmi2CancelStep", 0);
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    CALL("fmi2GetStatus", STEP | TERMINATED | ERROR);
    NEEDS("fmi2GetStatus", value, 1);
    if (kind != fmi2DoStepStatus) return fail(s, "fmi2GetStatus: kind %d is not a status", (int)kind);
    *value = s->progress.mode == ERROR ? fmi2Error : fmi2OK;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    CALL("fmi2GetRealStatus", STEP | TERMINATED | ERROR);
    NEEDS("fmi2GetRealStatus", value, 1);
    if (kind != fmi2LastSuccessfulTime) return fail(s, "fmi2GetRealStatus: kind %d is not a real", (int)kind);
    *value = s->progress.time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    CALL("fmi2GetIntegerStatus", STEP | TERMINATED | ERROR);
    (void)value;
    return fail(s, "fmi2GetIntegerStatus: kind %d is not an integer", (int)kind);
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    CALL("fmi2GetBooleanStatus", STEP | TERMINATED | ERROR);
    NEEDS("fmi2GetBooleanStatus", value, 1);
    if (kind != fmi2Terminated) return fail(s, "fmi2GetBooleanStatus: kind %d is not a boolean", (int)kind);
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    CALL("fmi2GetStringStatus", STEP | TERMINATED | ERROR);
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
