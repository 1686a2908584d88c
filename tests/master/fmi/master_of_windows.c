/* A master on Windows: loads the library of the master's side (proxy.c), starts `portable` as Python does, and makes 20
   steps of a PointMass, pushed by a force.

     master_of_windows PROXY PORTABLE FMU GUID [kill]

   Prints position and velocity after each step. With `kill`, it ends the process after 10 steps, and prints the status of
   the next step and the end of the process. */

#include <winsock2.h>
#include <ws2tcpip.h>
#include <windows.h>

#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define SECRET "0123456789abcdef"

static HMODULE library;

static void *function(const char *name) {
    void *found = (void *)GetProcAddress(library, name);
    if (found == NULL) fprintf(stderr, "no %s\n", name), ExitProcess(3);
    return found;
}

static void logger(void *e, const char *name, int status, const char *category, const char *message, ...) {
    (void)e, (void)category;
    printf("log %s %d %s\n", name, status, message);
}

static SOCKET listening(int *port) {
    struct sockaddr_in address = {.sin_family = AF_INET};
    int size = sizeof address;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    SOCKET s = socket(AF_INET, SOCK_STREAM, 0);
    bind(s, (struct sockaddr *)&address, sizeof address);
    listen(s, 1);
    getsockname(s, (struct sockaddr *)&address, &size);
    *port = ntohs(address.sin_port);
    return s;
}

int main(int n, char **arguments) {
    if (n < 5) return 2;
    WSADATA data;
    WSAStartup(MAKEWORD(2, 2), &data);
    int port;
    SOCKET server = listening(&port);
    HANDLE reading, writing;
    SECURITY_ATTRIBUTES inherited = {sizeof inherited, NULL, TRUE};
    CreatePipe(&reading, &writing, &inherited, 0);
    STARTUPINFOA start = {.cb = sizeof start, .dwFlags = STARTF_USESTDHANDLES, .hStdOutput = writing, .hStdError = writing};
    PROCESS_INFORMATION process;
    char command[2048];
    snprintf(command, sizeof command, "\"%s\" %d \"%s\"", arguments[2], port, arguments[3]);
    SetEnvironmentVariableA("UAV_COSIM_SECRET", SECRET);
    if (!CreateProcessA(NULL, command, NULL, NULL, TRUE, 0, NULL, NULL, &start, &process)) return 4;
    SOCKET connection = accept(server, NULL, NULL);
    char said[sizeof SECRET] = "";
    if (recv(connection, said, sizeof SECRET - 1, MSG_WAITALL) != sizeof SECRET - 1 || strcmp(said, SECRET)) return 5;

    library = LoadLibraryA(arguments[1]);
    if (library == NULL) return 6;
    void *(*connect_to)(int, int, double, double) = function("isolated_connect");
    void (*direct)(void *, int) = function("isolated_direct");
    const char *(*refusal)(void *) = function("isolated_refusal");
    void *(*instantiate)(void *, const char *, int, const char *, const char *, const void *, int, int) =
        function("isolated_fmi2Instantiate");
    int (*set_up)(void *, int, double, double, int, double) = function("fmi2SetupExperiment");
    int (*enter)(void *) = function("fmi2EnterInitializationMode"), (*leave)(void *) = function("fmi2ExitInitializationMode");
    int (*set)(void *, const unsigned *, size_t, const double *) = function("fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = function("fmi2GetReal");
    int (*begin)(void *, double, double, int) = function("isolated_begin_fmi2DoStep");
    int (*post)(void *, double, double, int) = function("isolated_post"), (*step)(void *, double, double, int) = function("fmi2DoStep");
    int (*end)(void *, int *, const char **, const char **, uint64_t *) = function("isolated_end");
    void (*quit)(void *) = function("isolated_quit"), (*close)(void *) = function("isolated_close");
    int (*release)(void *) = function("fmi2FreeInstance"), (*terminate)(void *) = function("fmi2Terminate");

    void *channel = connect_to(-1, (int)(intptr_t)connection, 60.0, 60.0);
    direct(channel, (int)(intptr_t)reading);
    if (refusal(channel) != NULL) return printf("refused: %s\n", refusal(channel)), 7;
    const void *callbacks[5] = {(void *)logger};
    void *h = instantiate(channel, "mass", 1, arguments[4], NULL, callbacks, 0, 0);
    if (h == NULL || set_up(h, 0, 0.0, 0.0, 0, 0.0) || enter(h) || leave(h)) return 8;
    const unsigned force[] = {11, 12, 13}, outputs[] = {21, 22, 23, 24, 25, 26};
    double values[6];
    for (int k = 0; k < 20; k++) {
        double push[] = {1.0 + k, -0.5 * k, -30.0}, t = 0.01 * k;
        if (n > 5 && k == 10) TerminateProcess(process.hProcess, 9), WaitForSingleObject(process.hProcess, INFINITE);
        if (set(h, force, 3, push)) return 9;
        if (k % 2 && (begin(h, t, 0.01, 1) || post(h, t, 0.01, 1))) return 10; /* every second one ahead of the call */
        int status = step(h, t, 0.01, 1), number;
        const char *name, *owner;
        uint64_t memory;
        if (status) return printf("status %d end %d\n", status, end(channel, &number, &name, &owner, &memory)), 0;
        if (get(h, outputs, 6, values)) return 11;
        for (int i = 0; i < 6; i++) printf("%.17g%c", values[i], i < 5 ? ' ' : '\n');
    }
    terminate(h), release(h), quit(channel);
    WaitForSingleObject(process.hProcess, INFINITE);
    close(channel);
    return 0;
}
