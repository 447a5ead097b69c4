/* Programs, which schema.py makes of the definition of a type: all of a definition lie in one
 * block, and how they read it is in _schema.c.
 */
#ifndef ONEBOT_PROGRAM_H
#define ONEBOT_PROGRAM_H
#include <stdint.h>

enum { PHASES = 8 };

enum kind {
  NUMBERS,  /* a fixed number of numbers: copied into the row */
  SEQUENCE, /* numbers or characters: the row gets where they lie and how many they are */
  STRUCTS,  /* of another program: as well, with where the first one begins, before padding */
};

struct operation {
  uint32_t kind, size, count; /* count 0 of a sequence or of structs: the message has it */
  uint32_t to;                /* byte in the row */
  uint32_t program;
  uint32_t booleans; /* each number must be 0 or 1: NumPy relies on that */
};

struct program {
  uint32_t operations_at, operations; /* byte in the block, number */
  uint32_t smallest;                  /* bytes of a struct in a message at least, never 0 */
  uint32_t row_size;
  /* By the start of a struct modulo PHASES: its bytes, and those from one to the next where that
   * is constant and nothing in them needs a check; else 0. */
  uint32_t size[PHASES], stride[PHASES];
};

#endif
