/* The parts of the C library of Windows that its import libraries do not have, for a library that is linked without the
   rest: zig compiles all of that, for a minute, before it links the first library of a user. Included with -nostdlib. */

#ifndef WINDOWS_H
#define WINDOWS_H

#include <math.h>
#include <stdint.h>
#include <stdio.h>

/* Formats as C demands; also how snprintf and vsnprintf of the compiler's headers do it. */
#define vsnprintf(text, room, format, arguments)                                                                       \
    __stdio_common_vsprintf(_CRT_INTERNAL_PRINTF_STANDARD_SNPRINTF_BEHAVIOR, text, room, format, NULL, arguments)

/* The system calls this when it loads the library; the C library of Windows is one of its own that initialises itself. */
int entry_of_library(void *library, unsigned reason, void *reserved);
int entry_of_library(void *library, unsigned reason, void *reserved) {
    (void)library, (void)reason, (void)reserved;
    return 1;
}

/* Compilers call these for structures and loops. */
void *memcpy(void *to, const void *of, size_t n) {
    void *at = to;
    __asm__ volatile("rep movsb" : "+D"(at), "+S"(of), "+c"(n) : : "memory");
    return to;
}

void *memmove(void *to, const void *of, size_t n) {
    if ((uintptr_t)to - (uintptr_t)of >= n) return memcpy(to, of, n);
    char *at = (char *)to + n - 1;
    const char *last = (const char *)of + n - 1;
    __asm__ volatile("std\n\trep movsb\n\tcld" : "+D"(at), "+S"(last), "+c"(n) : : "memory");
    return to;
}

void *memset(void *to, int value, size_t n) {
    void *at = to;
    __asm__ volatile("rep stosb" : "+D"(at), "+c"(n) : "a"(value) : "memory");
    return to;
}

int memcmp(const void *a, const void *b, size_t n) {
    const unsigned char *one = a, *other = b;
    for (; n > 0 && *one == *other; n--) one++, other++;
    return n > 0 ? *one - *other : 0;
}

/* They call this for both of one angle. What is called by a variable cannot become a call of this function again. */
static double (*volatile sine)(double) = sin;
static double (*volatile cosine)(double) = cos;
void sincos(double angle, double *s, double *c);
void sincos(double angle, double *s, double *c) {
    *s = sine(angle);
    *c = cosine(angle);
}

/* A function with a large frame calls this with the frame's size in rax, to touch each page of the stack in turn: the
   system gives the stack its next page when the one before is touched. All registers keep their values. */
__asm__(".globl ___chkstk_ms\n"
        "___chkstk_ms:\n"
        "    push %rax\n"
        "    push %rdx\n"
        "    lea 24(%rsp), %rdx\n" /* the caller's stack pointer */
        "    jmp 2f\n"
        "1:  sub $4096, %rdx\n"
        "    testb $0, (%rdx)\n"
        "    sub $4096, %rax\n"
        "2:  cmp $4096, %rax\n"
        "    jae 1b\n"
        "    sub %rax, %rdx\n"
        "    testb $0, (%rdx)\n"
        "    pop %rdx\n"
        "    pop %rax\n"
        "    ret\n");

/* Variables of a thread, which the system copies from here for each thread: the linker puts them between the two ends. */
unsigned _tls_index;
__attribute__((section(".tls"))) char _tls_start = 0;
__attribute__((section(".tls$ZZZ"))) char _tls_end = 0;
const struct {
    const void *begin, *end, *index, *callbacks;
    uint32_t zeros, flags;
} _tls_used __attribute__((section(".rdata$T"))) = {&_tls_start, &_tls_end, &_tls_index, 0, 0, 0};

#endif
