/* The calls that a master asks for in a message, and their answers: part of host.c and of portable.c.

   They provide `memory` with the messages, and map(), which makes room in it and may move it. */

#ifndef CALLS_H
#define CALLS_H

#include "channel.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#define LONGEST_MESSAGE 16384

static char *memory;
static void *functions[N_FUNCTIONS];
static struct {
    char *data;
    size_t room;
} scratch;

static Header *header(void) { return (Header *)memory; }

static void map(size_t least);
static void append_exception(char *message, size_t room);

static void *scratch_of(size_t bytes) {
    if (bytes > scratch.room) {
        free(scratch.data);
        scratch.data = malloc(bytes), scratch.room = scratch.data ? bytes : 0;
        if (scratch.data == NULL) abort();
    }
    return scratch.data;
}

/* ---- the FMU's log ----------------------------------------------------------------------------------------------- */

static void write_entry(int status, const char *category, const char *message) {
    Header *h = header();
    if (category == NULL) category = "";
    size_t n_category = strnlen(category, 255) + 1, n_message = strnlen(message, LONGEST_MESSAGE) + 1;
    size_t size = padded(sizeof(Entry) + n_category + n_message);
    if (h->log + size > LOG_BYTES) h->lost++, h->log = 0; /* the last lines count */
    Entry *e = (Entry *)(memory + HEADER_BYTES + h->log);
    e->owner = h->owner, e->status = status, e->category = (uint32_t)n_category, e->size = size;
    char *place = (char *)(e + 1);
    memset(place, 0, size - sizeof(Entry));
    memcpy(place, category, n_category - 1);
    memcpy(place + n_category, message, n_message - 1);
    h->log += size;
}

static void logger2(void *environment, const char *name, int status, const char *category, const char *format, ...) {
    (void)environment, (void)name;
    static char message[LONGEST_MESSAGE];
    va_list arguments;
    va_start(arguments, format);
    if (format == NULL) message[0] = 0;
    else if (strchr(format, '%') == NULL) snprintf(message, sizeof message, "%s", format);
    else vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    append_exception(message, sizeof message);
    write_entry(status, category, message);
}

static void logger3(void *environment, int status, const char *category, const char *text) {
    (void)environment;
    static char message[LONGEST_MESSAGE];
    snprintf(message, sizeof message, "%s", text ? text : "");
    append_exception(message, sizeof message);
    write_entry(status, category, message);
}

/* ---- calls ------------------------------------------------------------------------------------------------------- */

static const struct {
    void *logger, *allocate, *release, *finished, *environment;
} callbacks = {(void *)logger2, (void *)calloc, (void *)free, NULL, NULL};

static uint64_t instantiate(unsigned number, const char *arguments) {
    const uint64_t *options = (const uint64_t *)arguments;
    const char *name = arguments + 40, *guid = name + padded(strlen(name) + 1);
    const char *resources = guid + padded(strlen(guid) + 1);
    if (!options[4]) resources = NULL;
    bool logging = options[1] != 0, events = options[2] != 0, early = options[3] != 0;
    void *f = functions[number];
    if (f == NULL) return 0;
    if (number == NUMBER_fmi2Instantiate)
        return (uint64_t)((void *(*)(const char *, int, const char *, const char *, const void *, int, int))f)(
            name, (int)options[0], guid, resources, &callbacks, 0, logging);
    if (number == NUMBER_fmi3InstantiateModelExchange)
        return (uint64_t)((void *(*)(const char *, const char *, const char *, bool, bool, void *, void *))f)(
            name, guid, resources, false, logging, NULL, (void *)logger3);
    return (uint64_t)((void *(*)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *,
                                 size_t, void *, void *, void *))f)(
        name, guid, resources, false, logging, events, early, NULL, 0, NULL, (void *)logger3, NULL);
}

static int call(Shape shape, void *function, void *h, const Value *v) {
    Value a = v[0], b = v[1], c = v[2], d = v[3], e = v[4], f = v[5], g = v[6], i = v[7];
    (void)a, (void)b, (void)c, (void)d, (void)e, (void)f, (void)g, (void)i;
    switch (shape) {
#define SHAPE(name, parameters, arguments)                                                                             \
    case SHAPE_##name: return ((int(*) parameters)function)arguments;
        SHAPES
#undef SHAPE
    default: abort();
    }
}

/* Returns the bytes of the answer to an operation, and those of the pointers that its texts and Binaries need. */
static size_t room_for(const Function *f, const Value *values, size_t *pointers) {
    size_t bytes = sizeof(Answer);
    *pointers = 0;
    for (const Argument *a = f->arguments; a->type != A_END; a++)
        if (a->type == A_OUT || a->type == A_PLACE) bytes += padded(bytes_of(a, values));
        else if (a->type >= A_TEXTS_IN) *pointers += 8 * values[a->count].z;
    return bytes;
}

/* Points the arguments of an operation into the request, and those that the FMU fills into its answer, at `out`. */
static void decode(const Function *f, char *at, char *out, Value *values) {
    void **pointers = (void **)scratch.data;
    out += sizeof(Answer);
    for (int n = 0; f->arguments[n].type != A_END; n++) {
        const Argument *a = &f->arguments[n];
        size_t count = values[a->count].z;
        if (a->type == A_IN) {
            values[n].p = at, at += padded(bytes_of(a, values));
        } else if (a->type == A_OUT || a->type == A_PLACE) {
            size_t size = padded(bytes_of(a, values));
            values[n].p = out;
            if (a->type == A_OUT) memset(out, 0, size);
            else memcpy(out, at, size), at += size;
            out += size;
        } else if (a->type >= A_TEXTS_IN) {
            values[n].p = pointers;
            memset(pointers, 0, 8 * count);
            if (a->type == A_TEXTS_IN) {
                char *text = at + 8;
                for (size_t j = 0; j < count; j++) pointers[j] = text, text += strlen(text) + 1;
                at += 8 + padded(*(uint64_t *)at);
            } else if (a->type == A_BYTES_IN) {
                const size_t *sizes = values[n - 1].p;
                for (size_t j = 0; j < count; j++) pointers[j] = at, at += padded(sizes[j]);
            }
            pointers += count;
        }
    }
}

/* Appends the texts or Binaries that the FMU has returned to its answer, which ends at `at`; returns its new end. */
static size_t append_returned(const Function *f, const Value *values, size_t at) {
    for (int n = 0; f->arguments[n].type != A_END; n++) {
        const Argument *a = &f->arguments[n];
        if (a->type != A_TEXTS_OUT && a->type != A_BYTES_OUT) continue;
        const char **parts = values[n].p;
        size_t count = values[a->count].z, total = 0;
        const size_t *given = values[n - 1].p; /* sizes of Binaries; the answer may move */
        size_t *sizes = malloc(8 * (count + 1));
        if (sizes == NULL) abort();
        for (size_t j = 0; j < count; j++) {
            sizes[j] = a->type == A_BYTES_OUT ? (parts[j] ? given[j] : 0) : (parts[j] ? strlen(parts[j]) : 0) + 1;
            total += sizes[j];
        }
        map(at + 8 + padded(total));
        memset(memory + at, 0, 8 + padded(total));
        memcpy(memory + at, &total, 8);
        at += 8;
        char *place = memory + at;
        for (size_t j = 0; j < count; j++) {
            if (parts[j]) memcpy(place, parts[j], a->type == A_BYTES_OUT ? sizes[j] : sizes[j] - 1);
            place += sizes[j];
        }
        at += padded(total);
        free(sizes);
    }
    return at;
}

/* Executes the operation at `*from`, writes its answer at `*to`, and goes on to the next ones; returns its status. */
static int execute(uint32_t number, size_t *from, size_t *to, bool *eventful) {
    Operation head = *(Operation *)(memory + *from);
    if (head.function >= N_FUNCTIONS) abort();
    const Function *f = &TABLE[head.function];
    size_t arguments = *from + sizeof(Operation), pointers = 0, bytes = sizeof(Answer) + 8;
    Value values[ARGUMENTS + 1];
    memset(values, 0, sizeof values);
    if (f->kind != MAKE) {
        for (int n = 0; f->arguments[n].type != A_END; n++, arguments += 8)
            memcpy(&values[n], memory + arguments, 8);
        bytes = room_for(f, values, &pointers);
        scratch_of(pointers);
    }
    map(*to + bytes);
    header()->owner = head.owner;
    header()->running = 1 + head.function;
    int status = 0;
    size_t end = *to + bytes;
    if (f->kind == MAKE) {
        uint64_t handle = instantiate(head.function, memory + arguments);
        memcpy(memory + *to + sizeof(Answer), &handle, 8);
    } else if (functions[head.function] == NULL) {
        status = 3; /* the master asks only for functions that the library has */
    } else if (f->kind == FREE) {
        ((void (*)(void *))functions[head.function])((void *)head.handle);
    } else {
        decode(f, memory + arguments, memory + *to, values);
        status = call(f->shape, functions[head.function], (void *)head.handle, values);
        if (head.function == NUMBER_fmi3DoStep)
            *eventful = *(bool *)values[3].p || *(bool *)values[4].p || *(bool *)values[5].p;
        bool returned = status >= 0 && status <= WARNING;
        for (const Argument *a = f->arguments; a->type != A_END && !returned; a++)
            if (a->type == A_TEXTS_OUT || a->type == A_BYTES_OUT) memset(values[a - f->arguments].p, 0, 8 * values[a->count].z);
        end = append_returned(f, values, end);
    }
    header()->running = 0;
    Answer answer = {status, number, end - *to};
    memcpy(memory + *to, &answer, sizeof answer);
    *to = end, *from += head.size;
    return status;
}

/* Executes the operations of the request, and returns the end of their answers. */
static size_t execute_all(void) {
    size_t from = MESSAGES, last = MESSAGES + header()->request, to = reply_at(header());
    bool eventful = false, failed = false;
    uint64_t owner = 0;
    for (uint32_t number = 0; from < last; number++) {
        const Operation *next = (Operation *)(memory + from);
        if (next->owner != owner) owner = next->owner, eventful = failed = false;
        if (failed || (eventful && next->after_step)) {
            from += next->size;
            continue;
        }
        int status = execute(number, &from, &to, &eventful);
        __atomic_store_n(&header()->executed, header()->executed + 1, __ATOMIC_RELEASE);
        if (status == FATAL) break;
        failed = status < 0 || status > WARNING;
    }
    return to;
}

#endif
