/* What the FMI 3.0 co-simulation FMUs for tests have in common: they look at what is done with them.

   What is not allowed is written to the file that STRICT3_LOG names and is fmi3Error; `note` writes to that of
   STRICT3_CALLS. An instance is a struct that begins with INSTANCE. */

#include "observed.h"

typedef void (*Logger)(void *, int, const char *, const char *);
enum { OK, WARNING, DISCARD, ERROR, FATAL };

#define INSTANCE                                                                                                       \
    int state;                                                                                                         \
    double time, promised; /* no state from before it is restored; only if has_promised */                             \
    bool has_promised;                                                                                                 \
    void *environment;                                                                                                 \
    Logger logger;                                                                                                     \
    char name[64]
typedef struct {
    INSTANCE;
} Common;

static int complain_of(const Common *s, const char *format, ...) {
    char text[256];
    va_list rest;
    va_start(rest, format);
    vsnprintf(text, sizeof text, format, rest);
    va_end(rest);
    write_line("STRICT3_LOG", "%s: %s (state %d, time %.9g)", s->name, text, s->state, s->time);
    if (s->logger) s->logger(s->environment, ERROR, "logStatusError", text);
    return ERROR;
}
#define complain(instance, ...) complain_of((const Common *)(instance), __VA_ARGS__)
#define note(instance, what, t) write_line("STRICT3_CALLS", "%s: %s %.9g", (instance)->name, what, (double)(t))
#define ALLOWED(instance, function, states)                                                                            \
    if (!((instance)->state & (states))) return complain(instance, "%s is not allowed", function)

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT void fmi3FreeInstance(void *instance) { free(instance); }

/* Where FMU states are copies of the instance. */
#define STATES(Instance)                                                                                               \
    EXPORT int fmi3GetFMUState(Instance *s, void **state) {                                                            \
        if (!*state) *state = malloc(sizeof *s);                                                                       \
        memcpy(*state, s, sizeof *s);                                                                                  \
        return OK;                                                                                                     \
    }                                                                                                                  \
    EXPORT int fmi3SetFMUState(Instance *s, const void *state) {                                                       \
        Instance now = *s;                                                                                             \
        if (s->has_promised && ((const Instance *)state)->time < s->promised - 1e-9)                                   \
            return complain(s, "fmi3SetFMUState although promised not to go back before %g", s->promised);             \
        memcpy(s, state, sizeof *s);                                                                                   \
        s->promised = now.promised, s->has_promised = now.has_promised;                                                \
        return OK;                                                                                                     \
    }                                                                                                                  \
    EXPORT int fmi3FreeFMUState(Instance *s, void **state) {                                                           \
        (void)s;                                                                                                       \
        free(*state);                                                                                                  \
        *state = NULL;                                                                                                 \
        return OK;                                                                                                     \
    }
