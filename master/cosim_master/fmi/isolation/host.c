/* The process of an FMU file: loads its library, and makes the calls that the master sends (see channel.h).

   It is a program, and a function for a Python interpreter, which Python FMUs need:

     host FILE LIBRARY PARENT MEMORY RESTRICTED FOLDER...

     FILE        descriptor of the shared memory
     LIBRARY     the binary of the FMU
     PARENT      process id of the master; this process ends with it
     MEMORY      limit of its memory in bytes, 0 for none
     RESTRICTED  1: it may write into the FOLDERs only, and open no sockets */

#include "calls.h"
#include "restrict.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

static size_t mapped;
static int file;

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

static void serve(void) {
    for (;;) {
        uint32_t *turn = &header()->turn;
        while (__atomic_load_n(turn, __ATOMIC_ACQUIRE) != OF_FMU)
            syscall(SYS_futex, turn, FUTEX_WAIT, OF_MASTER, NULL, NULL, 0);
        if (header()->quit) return;
        map(0);
        execute_all();
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
