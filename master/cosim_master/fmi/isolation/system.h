/* What the master's side needs of the system: sockets, pipes, time, and on Linux shared memory.

   SHARES: the process of an FMU shares memory with the master (Linux). Elsewhere, and with -DPORTABLE, processes are
   connected by sockets only (portable.c). A socket and a pipe are an int, on Windows a handle, of which 32 bits count. */

#ifndef SYSTEM_H
#define SYSTEM_H

#if defined __linux__ && !defined PORTABLE
#define SHARES 1
#else
#define SHARES 0
#endif

#ifdef _WIN32
#include <winsock2.h>
#include <ws2tcpip.h>
#include <windows.h>
#undef IN /* which say nothing there, or something else */
#undef OUT
#undef ERROR
#define EXPORT __declspec(dllexport)
#else
#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>
#define EXPORT __attribute__((visibility("default")))
#endif
#if SHARES
#include <linux/futex.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#endif
#include <errno.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef _WIN32
struct iovec {
    void *iov_base;
    size_t iov_len;
};

/* Reads what there is; returns 0 if there is nothing. */
static int read_some(int pipe, void *data, unsigned room) {
    HANDLE handle = (HANDLE)(intptr_t)pipe;
    DWORD there = 0, n = 0;
    if (!PeekNamedPipe(handle, NULL, 0, NULL, &there, NULL) || there == 0) return 0;
    return ReadFile(handle, data, there < room ? there : room, &n, NULL) ? (int)n : 0;
}

static void read_without_waiting(int pipe) { (void)pipe; }

static int64_t now(void) {
    LARGE_INTEGER count, rate;
    QueryPerformanceCounter(&count);
    QueryPerformanceFrequency(&rate);
    return (int64_t)((double)count.QuadPart / (double)rate.QuadPart * 1e9);
}

static bool has_message(int socket, int milliseconds) {
    WSAPOLLFD one = {(SOCKET)(intptr_t)socket, POLLRDNORM, 0};
    return WSAPoll(&one, 1, milliseconds) > 0;
}

static void hang_up(int socket) { shutdown((SOCKET)(intptr_t)socket, SD_BOTH); }

static bool transmit(int socket, struct iovec *parts, size_t n) {
    for (; n > 0; parts++, n--) {
        const char *at = parts->iov_base;
        for (size_t left = parts->iov_len; left > 0;) {
            int sent = send((SOCKET)(intptr_t)socket, at, (int)(left < 1u << 20 ? left : 1u << 20), 0);
            if (sent <= 0) return errno = WSAGetLastError(), false;
            at += sent, left -= (size_t)sent;
        }
    }
    return true;
}

static bool receive(int socket, void *data, size_t bytes) {
    for (char *at = data; bytes > 0;) {
        int n = recv((SOCKET)(intptr_t)socket, at, (int)(bytes < 1u << 20 ? bytes : 1u << 20), 0);
        if (n <= 0) return errno = n == 0 ? 0 : WSAGetLastError(), false;
        at += n, bytes -= (size_t)n;
    }
    return true;
}
#else
#ifndef MSG_NOSIGNAL
#define MSG_NOSIGNAL 0 /* macOS: Python ignores SIGPIPE */
#endif

static int read_some(int pipe, void *data, unsigned room) { return (int)read(pipe, data, room); }

static void read_without_waiting(int pipe) { fcntl(pipe, F_SETFL, O_NONBLOCK); }

static int64_t now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static bool has_message(int socket, int milliseconds) {
    struct pollfd one = {socket, POLLIN, 0};
    return poll(&one, 1, milliseconds) > 0;
}

static void hang_up(int socket) { shutdown(socket, SHUT_RDWR); }

/* False if the time limit of `option` (SO_RCVTIMEO, SO_SNDTIMEO) has passed since `begin`: a call that a signal has
   interrupted begins its limit anew, and timers or profilers may send signals more often than it lasts. */
static bool may_try_again(int socket, int option, int64_t begin) {
    struct timeval limit = {0, 0};
    socklen_t size = sizeof limit;
    getsockopt(socket, SOL_SOCKET, option, &limit, &size);
    int64_t ns = (int64_t)limit.tv_sec * 1000000000 + (int64_t)limit.tv_usec * 1000;
    if (ns == 0 || now() - begin < ns) return true;
    errno = EAGAIN;
    return false;
}

static bool transmit(int socket, struct iovec *parts, size_t n) {
    for (int64_t begin = now(); n > 0;) {
        struct msghdr message = {.msg_iov = parts};
        message.msg_iovlen = n; /* whose type depends on the system */
        ssize_t sent = sendmsg(socket, &message, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR && may_try_again(socket, SO_SNDTIMEO, begin)) continue;
        if (sent < 0) return false;
        begin = now();
        for (; n > 0 && (size_t)sent >= parts->iov_len; parts++, n--) sent -= (ssize_t)parts->iov_len;
        if (n > 0) parts->iov_base = (char *)parts->iov_base + sent, parts->iov_len -= (size_t)sent;
    }
    return true;
}

/* Receives all of `bytes`; false, with errno or 0 if the other side has closed the connection. */
static bool receive(int socket, void *data, size_t bytes) {
    int64_t begin = now();
    for (char *at = data; bytes > 0;) {
        ssize_t n = recv(socket, at, bytes, MSG_WAITALL);
        if (n < 0 && errno == EINTR && may_try_again(socket, SO_RCVTIMEO, begin)) continue;
        if (n <= 0) return errno = n == 0 ? 0 : errno, false;
        at += n, bytes -= (size_t)n;
        if (bytes > 0) begin = now();
    }
    return true;
}
#endif

#endif
