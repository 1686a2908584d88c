/* What floor.c is for FMI 2, for FMI 3.0: the FMI calls of a system and the exchange of its values, and nothing else.
   One thread, no checks but of the status. See floor.h for its dialogue.

   One step, Jacobi: every input = factor * output + offset, from the outputs before the step; then for each instance
   fmi3SetXXX, fmi3DoStep, fmi3GetXXX, the same calls with the same value references as ours. Reals are doubles, all else are
   ints: values of other types are converted in a buffer of the call. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef uint32_t Reference;
typedef int GetOrSet(void *, const Reference *, size_t, void *, size_t);
typedef int DoStep(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef struct {
    GetOrSet *function;
    const Reference *references;
    size_t n, n_values;
    void *values, *plain; /* `values` is where `plain` is, or a buffer */
    enum { PLAIN, ENUMERATION, BOOLEAN } type;
} Call;
typedef struct {
    void *handle;
    DoStep *do_step;
    Call *first_set, *first_get, *last_get;
    long first_in[2], last_in[2];
} Instance;

#include "floor.h"

static Call *calls;

static void say(void *environment, int status, const char *category, const char *message) {
    (void)environment; (void)status; (void)category;
    fprintf(stderr, "%s\n", message);
}

static void read_call(Call *call, void *library) {
    char name[64];
    char *verb = word(), *type = word();
    long at = number();
    bool sets = !strcmp(verb, "Set"), is_real = !strcmp(type, "Float64");
    snprintf(name, sizeof name, "fmi3%s%s", verb, type);
    call->function = symbol(library, name, "");
    call->n = (size_t)number(), call->n_values = (size_t)number();
    Reference *references = memory(call->n, sizeof *references);
    for (size_t i = 0; i < call->n; i++) references[i] = (Reference)number();
    call->references = references;
    double *reals = sets ? real_in : real_out;
    int *ints = sets ? int_in : int_out;
    call->plain = is_real ? (void *)(reals + at) : (void *)(ints + at);
    call->type = !strcmp(type, "Int64") ? ENUMERATION : !strcmp(type, "Boolean") ? BOOLEAN : PLAIN;
    if (call->type == PLAIN && !is_real && strcmp(type, "Int32")) fail(type);
    call->values = call->type == PLAIN ? call->plain : memory(call->n_values, 8);
    free(verb), free(type);
}

static void open_all(void) {
    char *library_file = word(), *token = word(), *resources = word();
    start = number(), step_size = number();
    double stop = (double)number() / 1e9;
    void *library = dlopen(library_file, RTLD_NOW | RTLD_LOCAL);
    if (!library) fail(dlerror());
    void *(*instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const Reference *, size_t, void *,
                         void (*)(void *, int, const char *, const char *), void *) =
        symbol(library, "fmi3InstantiateCoSimulation", "");
    int (*enter)(void *, bool, double, double, bool, double) = symbol(library, "fmi3EnterInitializationMode", "");
    int (*leave)(void *) = symbol(library, "fmi3ExitInitializationMode", "");
    read_sizes();
    calls = memory(number(), sizeof *calls);
    Call *call = calls;
    for (long i = 0; i < n_instances; i++) {
        Instance *m = instances + i;
        char name[32];
        snprintf(name, sizeof name, "n%ld", i);
        m->handle = instantiate(name, token, resources, false, false, false, false, NULL, 0, NULL, say, NULL);
        if (!m->handle) fail("fmi3InstantiateCoSimulation");
        m->do_step = symbol(library, "fmi3DoStep", "");
        for (int kind = 0; kind < 2; kind++) m->first_in[kind] = number(), m->last_in[kind] = number();
        m->first_set = call;
        for (long n = number(); n > 0; n--) read_call(call++, library);
        m->first_get = call;
        for (long n = number(); n > 0; n--) read_call(call++, library);
        m->last_get = call;
        check(enter(m->handle, false, 0.0, (double)start / 1e9, true, stop), "fmi3EnterInitializationMode");
        check(leave(m->handle), "fmi3ExitInitializationMode");
    }
    for (long j = 0; j < n_in; j++) read_wire(wires + j);
}

static void get(void *handle, const Call *call) {
    check(call->function(handle, call->references, call->n, call->values, call->n_values), "fmi3Get");
    if (call->type == PLAIN) return;
    int *plain = call->plain;
    for (size_t i = 0; i < call->n_values; i++)
        plain[i] = call->type == BOOLEAN ? ((bool *)call->values)[i] : (int)((int64_t *)call->values)[i];
}
static void set(void *handle, const Call *call) {
    const int *plain = call->plain;
    for (size_t i = 0; call->type != PLAIN && i < call->n_values; i++) {
        if (call->type == BOOLEAN) ((bool *)call->values)[i] = plain[i] != 0;
        else ((int64_t *)call->values)[i] = plain[i];
    }
    check(call->function(handle, call->references, call->n, call->values, call->n_values), "fmi3Set");
}

static void collect(const Instance *m) {
    for (const Call *call = m->first_get; call < m->last_get; call++) get(m->handle, call);
}

static void step_all(void) {
    double t = (double)(start + k * step_size) / 1e9, h = (double)step_size / 1e9;
    for (long i = 0; i < n_instances; i++) {
        const Instance *m = instances + i;
        for (long j = m->first_in[0]; j < m->last_in[0]; j++)
            real_in[j] = wires[j].factor * real_out[wires[j].source] + wires[j].offset;
        for (long j = m->first_in[1]; j < m->last_in[1]; j++) int_in[j - reals_in] = int_out[wires[j].source];
    }
    for (long i = 0; i < n_instances; i++) {
        const Instance *m = instances + i;
        bool event, terminate, early;
        double last;
        for (const Call *call = m->first_set; call < m->first_get; call++) set(m->handle, call);
        check(m->do_step(m->handle, t, h, true, &event, &terminate, &early, &last), "fmi3DoStep");
        if (terminate || early) fail("fmi3DoStep has not done all of the step");
        collect(m);
    }
    k++;
}
