/* Restricts this process: no files outside of its folders are written, and no sockets are opened (Landlock, seccomp). */

#ifndef RESTRICT_H
#define RESTRICT_H

#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* linux/landlock.h, of which the C library's headers may have an older version or none. */
#define LANDLOCK_CREATE_RULESET 444
#define LANDLOCK_ADD_RULE 445
#define LANDLOCK_RESTRICT_SELF 446
#define LANDLOCK_VERSION 1
#define LANDLOCK_PATH_BENEATH 1
#define ACCESS_WRITE_FILE (1ull << 1)
#define ACCESS_ALL_OF_VERSION_1 0x1ff2ull /* all but EXECUTE, READ_FILE and READ_DIR */
#define ACCESS_REFER (1ull << 13)
#define ACCESS_TRUNCATE (1ull << 14)
#define ACCESS_BIND_AND_CONNECT_TCP 3ull
#define SCOPE_SOCKETS_AND_SIGNALS 3ull

typedef struct {
    uint64_t files, network, scoped;
} Ruleset;

typedef struct {
    uint64_t access;
    int32_t parent;
} __attribute__((packed)) Beneath;

static void allow_beneath(int ruleset, const char *path, uint64_t access) {
    int folder = open(path, O_PATH | O_CLOEXEC);
    if (folder < 0) return;
    Beneath rule = {access, folder};
    syscall(LANDLOCK_ADD_RULE, ruleset, LANDLOCK_PATH_BENEATH, &rule, 0);
    close(folder);
}

static bool restrict_files(char **folders, int n) {
    long version = syscall(LANDLOCK_CREATE_RULESET, NULL, 0, LANDLOCK_VERSION);
    if (version < 1) return false;
    uint64_t truncate = version >= 3 ? ACCESS_TRUNCATE : 0;
    Ruleset rules = {ACCESS_ALL_OF_VERSION_1 | truncate | (version >= 2 ? ACCESS_REFER : 0),
                     version >= 4 ? ACCESS_BIND_AND_CONNECT_TCP : 0, version >= 6 ? SCOPE_SOCKETS_AND_SIGNALS : 0};
    size_t size = version >= 6 ? 24 : version >= 4 ? 16 : 8;
    int ruleset = (int)syscall(LANDLOCK_CREATE_RULESET, &rules, size, 0);
    if (ruleset < 0) return false;
    for (int i = 0; i < n; i++) allow_beneath(ruleset, folders[i], rules.files);
    allow_beneath(ruleset, "/dev/null", ACCESS_WRITE_FILE | truncate);
    bool done = syscall(LANDLOCK_RESTRICT_SELF, ruleset, 0) == 0;
    close(ruleset);
    return done;
}

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#endif
#define SYS_IO_URING_SETUP 425
#define X32 0x40000000u

static bool restrict_sockets(void) {
#ifdef ARCHITECTURE
    struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 0, 4),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, X32, 2, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_socket, 1, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_IO_URING_SETUP, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EACCES),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
    };
    struct sock_fprog program = {sizeof filter / sizeof *filter, filter};
    return prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program, 0, 0) == 0;
#else
    return false;
#endif
}

/* Returns the restrictions that the kernel has accepted. */
static uint32_t restrict_process(char **folders, int n) {
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) return 0;
    return (restrict_files(folders, n) ? RESTRICTED_FILES : 0) | (restrict_sockets() ? RESTRICTED_SOCKETS : 0);
}

#endif
