/* An instance of a compiled FMU: a record, two kernels and the progress of a simulation. fmi2.c and fmi3.c include it.

   The memory of an instance is one record, and a variable is an offset into it (model.h). Therefore instances share
   nothing, saving the state is one memcpy, and these files are independent of the model. A call in a state that forbids it, or with a wrong argument, returns the status Error with a message, sets
   nothing, and puts the instance into the error state, as does a failed kernel. The error state permits only reading,
   resetting, restoring an FMU state, and freeing the instance.

   The including file defines:
       FMI(name), STATE(verb, rest), DESERIALIZE   the names of functions of its version of FMI
       Status, OK, FAILURE                         the status of a call, and two of its values
       Boolean, Byte                               types of arguments
       Environment                                 the part of an instance by which it logs
       log_text, MODE_NAMES                        see below */

#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef WITHOUT_STARTUP
#include "windows.h"
#endif

#define NAME_(function) #function
#define NAME(function) NAME_(function)

#include "model.h"

#define LINE 64 /* bytes of a cache line */

/* They return 0, or nonzero if the kernel raised an exception; then `exception` points to its text, a format for index_text.
   `code` is the kernel's return value. */
extern int model_start(int *code, const char *const **exception, void *record);
extern int model_advance(int *code, const char *const **exception, void *record, double t, double h);

typedef enum { INSTANTIATED = 1, INITIALIZATION = 2, STEP = 4, TERMINATED = 8, ERROR = 16 } Mode;
#define ANY (~0)

/* The part of the FMU state that is not in the record. */
typedef struct {
    Mode mode;
    int started;    /* `start` has run since the last value was set */
    int experiment; /* the times are set */
    int has_stop;
    double time, stop;
} Progress;
typedef struct {
    unsigned char *record; /* begins a cache line; like text and name in the memory of the instance, so that thousands lie close */
    Progress progress;
    int fresh; /* the record is as `reset` leaves it, except for its head */
    char *text;
    char *name;
    Environment environment;
} Instance;
#define RECORD_LINES ((RECORD_SIZE + LINE - 1) / LINE)

/* ---- messages -------------------------------------------------------------------------------------------------------- */

static void log_text(const Environment *environment, const char *name, const char *text);
static const char *const MODE_NAMES[5];

static const char *mode_name(Mode mode) {
    size_t i = 0;
    while (i < 4 && mode != 1 << i) i++;
    return MODE_NAMES[i];
}

static void complain(const Environment *environment, const char *name, const char *format, ...) {
    char text[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    log_text(environment, name, text);
}

static Status fail(Instance *s, const char *format, ...) {
    char text[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    log_text(&s->environment, s->name, text);
    s->progress.mode = ERROR;
    return FAILURE;
}

/* Returns from the calling function unless the instance exists and is in one of `modes`. */
#define CALL(function, modes)                                                                                          \
    Instance *s = (Instance *)c;                                                                                       \
    if (!s) return FAILURE;                                                                                            \
    if (!(s->progress.mode & (modes)))                                                                                 \
        return fail(s, "%s is not allowed in state %s", function, mode_name(s->progress.mode))
#define NEEDS(function, pointer, n)                                                                                    \
    if ((n) && !(pointer)) return fail(s, "%s: %s is NULL", function, #pointer)

/* ---- instances ------------------------------------------------------------------------------------------------------- */

/* Pages without a start value other than 0 are left alone in a new instance, whose memory is 0: the system then gives it
   no memory for tables that a simulation does not use. */
#define PAGE 4096
static void begin(Instance *s) {
    for (size_t at = 0; at < RECORD_SIZE; at += PAGE) {
        size_t size = RECORD_SIZE - at < PAGE ? RECORD_SIZE - at : PAGE, i = 0;
        while (i < size && !DEFAULTS[at + i]) i++;
        if (i < size) memcpy(s->record + at, DEFAULTS + at, size);
    }
    s->progress.mode = INSTANTIATED;
    s->fresh = 1;
}

static void reset(Instance *s) {
    memcpy(s->record, DEFAULTS, RECORD_SIZE);
    memset(&s->progress, 0, sizeof s->progress);
    s->progress.mode = INSTANTIATED;
    s->fresh = 1;
}

/* Returns the place of the record, which follows from the address of the instance: no memory is read. */
static unsigned char *record_of(Instance *s) {
    return (unsigned char *)(((uintptr_t)(s + 1) + LINE - 1) / LINE * LINE);
}

static Instance *new_instance(const char *name, Environment environment) {
    Instance *s = calloc(1, sizeof *s + LINE + RECORD_LINES * LINE + TEXT_SIZE + 1 + strlen(name) + 1);
    if (!s) return NULL;
    s->environment = environment;
    s->record = record_of(s);
    s->text = (char *)s->record + RECORD_LINES * LINE;
    s->name = s->text + TEXT_SIZE + 1;
    strcpy(s->name, name);
    begin(s);
    return s;
}

EXPORT void FMI(FreeInstance)(void *c) { free(c); }

EXPORT Status FMI(SetDebugLogging)(void *c, Boolean on, size_t n, const char *const categories[]) {
    CALL(NAME(FMI(SetDebugLogging)), ANY);
    NEEDS(NAME(FMI(SetDebugLogging)), categories, n);
    for (size_t i = 0; i < n; i++)
        if (!categories[i] || strcmp(categories[i], "logStatusError"))
            return fail(s, NAME(FMI(SetDebugLogging)) ": unknown category %s, there is logStatusError",
                        categories[i] ? categories[i] : "(NULL)");
    (void)on; /* only errors are logged */
    return OK;
}

/* ---- kernels --------------------------------------------------------------------------------------------------------- */

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

static void index_text(char *text, size_t room, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, room, format, arguments);
    va_end(arguments);
}

static Status kernel_status(Instance *s, const char *what, int raised, const char *const *exception, int code) {
    if (raised) {
        char text[1024] = "the kernel raised an exception";
        long long index = failed_index, length = failed_length;
        if (raised > 0 && exception && *exception)
            index_text(text, sizeof text, *exception, index, length, -length, length - 1);
        return fail(s, "%s: %s", what, text);
    }
    if (!code) return OK;
    for (size_t i = 0; i < N_ERRORS; i++)
        if (ERRORS[i].code == code) return fail(s, "%s: %s (code %d)", what, ERRORS[i].text, code);
    return fail(s, "%s returned %d; it returns 0, or a key of errors (%s)", what, code, ERROR_CODES);
}

/* In Initialization Mode `start` runs once before values are read after others were set. */
static Status ensure_started(Instance *s) {
    if (s->progress.started) return OK;
    if (!s->fresh) memcpy(s->record + HEAD_SIZE, DEFAULTS + HEAD_SIZE, RECORD_SIZE - HEAD_SIZE);
    s->fresh = 0;
    s->progress.started = 1;
    int code = 0;
    const char *const *exception = NULL;
    int raised = model_start(&code, &exception, s->record);
    return kernel_status(s, "start", raised, exception, code);
}

/* A hint that this instance will soon make a step: its memory comes nearer while another instance makes its step. With
   many instances, most records are not cached; all lines are asked for at once instead of one by one in the kernel. */
EXPORT void uav_cosim_expect(void *c) {
    __builtin_prefetch(c, 1);
    __builtin_prefetch(&((Instance *)c)->text, 1); /* it may be in the next line */
    const unsigned char *record = record_of((Instance *)c);
    for (size_t at = BUSY_FROM / LINE * LINE; at < BUSY_TO; at += LINE) __builtin_prefetch(record + at, 1);
}

static Status advance(Instance *s, const char *function, double t, double h) {
    double slack = 1e-6 * h + 1e-12 * (t < 0 ? -t : t);
    if (!(h > 0.0) || !(h - h == 0.0)) return fail(s, "%s: the step size %g is not positive and finite", function, h);
    if (!(t - s->progress.time <= slack && s->progress.time - t <= slack))
        return fail(s, "%s: the communication point is %.9g, the FMU is at %.9g", function, t, s->progress.time);
    if (s->progress.has_stop && t + h > s->progress.stop + slack)
        return fail(s, "%s: %.9g + %.9g is after the stop time %.9g", function, t, h, s->progress.stop);
    int code = 0;
    const char *const *exception = NULL;
    int raised = model_advance(&code, &exception, s->record, t, h);
    if (raised || code) return kernel_status(s, "advance", raised, exception, code);
    s->progress.time = t + h;
    return OK;
}

/* ---- states of a simulation ------------------------------------------------------------------------------------------ */

static Status set_times(Instance *s, const char *function, double start, int has_stop, double stop) {
    if (!(start - start == 0.0)) return fail(s, "%s: start time %g is not finite", function, start);
    if (has_stop && !(stop >= start)) return fail(s, "%s: stop time %g lies before start time %g", function, stop, start);
    s->progress.time = start;
    s->progress.has_stop = has_stop;
    s->progress.stop = stop;
    s->progress.experiment = 1;
    return OK;
}

EXPORT Status FMI(ExitInitializationMode)(void *c) {
    CALL(NAME(FMI(ExitInitializationMode)), INITIALIZATION);
    Status status = ensure_started(s);
    if (status == OK) s->progress.mode = STEP;
    return status;
}

EXPORT Status FMI(Terminate)(void *c) {
    CALL(NAME(FMI(Terminate)), STEP);
    s->progress.mode = TERMINATED;
    return OK;
}

EXPORT Status FMI(Reset)(void *c) {
    CALL(NAME(FMI(Reset)), ANY);
    reset(s);
    return OK;
}

/* ---- values ---------------------------------------------------------------------------------------------------------- */

#define SETTABLE (INSTANTIATED | INITIALIZATION | STEP)

/* FMI 2.0.5, section 4.2.4, omits inputs in "instantiated"; FMPy and others set them there. */
static int settable(const Instance *s, const Variable *v) {
    return v->role == TUNABLE || v->role == INPUT || (v->role == FIXED && s->progress.mode != STEP);
}

static Status refuse(Instance *s, const char *function, const Variable *v) {
    static const char *roles[] = {"a fixed parameter", "a tunable parameter", "an input", "calculated by the FMU"};
    return fail(s, "%s: %s is %s and cannot be set in state %s", function, v->name, roles[v->role], mode_name(s->progress.mode));
}

/* Returns the number of bytes of packets; fails if the kernel reports an impossible one. */
#define USED_BYTES(v)                                                                                                  \
    int32_t used;                                                                                                      \
    memcpy(&used, s->record + v->length, sizeof used);                                                                 \
    if (used == -1)                                                                                                    \
    return fail(s, "%s: a packet does not fit into its %d bytes, or its message is not in the dialect; send less in "  \
                   "a step, or give it a larger capacity", v->name, (int)v->count);                                    \
    if (used < 0 || (size_t)used > v->count)                                                                           \
    return fail(s, "%s: the kernel reports %d bytes, its capacity is %d", v->name, (int)used, (int)v->count)

#define START_TO_READ                                                                                                  \
    if (s->progress.mode == INITIALIZATION) {                                                                          \
        Status status = ensure_started(s);                                                                             \
        if (status != OK) return status;                                                                               \
    }
#define CHANGED                                                                                                        \
    if (s->progress.mode != STEP) s->progress.started = 0

/* ---- FMU state ------------------------------------------------------------------------------------------------------- */

/* An FMU state is one block: the GUID, by which states of other FMUs are rejected, Progress, and the record. It can be
   restored in any instance of this FMU. The serialised form ends with a checksum. */
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
    if (memcmp(state, GUID, sizeof GUID)) return fail(s, "%s: this is not a state of %s %s", function, MODEL, GUID)

EXPORT Status STATE(Get, )(void *c, void **state) {
    CALL(NAME(STATE(Get, )), ANY);
    NEEDS(NAME(STATE(Get, )), state, 1);
    if (*state) {
        OWN_STATE(NAME(STATE(Get, )), *state);
    } else if (!(*state = malloc(STATE_SIZE))) {
        return fail(s, NAME(STATE(Get, )) ": out of memory");
    }
    unsigned char *to = *state;
    memcpy(to, GUID, sizeof GUID);
    memcpy(to + PROGRESS_AT, &s->progress, sizeof s->progress);
    memcpy(to + RECORD_AT, s->record, RECORD_SIZE);
    return OK;
}

EXPORT Status STATE(Set, )(void *c, void *state) {
    CALL(NAME(STATE(Set, )), ANY);
    OWN_STATE(NAME(STATE(Set, )), state);
    const unsigned char *from = state;
    memcpy(&s->progress, from + PROGRESS_AT, sizeof s->progress);
    memcpy(s->record, from + RECORD_AT, RECORD_SIZE);
    s->fresh = 0;
    return OK;
}

EXPORT Status STATE(Free, )(void *c, void **state) {
    CALL(NAME(STATE(Free, )), ANY);
    if (state && *state) {
        OWN_STATE(NAME(STATE(Free, )), *state);
        free(*state);
        *state = NULL;
    }
    return OK;
}

EXPORT Status STATE(Serialized, Size)(void *c, void *state, size_t *size) {
    CALL(NAME(STATE(Serialized, Size)), ANY);
    OWN_STATE(NAME(STATE(Serialized, Size)), state);
    NEEDS(NAME(STATE(Serialized, Size)), size, 1);
    *size = SERIALIZED_SIZE;
    return OK;
}

EXPORT Status STATE(Serialize, )(void *c, void *state, Byte bytes[], size_t size) {
    CALL(NAME(STATE(Serialize, )), ANY);
    OWN_STATE(NAME(STATE(Serialize, )), state);
    NEEDS(NAME(STATE(Serialize, )), bytes, 1);
    if (size < SERIALIZED_SIZE)
        return fail(s, NAME(STATE(Serialize, )) ": %zu bytes are too few, %zu are needed", size, SERIALIZED_SIZE);
    uint64_t sum = checksum(state, STATE_SIZE);
    memcpy(bytes, state, STATE_SIZE);
    memcpy(bytes + STATE_SIZE, &sum, sizeof sum);
    return OK;
}

EXPORT Status DESERIALIZE(void *c, const Byte bytes[], size_t size, void **state) {
    CALL(NAME(DESERIALIZE), ANY);
    NEEDS(NAME(DESERIALIZE), state, 1);
    NEEDS(NAME(DESERIALIZE), bytes, 1);
    if (size != SERIALIZED_SIZE || memcmp(bytes, GUID, sizeof GUID))
        return fail(s, NAME(DESERIALIZE) ": these %zu bytes are not a state of %s %s", size, MODEL, GUID);
    uint64_t sum;
    memcpy(&sum, bytes + STATE_SIZE, sizeof sum);
    if (sum != checksum(bytes, STATE_SIZE)) return fail(s, NAME(DESERIALIZE) ": the bytes are damaged");
    if (*state) {
        OWN_STATE(NAME(DESERIALIZE), *state);
    } else if (!(*state = malloc(STATE_SIZE))) {
        return fail(s, NAME(DESERIALIZE) ": out of memory");
    }
    memcpy(*state, bytes, STATE_SIZE);
    return OK;
}
