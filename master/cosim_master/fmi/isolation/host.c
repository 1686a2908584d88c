/* The process of an FMU file: loads its library, and makes the calls that the master sends (see channel.h).

   It is a program, and a function for a Python interpreter, which Python FMUs need:

     host FILE LIBRARY PARENT MEMORY RESTRICTED FOLDER...

     FILE        descriptor of the shared memory
     LIBRARY     the binary of the FMU
     PARENT      process id of the master; this process ends with it
     MEMORY      limit of its memory in bytes, 0 for none
     RESTRICTED  1: it may write into the FOLDERs only, and open no sockets */

#include "channel.h"
#include "restrict.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))
#define LONGEST_MESSAGE 16384

static char *memory;
static size_t mapped;
static int file;
static void *functions[N_FUNCTIONS];
static struct {
    char *data;
    size_t room;
} scratch;

static Header *header(void) { return (Header *)memory; }

/* Makes room for `least` bytes of shared memory; ends the process if there is none. */
static void map(size_t least) {
    Header *h = header();
    if (h->size < least) {
        uint64_t size = h->size;
        while (size < least) size *= 2;
        if (size > LARGEST || ftruncate(file, (off_t)size) != 0) abort();
        h->size = size;
    }
    if (h->size <= mapped) return;
    void *new = mremap(memory, mapped, h->size, MREMAP_MAYMOVE);
    if (new == MAP_FAILED) abort();
    memory = new, mapped = header()->size;
}

static void *scratch_of(size_t bytes) {
    if (bytes > scratch.room) {
        free(scratch.data);
        scratch.data = malloc(bytes), scratch.room = scratch.data ? bytes : 0;
        if (scratch.data == NULL) abort();
    }
    return scratch.data;
}

/* ---- the FMU's log ----------------------------------------------------------------------------------------------- */

/* Appends the exception that a Python FMU has raised before it logs, which its message may not contain. With a pending
   exception, Python goes on until its next call, which then fails: the exception is cleared. */
static void append_exception(char *message, size_t room) {
    void *(*occurred)(void) = (void *(*)(void))dlsym(RTLD_DEFAULT, "PyErr_Occurred");
    int (*holds)(void) = (int (*)(void))dlsym(RTLD_DEFAULT, "PyGILState_Check");
    if (occurred == NULL || holds == NULL || !holds() || !occurred()) return;
    void (*fetch)(void **, void **, void **) = (void (*)(void **, void **, void **))dlsym(RTLD_DEFAULT, "PyErr_Fetch");
    void (*normalize)(void **, void **, void **) =
        (void (*)(void **, void **, void **))dlsym(RTLD_DEFAULT, "PyErr_NormalizeException");
    void *(*text_of)(void *) = (void *(*)(void *))dlsym(RTLD_DEFAULT, "PyObject_Str");
    const char *(*utf8)(void *) = (const char *(*)(void *))dlsym(RTLD_DEFAULT, "PyUnicode_AsUTF8");
    void *(*attribute)(void *, const char *) =
        (void *(*)(void *, const char *))dlsym(RTLD_DEFAULT, "PyObject_GetAttrString");
    void (*clear)(void) = (void (*)(void))dlsym(RTLD_DEFAULT, "PyErr_Clear");
    if (!fetch || !normalize || !text_of || !utf8 || !attribute || !clear) return;
    void *type, *value, *trace;
    fetch(&type, &value, &trace);
    normalize(&type, &value, &trace);
    void *name = attribute(type, "__name__"), *said = text_of(value);
    const char *kind = name ? utf8(name) : NULL, *text = said ? utf8(said) : NULL;
    size_t used = strlen(message);
    if (kind && text && !strstr(message, text) && used + 1 < room)
        snprintf(message + used, room - used, "%s%s: %s", used ? "\n" : "", kind, text);
    clear();
}

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

static void serve(void) {
    for (;;) {
        uint32_t *turn = &header()->turn;
        while (__atomic_load_n(turn, __ATOMIC_ACQUIRE) != OF_FMU)
            syscall(SYS_futex, turn, FUTEX_WAIT, OF_MASTER, NULL, NULL, 0);
        if (header()->quit) return;
        map(0);
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
        __atomic_store_n(&header()->turn, OF_MASTER, __ATOMIC_RELEASE);
        syscall(SYS_futex, &header()->turn, FUTEX_WAKE, 1, NULL, NULL, 0);
    }
}

/* ---- the process ------------------------------------------------------------------------------------------------- */

static uint64_t memory_in_use(void) {
    char text[256];
    int statm = open("/proc/self/statm", O_RDONLY);
    ssize_t n = statm < 0 ? 0 : read(statm, text, sizeof text - 1);
    if (statm >= 0) close(statm);
    text[n > 0 ? n : 0] = 0;
    char *field = text;
    for (int skipped = 0; skipped < 5 && field; skipped++) field = strchr(field + 1, ' '); /* data */
    return field ? strtoull(field, NULL, 10) * (uint64_t)sysconf(_SC_PAGESIZE) : 0;
}

/* Records what is known when the FMU crashes; the signal then ends the process. */
static void crashed(int number) {
    header()->signal = (uint32_t)number;
    header()->memory = memory_in_use();
    signal(number, SIG_DFL);
    raise(number);
}

static void catch_crashes(void) {
    static char stack[65536];
    stack_t other = {.ss_sp = stack, .ss_flags = 0, .ss_size = sizeof stack};
    sigaltstack(&other, NULL); /* also after an overflow of the stack */
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = crashed, action.sa_flags = (int)(SA_ONSTACK | SA_RESETHAND);
    static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
    for (size_t n = 0; n < sizeof numbers / sizeof *numbers; n++) sigaction(numbers[n], &action, NULL);
}

static void limit(int resource, rlim_t value) {
    struct rlimit now;
    if (getrlimit(resource, &now) != 0) return;
    if (now.rlim_max == RLIM_INFINITY || now.rlim_max > value) now.rlim_max = value;
    now.rlim_cur = now.rlim_max;
    setrlimit(resource, &now);
}

static void hand_over(void) {
    header()->version = VERSION;
    __atomic_store_n(&header()->turn, OF_MASTER, __ATOMIC_RELEASE);
    syscall(SYS_futex, &header()->turn, FUTEX_WAKE, 1, NULL, NULL, 0);
}

EXPORT int isolated_host(int n, char **arguments) {
    if (n < 6) return 2;
    file = atoi(arguments[1]);
    mapped = (size_t)lseek(file, 0, SEEK_END);
    memory = mmap(NULL, mapped, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (memory == MAP_FAILED) return 2;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (getppid() != atoi(arguments[3])) return 2;
    limit(RLIMIT_CORE, 0);
    if (strtoull(arguments[4], NULL, 10)) limit(RLIMIT_DATA, strtoull(arguments[4], NULL, 10));
    setvbuf(stdout, NULL, _IOLBF, 4096); /* lines that an FMU prints are part of its log, also if it crashes */
    header()->size = mapped;
    catch_crashes();
    if (atoi(arguments[5])) header()->restricted = restrict_process(arguments + 6, n - 6);
    void *library = dlopen(arguments[2], RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        snprintf(header()->text, sizeof header()->text, "%s", dlerror());
        header()->failed = 1;
    } else {
        for (unsigned f = 0; f < N_FUNCTIONS; f++)
            header()->has[f] = (functions[f] = dlsym(library, TABLE[f].name)) != NULL;
    }
    hand_over();
    serve();
    return 0;
}

#ifdef PROGRAM
#include <pthread.h>

extern double trunc(double);
/* Libraries of FMUs may lack their references to libm and libpthread: Python and Java have both loaded, and so has this
   program. A linker leaves out what is not used. */
EXPORT void *const kept[] = {(void *)trunc, (void *)pthread_create};

int main(int n, char **arguments) { return isolated_host(n, arguments); }
#endif
