/* What floor.c and floor3.c share: the description of a system, its values, the clock and the dialogue.

   The including file defines Reference, Instance, open_all, collect and step_all.

   floor DESCRIPTION        what overhead.py writes; then on stdin
       run N                step N times; answers the seconds that took
       values               answers all outputs, reals first */

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct { long source; double factor, offset; } Wire;

static void fail(const char *what) {
    fprintf(stderr, "floor: %s\n", what);
    exit(1);
}
static void check(int status, const char *function) {
    if (status > 1) fail(function);
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
static double *real_in, *real_out;
static int *int_in, *int_out;
static long start, step_size; /* ns */
static long k;

static void open_all(void);
static void collect(const Instance *instance); /* gets the outputs of an instance */
static void step_all(void);                    /* makes step k of all instances */

/* Reads the number of instances and values, and allocates their memory. */
static void read_sizes(void) {
    n_instances = number(), n_in = number(), n_out = number(), reals_in = number(), reals_out = number();
    instances = memory(n_instances, sizeof *instances);
    wires = memory(n_in, sizeof *wires);
    real_in = memory(reals_in, sizeof *real_in), real_out = memory(reals_out, sizeof *real_out);
    int_in = memory(n_in - reals_in, sizeof *int_in), int_out = memory(n_out - reals_out, sizeof *int_out);
}

static void read_wire(Wire *wire) { wire->source = number(), wire->factor = real(), wire->offset = real(); }

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
