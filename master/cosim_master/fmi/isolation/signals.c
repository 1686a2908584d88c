/* Signals that end a process whose interpreter is busy, unless they belong to one request.

   Python only notes a signal in C; its handler runs when Python code does, which an FMU that does not return prevents. A
   second signal then ends the process, as if there were no handler. Programs such as timeout(1) send a signal to the
   process and to its group, microseconds apart: within REQUEST_NS, signals are one request. */

#include <signal.h>
#include <string.h>
#include <time.h>

#define EXPORT __attribute__((visibility("default")))
#define REQUEST_NS 100000000LL
#define MOST_SIGNALS 65

static void (*noting[MOST_SIGNALS])(int, siginfo_t *, void *); /* Python's; one of fewer parameters ignores the others */
static long long first[MOST_SIGNALS]; /* time of the first signal, ns; 0: none since signals_expect */

static void on_signal(int number, siginfo_t *information, void *context) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    long long at = now.tv_sec * 1000000000LL + now.tv_nsec, none = 0;
    if (!__atomic_compare_exchange_n(&first[number], &none, at, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE) &&
        at - none > REQUEST_NS) {
        signal(number, SIG_DFL);
        raise(number); /* when this handler has returned */
        return;
    }
    noting[number](number, information, context);
}

/* Lets the next request go to the handler that is set, and the one after it end the process. Returns 0, or -1 if no
   handler is set. */
EXPORT int signals_expect(int number) {
    struct sigaction action;
    if (number < 1 || number >= MOST_SIGNALS || sigaction(number, NULL, &action) != 0) return -1;
    if (action.sa_handler == SIG_DFL || action.sa_handler == SIG_IGN) return -1;
    if (action.sa_sigaction != on_signal) {
        noting[number] = action.sa_sigaction; /* at the place of sa_handler */
        action.sa_sigaction = on_signal;
        action.sa_flags = (action.sa_flags & ~(int)SA_RESETHAND) | SA_SIGINFO;
        if (sigaction(number, &action, NULL) != 0) return -1;
    }
    __atomic_store_n(&first[number], 0, __ATOMIC_RELEASE);
    return 0;
}

/* Returns the handler behind a handler that was found for a signal: Python's, if it is the one above. */
EXPORT void *signals_behind(int number, void *handler) {
    return handler == (void *)on_signal ? (void *)noting[number] : handler;
}
