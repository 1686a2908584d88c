/* The process of an FMU file on any system: loads its library, connects to the master by TCP, and makes its calls.

     portable PORT LIBRARY     with a secret in the environment variable UAV_COSIM_SECRET, which it sends first

   The messages are those of remote.h, without a pulse. For Windows, macOS and Linux; a Windows build also runs FMUs of
   Windows elsewhere, by Wine. It is neither restricted nor limited; the process group ends it. */

#ifdef _WIN32
#include <winsock2.h>
#include <ws2tcpip.h>
#include <windows.h>
#undef IN /* which say nothing there */
#undef OUT
typedef SOCKET Socket;
#define NO_SOCKET INVALID_SOCKET
#else
#include <arpa/inet.h>
#include <dlfcn.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>
typedef int Socket;
#define NO_SOCKET (-1)
#endif
#include <signal.h>

#include "calls.h"

enum { ALIVE, SIGNALLED }; /* of Replied.end, as in proxy.c */
#ifndef SIGBUS
#define SIGBUS 7
#endif

static size_t mapped;
static Socket connection = NO_SOCKET;

static void map(size_t least) {
    if (least <= mapped) return;
    size_t size = mapped ? mapped : MESSAGES;
    while (size < least) size *= 2;
    char *larger = size > LARGEST ? NULL : realloc(memory, size);
    if (larger == NULL) abort();
    memset(larger + mapped, 0, size - mapped);
    memory = larger, mapped = size;
    header()->size = size;
}

static void append_exception(char *message, size_t room) { (void)message, (void)room; }

/* ---- the connection ------------------------------------------------------------------------------------------------ */

static bool transmit(const void *data, size_t bytes) {
    for (const char *at = data; bytes > 0;) {
        int n = (int)send(connection, at, (int)(bytes < 1u << 20 ? bytes : 1u << 20), 0);
        if (n <= 0) return false;
        at += n, bytes -= (size_t)n;
    }
    return true;
}

static bool receive(void *data, size_t bytes) {
    for (char *at = data; bytes > 0;) {
        int n = (int)recv(connection, at, (int)(bytes < 1u << 20 ? bytes : 1u << 20), 0);
        if (n <= 0) return false;
        at += n, bytes -= (size_t)n;
    }
    return true;
}

/* Sends how the process is, its log, and a reply, which follow one another in one message. */
static bool tell(uint32_t end, int number, const void *reply, size_t bytes) {
    Header *h = header();
    Replied r = {end, number, end == ALIVE ? 0 : h->running, h->executed, h->owner, 0, h->log <= LOG_BYTES ? h->log : 0,
                 bytes, 0, 0};
    size_t size = sizeof r + r.log + bytes;
    static char *message;
    static size_t room;
    if (size > room) {
        char *larger = realloc(message, room = 2 * size);
        if (larger == NULL) return false;
        message = larger;
    }
    memcpy(message, &r, sizeof r);
    memcpy(message + sizeof r, memory + HEADER_BYTES, r.log);
    memcpy(message + sizeof r + r.log, reply, bytes);
    h->log = 0;
    return transmit(message, size);
}

static bool connect_to(const char *port, const char *secret) {
#ifdef _WIN32
    WSADATA data;
    if (WSAStartup(MAKEWORD(2, 2), &data) != 0) return false;
#endif
    struct sockaddr_in address;
    memset(&address, 0, sizeof address);
    address.sin_family = AF_INET, address.sin_port = htons((unsigned short)atoi(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connection = socket(AF_INET, SOCK_STREAM, 0);
    if (connection == NO_SOCKET || connect(connection, (struct sockaddr *)&address, sizeof address) != 0) return false;
    int yes = 1;
    setsockopt(connection, IPPROTO_TCP, TCP_NODELAY, (const char *)&yes, sizeof yes);
    return transmit(secret, strlen(secret));
}

/* ---- the process --------------------------------------------------------------------------------------------------- */

static void crashed(int number) {
    signal(number, SIG_DFL);
    tell(SIGNALLED, number, NULL, 0); /* the signal as Linux numbers it: those of C are the same everywhere but SIGABRT */
    _exit(128 + number);
}

#ifdef _WIN32
static LONG WINAPI unhandled(EXCEPTION_POINTERS *what) {
    switch (what->ExceptionRecord->ExceptionCode) {
    case EXCEPTION_ILLEGAL_INSTRUCTION: crashed(4); break;
    case EXCEPTION_INT_DIVIDE_BY_ZERO:
    case EXCEPTION_FLT_DIVIDE_BY_ZERO: crashed(8); break;
    default: crashed(11);
    }
    return EXCEPTION_EXECUTE_HANDLER;
}

static void aborted(int number) { (void)number, crashed(6); }

static void catch_crashes(void) {
    ULONG bytes = 65536;
    SetThreadStackGuarantee(&bytes); /* also after an overflow of the stack */
    SetErrorMode(SEM_FAILCRITICALERRORS | SEM_NOGPFAULTERRORBOX);
    SetUnhandledExceptionFilter(unhandled);
    signal(SIGABRT, aborted);
}

static void *open_library(const char *file) { return (void *)LoadLibraryExA(file, NULL, LOAD_WITH_ALTERED_SEARCH_PATH); }
static void *symbol(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }
static void describe_error(char *text, size_t room, const char *file) {
    DWORD number = GetLastError();
    char words[256] = "";
    DWORD n = FormatMessageA(FORMAT_MESSAGE_FROM_SYSTEM | FORMAT_MESSAGE_IGNORE_INSERTS, NULL, number,
                             MAKELANGID(LANG_ENGLISH, SUBLANG_ENGLISH_US), words, sizeof words, NULL);
    while (n > 0 && strchr(" .\r\n", words[n - 1]) != NULL) words[--n] = 0;
    const char *hint = number == ERROR_MOD_NOT_FOUND ? "; a library that it needs may be missing" : "";
    snprintf(text, room, "%s cannot be loaded: error %lu of Windows%s%s%s", file, number, n ? ", " : "", words, hint);
}
#else
static void catch_crashes(void) {
    static char stack[65536];
    stack_t other = {.ss_sp = stack, .ss_flags = 0, .ss_size = sizeof stack};
    sigaltstack(&other, NULL);
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = crashed, action.sa_flags = (int)(SA_ONSTACK | SA_RESETHAND);
    static const int numbers[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
    for (size_t n = 0; n < sizeof numbers / sizeof *numbers; n++) sigaction(numbers[n], &action, NULL);
}

static void *open_library(const char *file) { return dlopen(file, RTLD_NOW | RTLD_LOCAL); }
static void *symbol(void *library, const char *name) { return dlsym(library, name); }
static void describe_error(char *text, size_t room, const char *file) {
    (void)file;
    snprintf(text, room, "%s", dlerror());
}
#endif

int main(int n, char **arguments) {
    const char *secret = getenv("UAV_COSIM_SECRET");
    if (n != 3 || secret == NULL) return 2;
    setvbuf(stdout, NULL, _IONBF, 0); /* what an FMU prints is part of its log, also if it crashes */
    map(MESSAGES);
    if (!connect_to(arguments[1], secret)) return 2;
    catch_crashes();
    header()->version = VERSION;
    void *library = open_library(arguments[2]);
    if (library == NULL) {
        describe_error(header()->text, sizeof header()->text, arguments[2]);
        header()->failed = 1;
    } else {
        for (unsigned f = 0; f < N_FUNCTIONS; f++)
            header()->has[f] = (functions[f] = symbol(library, TABLE[f].name)) != NULL;
    }
    if (!tell(ALIVE, 0, memory, sizeof(Header))) return 0;
    for (Posted head; receive(&head, sizeof head);) {
        if (head.bytes > LARGEST / 2) return 2;
        map(MESSAGES + head.bytes + 4096);
        if (!receive(memory + MESSAGES, head.bytes)) return 0;
        header()->request = head.bytes, header()->executed = 0;
        size_t end = execute_all();
        map(end);
        size_t begin = reply_at(header());
        if (!tell(ALIVE, 0, memory + begin, end - begin)) return 0;
    }
    return 0;
}
