/* Catches crashes of this process, and calls of exit(), while one of its threads calls FMUs.

   The handler runs on a stack of its own, so that an overflow of the thread's stack is caught, too. It passes the stack on
   to a function, which says who it was and completes the recording, and the process then ends with exit code 1. If the
   crash has damaged so much that this function crashes or does not return, the process ends all the same. */

#include <execinfo.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))
#define MOST 512
#define STACK_BYTES (8u << 20)

/* number: the signal, 0 for exit(); code: of exit(). */
typedef void (*Told)(int number, int code, void **frames, int n);

static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
#define N (sizeof numbers / sizeof *numbers)
static struct sigaction before[N];
static stack_t stack_before;
static void *stack;
static Told told;
static unsigned seconds;
static pthread_t thread;
static volatile sig_atomic_t armed;

static void too_late(int number) {
    (void)number;
    static const char text[] = "error: the recording could not be completed after that; uav-cosim repair completes it\n";
    if (write(2, text, sizeof text - 1) < 0) _exit(1);
    _exit(1);
}

static void report(int number, int code) {
    static void *frames[MOST];
    for (size_t i = 0; i < N; i++) signal(numbers[i], too_late);
    signal(SIGALRM, too_late);
    sigset_t none;
    sigemptyset(&none);
    pthread_sigmask(SIG_SETMASK, &none, NULL);
    alarm(seconds);
    told(number, code, frames, backtrace(frames, MOST));
    _exit(1);
}

static void crashed(int number) {
    if (armed && pthread_equal(pthread_self(), thread)) {
        armed = 0;
        report(number, 0);
    }
    signal(number, SIG_DFL);
    raise(number);
}

static void exited(int code, void *unused) {
    (void)unused;
    if (!armed || !pthread_equal(pthread_self(), thread)) return;
    armed = 0;
    fflush(NULL);
    report(0, code);
}

/* Catches what this thread does from now on; returns false if that is not possible. Signals that have a handler, such as
   Python's faulthandler, keep it. within: the time that `function` has, s. */
EXPORT bool crash_catch(Told function, unsigned within) {
    void *first[2];
    backtrace(first, 2); /* loads its library now, not in the handler */
    if (stack == NULL) {
        stack = mmap(NULL, STACK_BYTES, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (stack == MAP_FAILED) return stack = NULL, false;
    }
    stack_t own = {.ss_sp = stack, .ss_flags = 0, .ss_size = STACK_BYTES};
    if (sigaltstack(&own, &stack_before) != 0) return false;
    told = function, seconds = within, thread = pthread_self();
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = crashed, action.sa_flags = SA_ONSTACK;
    for (size_t i = 0; i < N; i++) {
        sigaction(numbers[i], NULL, &before[i]);
        if (before[i].sa_handler == SIG_DFL) sigaction(numbers[i], &action, NULL);
    }
    armed = 1;
    return true;
}

/* Catches calls of exit(), too. Its handlers run in reverse order: after this, nothing that completes a recording should
   be used for the first time, which might register a handler that ends it. */
EXPORT void crash_catch_exit(void) { on_exit(exited, NULL); }

/* Ends it; handlers that an FMU has set remain. */
EXPORT void crash_release(void) {
    armed = 0;
    for (size_t i = 0; i < N; i++) {
        struct sigaction now;
        sigaction(numbers[i], NULL, &now);
        if (now.sa_handler == crashed) sigaction(numbers[i], &before[i], NULL);
    }
    stack_t now;
    if (sigaltstack(NULL, &now) == 0 && now.ss_sp == stack) sigaltstack(&stack_before, NULL);
}
