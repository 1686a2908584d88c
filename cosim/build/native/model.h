/* The description of one model for fmi2.c and fmi3.c. compiled.py generates model.c from the model's declaration, which
   defines these constants; all other code is the same for every model, and a compiler with a cache compiles it once. */

#ifndef MODEL_H
#define MODEL_H

#include <stddef.h>

typedef enum { REAL, INTEGER, BOOLEAN, PACKETS, ENUMERATION, TIME } Kind; /* in FMI 2, an enumeration is an INTEGER */
typedef enum { FIXED, TUNABLE, INPUT, CALCULATED } Role;
typedef struct {
    const char *name;
    Kind kind;
    Role role;
    size_t offset;   /* into the record; of packets: of their bytes */
    size_t length;   /* of packets: offset of the number of bytes used */
    size_t count;    /* elements; of packets: capacity in bytes */
    size_t text;     /* of packets in FMI 2, where they are text: offset into Instance.text */
    double min, max; /* of numbers and enumerations */
} Variable;
typedef struct { int code; const char *text; } KernelError;

#pragma GCC visibility push(hidden)
extern const char MODEL[], GUID[37]; /* 8-4-4-4-12 digits */
extern const size_t RECORD_SIZE, HEAD_SIZE; /* bytes; the head has what is set from outside, and is kept when `start` runs again */
extern const size_t BUSY_FROM, BUSY_TO;     /* the part of the record that any step may touch */
extern const size_t TEXT_SIZE;              /* bytes of all packets as text */
extern const unsigned N_VARIABLES, N_ERRORS;
extern const Variable VARIABLES[];
extern const unsigned short TOGETHER[]; /* FMI 2: for each variable, how many Reals in a row have one role and no other limits */
extern const unsigned char DEFAULTS[];  /* a record with the start values */
extern const KernelError ERRORS[];
extern const char ERROR_CODES[];
#pragma GCC visibility pop

#endif
