/* The floor under every co-simulation master: the FMI calls of a system and the exchange of its values, and nothing
   else. One thread, no checks but of the status. See floor.h for its dialogue.

   One step, Jacobi: every input = factor * output + offset, from the outputs before the step; then for each instance
   fmi2SetXXX, fmi2DoStep, fmi2GetXXX. */

#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

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

#include "floor.h"

static Reference *in_reference, *out_reference;

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
    read_sizes();
    in_reference = memory(n_in, sizeof *in_reference);
    out_reference = memory(n_out, sizeof *out_reference);
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
        read_wire(wires + j);
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
