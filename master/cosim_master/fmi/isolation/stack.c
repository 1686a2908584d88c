/* The stack of another thread of this process, which a watchdog asks for when that thread does not return.

   Its owner may be in the middle of any function, such as malloc: the signal handler only copies return addresses. */

#include <execinfo.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <time.h>

#define EXPORT __attribute__((visibility("default")))
#define MOST 512

static void *frames[MOST];
static int n_frames;

static void sample(int number) {
    (void)number;
    int n = backtrace(frames, MOST);
    __atomic_store_n(&n_frames, n, __ATOMIC_RELEASE);
}

/* Prepares for `stack_of` by a signal, which must have no other use. */
EXPORT int stack_prepare(int number) {
    void *first[2];
    backtrace(first, 2); /* loads its library now, not in the handler */
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = sample, action.sa_flags = SA_RESTART;
    return sigaction(number, &action, NULL);
}

/* Copies the return addresses of a thread's stack, the innermost first; returns their number, 0 if it does not answer. */
EXPORT int stack_of(pthread_t thread, int number, void **addresses, int room) {
    __atomic_store_n(&n_frames, 0, __ATOMIC_RELEASE);
    if (pthread_kill(thread, number) != 0) return 0;
    for (int waited = 0; waited < 1000; waited++) {
        int n = __atomic_load_n(&n_frames, __ATOMIC_ACQUIRE);
        if (n > 0) {
            n = n < room ? n : room;
            memcpy(addresses, frames, (size_t)n * sizeof *frames);
            return n;
        }
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    return 0;
}
