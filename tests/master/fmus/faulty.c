/* An FMI 2.0 co-simulation FMU that misbehaves as its GUID says: "FAULT FUNCTION N", at call N of the FMI function, by
   the instances whose name begins with "bad".

   Real: 0 u (input), 1 y (output: sum of h * (1 + u)). String: 0 s (output: the number of steps done). Its state can be
   saved and serialised. Every step is logged with an argument. */

#include <dlfcn.h>
#include <fenv.h>
#include <fcntl.h>
#include <locale.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *allocate, *release, *finished, *environment;
} Callbacks;

typedef struct {
    double u, y;
    int steps;
} State;

typedef struct {
    State state;
    const Callbacks *callbacks;
    char name[64], fault[32], function[48], text[32];
    int at, calls;
} Faulty;

static volatile int sink;
static void *volatile kept;

static int overflow(int depth) {
    volatile char block[4096];
    block[0] = (char)depth;
    return overflow(depth + 1) + block[0];
}

/* Throws an int, as C++ does it. */
static void throw_int(void) {
    void *runtime = dlopen("libstdc++.so.6", RTLD_NOW | RTLD_GLOBAL);
    if (runtime == NULL) return;
    void *(*allocate)(size_t) = (void *(*)(size_t))dlsym(runtime, "__cxa_allocate_exception");
    void (*throw_it)(void *, void *, void *) = (void (*)(void *, void *, void *))dlsym(runtime, "__cxa_throw");
    throw_it(allocate(sizeof(int)), dlsym(runtime, "_ZTIi"), NULL);
}

static int act(Faulty *f) {
    const char *fault = f->fault;
    if (!strcmp(fault, "segv")) *(volatile int *)8 = 1;
    if (!strcmp(fault, "abort")) abort();
    if (!strcmp(fault, "throw")) throw_int();
    if (!strcmp(fault, "overflow")) sink = overflow(0);
    if (!strcmp(fault, "alarm")) raise(SIGALRM);
    if (!strcmp(fault, "kill")) kill(getpid(), SIGKILL);
    if (!strcmp(fault, "divide")) raise(SIGFPE);
    if (!strcmp(fault, "exit")) exit(0);
    if (!strcmp(fault, "exit3")) exit(3);
    if (!strcmp(fault, "_exit")) _exit(0);
    if (!strcmp(fault, "hang")) while (1) sink++;
    if (!strcmp(fault, "sleep")) while (1) sleep(1);
    if (!strcmp(fault, "memory"))
        while (1) memset((void *)(kept = malloc(1 << 22)), 1, 1 << 22);
    if (!strncmp(fault, "crash", 5)) { /* crash3: until this has happened 3 times, which a file tells, not its state */
        FILE *times = fopen("crashes", "a+");
        fseek(times, 0, SEEK_END);
        if (ftell(times) >= fault[5] - '0') return fclose(times);
        fputc('x', times), fclose(times);
        *(volatile int *)8 = 1;
    }
    if (!strcmp(fault, "fatal")) return 4;
    if (!strcmp(fault, "error")) return 3;
    if (!strcmp(fault, "discard")) return 2;
    if (!strcmp(fault, "scribble")) { /* what a process shares with nobody but its FMUs */
        for (int n = 3; n < 64; n++) close(n);
        if (chdir("/") == 0) setlocale(LC_ALL, "C");
        signal(SIGINT, SIG_DFL), signal(SIGSEGV, SIG_IGN);
        umask(0);
    }
    if (!strcmp(fault, "chdir") && chdir("/") != 0) return 3;
    if (!strcmp(fault, "locale")) setlocale(LC_ALL, "POSIX"), setlocale(LC_NUMERIC, "C.UTF-8");
    if (!strcmp(fault, "handler")) signal(SIGALRM, SIG_IGN);
    if (!strcmp(fault, "rounding")) fesetround(FE_UPWARD);
    if (!strcmp(fault, "umask")) umask(0);
    if (!strcmp(fault, "close")) close(atoi(getenv("FAULTY_FILE")));
    if (!strcmp(fault, "meet")) { /* returns when the other instance of "bad1" and "bad2" is here, too */
        char own[256], other[256];
        snprintf(own, sizeof own, "%s.%c", getenv("FAULTY_FILE"), f->name[3]);
        snprintf(other, sizeof other, "%s.%c", getenv("FAULTY_FILE"), f->name[3] == '1' ? '2' : '1');
        close(open(own, O_CREAT | O_WRONLY, 0600));
        while (access(other, F_OK) != 0) usleep(100);
    }
    if (!strncmp(fault, "print", 5)) printf("printed by the FMU\n\033[31mred\n");
    if (!strcmp(fault, "print-and-segv")) *(volatile int *)8 = 1;
    if (!strcmp(fault, "write")) { /* to the file FAULTY_FILE outside of its folder, into its folder, and to a socket */
        int file = open(getenv("FAULTY_FILE"), O_CREAT | O_WRONLY, 0600);
        f->callbacks->logger(f->callbacks->environment, f->name, 0, "log", "open: %s", file < 0 ? "refused" : "done");
        FILE *own = fopen("own.txt", "w");
        f->callbacks->logger(f->callbacks->environment, f->name, 0, "log", "own: %s", own ? "done" : "refused");
        int s = socket(AF_INET, SOCK_STREAM, 0);
        f->callbacks->logger(f->callbacks->environment, f->name, 0, "log", "socket: %s", s < 0 ? "refused" : "done");
        return 3;
    }
    return 0;
}

static int enter(Faulty *f, const char *function) {
    if (strncmp(f->name, "bad", 3) || strcmp(f->function, function) || ++f->calls != f->at) return 0;
    if (getenv("FAULTY_NAME") != NULL) {
        FILE *file = fopen(getenv("FAULTY_NAME"), "w");
        if (file != NULL) fprintf(file, "%s", f->name), fclose(file);
    }
    return act(f);
}
#define ENTER                                                                                                          \
    int status = enter(f, __func__);                                                                                   \
    if (status) return status

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logging) {
    (void)type, (void)resources, (void)visible, (void)logging;
    Faulty *f = calloc(1, sizeof *f);
    f->callbacks = callbacks;
    snprintf(f->name, sizeof f->name, "%s", name);
    sscanf(guid, "%31s %47s %d", f->fault, f->function, &f->at);
    if (enter(f, __func__)) return NULL;
    return f;
}

EXPORT void fmi2FreeInstance(Faulty *f) {
    enter(f, __func__);
    free(f);
}

EXPORT int fmi2SetupExperiment(Faulty *f, int a, double b, double c, int d, double e) {
    (void)a, (void)b, (void)c, (void)d, (void)e;
    ENTER;
    return 0;
}
EXPORT int fmi2EnterInitializationMode(Faulty *f) {
    ENTER;
    return 0;
}
EXPORT int fmi2ExitInitializationMode(Faulty *f) {
    ENTER;
    return 0;
}
EXPORT int fmi2Terminate(Faulty *f) {
    ENTER;
    return 0;
}
EXPORT int fmi2Reset(Faulty *f) {
    ENTER;
    return 0;
}
EXPORT int fmi2SetReal(Faulty *f, const unsigned *references, size_t n, const double *values) {
    ENTER;
    for (size_t i = 0; i < n; i++)
        if (references[i] == 0) f->state.u = values[i];
    return 0;
}
EXPORT int fmi2GetReal(Faulty *f, const unsigned *references, size_t n, double *values) {
    ENTER;
    for (size_t i = 0; i < n; i++) values[i] = references[i] == 0 ? f->state.u : f->state.y;
    return 0;
}
EXPORT int fmi2GetString(Faulty *f, const unsigned *references, size_t n, const char **values) {
    ENTER;
    snprintf(f->text, sizeof f->text, "%d steps", f->state.steps);
    for (size_t i = 0; i < n; i++) values[i] = references[i] == 0 ? f->text : "";
    return 0;
}
EXPORT int fmi2DoStep(Faulty *f, double t, double h, int final) {
    (void)final;
    f->callbacks->logger(f->callbacks->environment, f->name, 0, "log", "a step of %g s from t = %g s", h, t);
    ENTER;
    f->state.y += h * (1 + f->state.u);
    if (strstr(f->fault, "differ") && access("crashes", F_OK) == 0) f->state.y += 1;
    f->state.steps++;
    return 0;
}
EXPORT int fmi2CancelStep(Faulty *f) {
    ENTER;
    return 0;
}
EXPORT int fmi2GetFMUstate(Faulty *f, void **state) {
    ENTER;
    if (*state == NULL) *state = malloc(sizeof(State));
    memcpy(*state, &f->state, sizeof(State));
    return 0;
}
EXPORT int fmi2SetFMUstate(Faulty *f, void *state) {
    ENTER;
    memcpy(&f->state, state, sizeof(State));
    return 0;
}
EXPORT int fmi2FreeFMUstate(Faulty *f, void **state) {
    (void)f;
    free(*state);
    *state = NULL;
    return 0;
}
EXPORT int fmi2SerializedFMUstateSize(Faulty *f, void *state, size_t *size) {
    (void)state;
    ENTER;
    *size = sizeof(State);
    return 0;
}
EXPORT int fmi2SerializeFMUstate(Faulty *f, void *state, char *bytes, size_t size) {
    ENTER;
    memcpy(bytes, state, size);
    return 0;
}
EXPORT int fmi2DeSerializeFMUstate(Faulty *f, const char *bytes, size_t size, void **state) {
    ENTER;
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return 0;
}
