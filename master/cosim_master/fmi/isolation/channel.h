/* The memory that the master shares with the process of an FMU file, and the messages in it.

   One side runs at a time. `turn` names it, and the other one sleeps on it (futex). The master writes operations, one
   after the other, and hands over; the process executes them, writes an answer to each, and hands back. The operations of
   an instance are contiguous; after one that has failed, the others of this instance have no answer, after a fatal one,
   all others.

     Header        the first page
     log           entries written by the FMU's calls of its logger, LOG_BYTES
     request       operations: an Operation each, 8 bytes for each of its arguments (0 for an array), and its arrays
     reply         answers: an Answer and the values that the FMU has written, at the next multiple of 64 bytes */

#ifndef CHANNEL_H
#define CHANNEL_H

#define _GNU_SOURCE
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "functions.h"

#define VERSION 2
#define HEADER_BYTES 4096
#define LOG_BYTES 65536
#define MESSAGES (HEADER_BYTES + LOG_BYTES)
#define LARGEST (1ull << 31)
#define ARGUMENTS 8
#define WARNING 1
#define FATAL 4

enum { OF_FMU, OF_MASTER }; /* the memory begins as zeros: the process runs first */

typedef struct {
    uint32_t turn;
    uint32_t version;
    uint64_t size;    /* of the shared file; either side lengthens it */
    uint64_t request; /* bytes */
    uint32_t executed; /* number of operations that have an answer */
    uint32_t running; /* 1 + number of the function that is being called; 0: none */
    uint64_t owner;   /* number of the instance that is called */
    uint32_t quit;
    uint32_t signal; /* that ends the process */
    uint64_t memory; /* in use at that time, bytes */
    uint64_t log;    /* bytes */
    uint64_t lost;   /* log entries that had no room */
    uint32_t restricted; /* bits: RESTRICTED_... */
    uint32_t failed; /* the library cannot be loaded: `text` */
    char text[1024];
    unsigned char has[512]; /* whether the library exports a function */
} Header;

#define RESTRICTED_FILES 1u
#define RESTRICTED_SOCKETS 2u

typedef struct {
    uint32_t function;
    uint32_t after_step; /* executed only if the step before was complete and had no event */
    uint64_t size;       /* bytes, with this */
    uint64_t handle;     /* the instance in its process */
    uint64_t owner;      /* the number of the instance */
} Operation;

typedef struct {
    int32_t status;
    uint32_t operation; /* its number in the request */
    uint64_t size; /* bytes, with this */
} Answer;

typedef struct {
    uint64_t owner;
    int32_t status;
    uint32_t category; /* bytes of the category, with its NUL */
    uint64_t size;     /* bytes, with this; after it the category and the message, each with a NUL */
} Entry;

typedef union {
    int i;
    bool b;
    size_t z;
    double d;
    void *p;
    uint64_t bits;
} Value;

typedef enum { SET, GET, STEP, CALL, BEGIN, END, FREE, MAKE } Kind;
typedef enum { A_END, A_INT, A_BOOL, A_SIZE, A_DOUBLE, A_HANDLE, A_IN, A_OUT, A_PLACE, A_TEXTS_IN, A_TEXTS_OUT, A_BYTES_IN, A_BYTES_OUT } Type;
typedef struct {
    unsigned char type, size, count;
} Argument;
#define INT {A_INT, 0, 0}
#define BOOL {A_BOOL, 0, 0}
#define SIZE {A_SIZE, 0, 0}
#define DOUBLE {A_DOUBLE, 0, 0}
#define HANDLE {A_HANDLE, 0, 0}
#define IN(size, n) {A_IN, size, n}
#define OUT(size, n) {A_OUT, size, n}
#define PLACE(size) {A_PLACE, size, 0}
#define TEXTS_IN(n) {A_TEXTS_IN, 0, n}
#define TEXTS_OUT(n) {A_TEXTS_OUT, 0, n}
#define BYTES_IN(n) {A_BYTES_IN, 0, n}
#define BYTES_OUT(n) {A_BYTES_OUT, 0, n}

typedef enum {
#define SHAPE(name, parameters, arguments) SHAPE_##name,
    SHAPES
#undef SHAPE
        SHAPE_INSTANTIATE
} Shape;

enum {
#define FUNCTION(name, ...) NUMBER_##name,
    FUNCTIONS
#undef FUNCTION
        N_FUNCTIONS
};

typedef struct {
    const char *name;
    Shape shape;
    Kind kind;
    Argument arguments[ARGUMENTS + 1];
} Function;

static const Function TABLE[] = {
#define FUNCTION(name, shape, kind, ...) {#name, SHAPE_##shape, kind, {__VA_ARGS__}},
    FUNCTIONS
#undef FUNCTION
};

/* ---- over a socket --------------------------------------------------------------------------------------------------- */

/* Precedes the operations of a request. */
typedef struct {
    uint64_t bytes;
    double limit; /* s, for each call; 0: none */
} Posted;

/* Precedes a reply. Byte order and sizes are those of x86_64 and aarch64. */
typedef struct {
    uint32_t end; /* of the process, with its details */
    int32_t number;
    uint32_t function, executed;
    uint64_t owner, memory;
    uint64_t log, reply, output; /* bytes that follow */
    uint64_t pulse;              /* 1: this is none, the process is busy */
} Replied;

static inline size_t padded(size_t n) { return (n + 7) & ~(size_t)7; }

static inline size_t reply_at(const Header *h) { return MESSAGES + ((h->request + 63) & ~(uint64_t)63); }

/* Returns the bytes of an argument whose size the numbers among the arguments determine. */
static inline size_t bytes_of(const Argument *a, const Value *values) {
    return a->type == A_PLACE ? a->size : (size_t)a->size * values[a->count].z;
}

#endif
