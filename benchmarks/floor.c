/* The floor under every co-simulation master: the FMI calls of a system and the exchange of its values, and nothing
   else. One thread, no checks but of the status.

   floor DESCRIPTION        what overhead.py writes; then on stdin
       run N                step N times; answers the seconds that took
       values               answers all outputs, reals first

   One step, Jacobi: every input = factor * output + offset, from the outputs before the step; then for each instance
   fmi2SetXXX, fmi2DoStep, fmi2GetXXX. */

#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { REAL, INTEGER, BOOLEAN, KINDS };
static const char *KIND[] = {"Real", "Integer", "Boolean"};

typedef unsigned Reference;
typedef int GetOrSet(void *, const Reference *, size_t, void *);
typedef int DoStep(void *, double, double, int);
typedef void Logger(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    Logger *logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *step_finished, *environment;
} Callbacks;

/* Ports are numbered through, reals first; an instance has first[kind] to last[kind] - 1. */
typedef struct {
    void *handle;
    DoStep *do_step;
    GetOrSet *set[KINDS], *get[KINDS];
    long first_in[KINDS], last_in[KINDS], first_out[KINDS], last_out[KINDS];
} Instance;
typedef struct { long source; double factor, offset; } Wire;

static void say(void *environment, const char *name, int status, const char *category, const char *format, ...) {
    va_list arguments;
    (void)environment; (void)status; (void)category;
    fprintf(stderr, "%s: ", name);
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}
static const Callbacks CALLBACKS = {say, calloc, free, NULL, NULL};

static void fail(const char *what) {
    fprintf(stderr, "floor: %s\n", what);
    exit(1);
}
static void *memory(size_t n, size_t size) {
    void *p = calloc(n ? n : 1, size);
    if (!p) fail("no memory");
    return p;
}
static void *symbol(void *library, const char *prefix, const char *rest) {
    char name[64];
    snprintf(name, sizeof name, "%s%s", prefix, rest);
    void *found = dlsym(library, name);
    if (!found) fail(name);
    return found;
}
static FILE *description;
static long number(void) {
    long value;
    if (fscanf(description, "%ld", &value) != 1) fail("the description ends early");
    return value;
}
static double real(void) {
    double value;
    if (fscanf(description, "%lf", &value) != 1) fail("the description ends early");
    return value;
}
static char *word(void) {
    char text[4096];
    if (fscanf(description, "%4095s", text) != 1) fail("the description ends early");
    return strdup(text);
}

static long n_instances, n_in, n_out, reals_in, reals_out;
static Instance *instances;
static Wire *wires;
static Reference *in_reference, *out_reference;
static double *real_in, *real_out;
static int *int_in, *int_out;
static long start, step_size; /* ns */
static long k;

static void check(int status, const char *function) {
    if (status > 1) fail(function);
}

static void open_all(void) {
    char *library_file = word(), *guid = word(), *resources = word();
    start = number(), step_size = number();
    double stop = (double)number() / 1e9;
    void *library = dlopen(library_file, RTLD_NOW | RTLD_LOCAL);
    if (!library) fail(dlerror());
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) =
        symbol(library, "fmi2Instantiate", "");
    int (*setup)(void *, int, double, double, int, double) = symbol(library, "fmi2SetupExperiment", "");
    int (*enter)(void *) = symbol(library, "fmi2EnterInitializationMode", "");
    int (*leave)(void *) = symbol(library, "fmi2ExitInitializationMode", "");
    n_instances = number(), n_in = number(), n_out = number(), reals_in = number(), reals_out = number();
    instances = memory(n_instances, sizeof *instances);
    wires = memory(n_in, sizeof *wires);
    in_reference = memory(n_in, sizeof *in_reference);
    out_reference = memory(n_out, sizeof *out_reference);
    real_in = memory(reals_in, sizeof *real_in), real_out = memory(reals_out, sizeof *real_out);
    int_in = memory(n_in - reals_in, sizeof *int_in), int_out = memory(n_out - reals_out, sizeof *int_out);
    for (long i = 0; i < n_instances; i++) {
        Instance *m = instances + i;
        char name[32];
        snprintf(name, sizeof name, "n%ld", i);
        m->handle = instantiate(name, 1, guid, resources, &CALLBACKS, 0, 0);
        if (!m->handle) fail("fmi2Instantiate");
        m->do_step = symbol(library, "fmi2DoStep", "");
        for (int kind = 0; kind < KINDS; kind++) {
            m->set[kind] = symbol(library, "fmi2Set", KIND[kind]);
            m->get[kind] = symbol(library, "fmi2Get", KIND[kind]);
            m->first_in[kind] = number(), m->last_in[kind] = number();
            m->first_out[kind] = number(), m->last_out[kind] = number();
        }
        check(setup(m->handle, 0, 0.0, (double)start / 1e9, 1, stop), "fmi2SetupExperiment");
        check(enter(m->handle), "fmi2EnterInitializationMode");
        check(leave(m->handle), "fmi2ExitInitializationMode");
    }
    for (long j = 0; j < n_in; j++) {
        in_reference[j] = (Reference)number();
        wires[j].source = number(), wires[j].factor = real(), wires[j].offset = real();
    }
    for (long j = 0; j < n_out; j++) out_reference[j] = (Reference)number();
}

static void collect(const Instance *m) {
    for (int kind = 0; kind < KINDS; kind++) {
        long first = m->first_out[kind], n = m->last_out[kind] - first;
        if (n <= 0) continue;
        void *at = kind == REAL ? (void *)(real_out + first) : (void *)(int_out + first - reals_out);
        check(m->get[kind](m->handle, out_reference + first, (size_t)n, at), "fmi2Get");
    }
}

static void step_all(void) {
    double t = (double)(start + k * step_size) / 1e9, h = (double)step_size / 1e9;
    for (long i = 0; i < n_instances; i++) {
        const Instance *m = instances + i;
        for (long j = m->first_in[REAL]; j < m->last_in[REAL]; j++)
            real_in[j] = wires[j].factor * real_out[wires[j].source] + wires[j].offset;
        for (int kind = INTEGER; kind < KINDS; kind++)
            for (long j = m->first_in[kind]; j < m->last_in[kind]; j++)
                int_in[j - reals_in] = int_out[wires[j].source];
    }
    for (long i = 0; i < n_instances; i++) {
        const Instance *m = instances + i;
        for (int kind = 0; kind < KINDS; kind++) {
            long first = m->first_in[kind], n = m->last_in[kind] - first;
            if (n <= 0) continue;
            void *at = kind == REAL ? (void *)(real_in + first) : (void *)(int_in + first - reals_in);
            check(m->set[kind](m->handle, in_reference + first, (size_t)n, at), "fmi2Set");
        }
        check(m->do_step(m->handle, t, h, 1), "fmi2DoStep");
        collect(m);
    }
    k++;
}

int main(int argc, char **argv) {
    char line[64];
    if (argc != 2 || !(description = fopen(argv[1], "r"))) fail("usage: floor DESCRIPTION");
    open_all();
    fclose(description);
    for (long i = 0; i < n_instances; i++) collect(instances + i);
    while (fgets(line, sizeof line, stdin)) {
        if (!strncmp(line, "run ", 4)) {
            long steps = atol(line + 4);
            struct timespec a, b;
            clock_gettime(CLOCK_MONOTONIC, &a);
            while (steps-- > 0) step_all();
            clock_gettime(CLOCK_MONOTONIC, &b);
            printf("%.9f\n", (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec));
        } else {
            for (long j = 0; j < reals_out; j++) printf("%.17g ", real_out[j]);
            for (long j = 0; j < n_out - reals_out; j++) printf("%d ", int_out[j]);
            printf("\n");
        }
        fflush(stdout);
    }
    return 0;
}
