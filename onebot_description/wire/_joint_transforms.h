/* What fills a plan's TFMessage; kernel.py makes the rows. */
#include <stddef.h>
#include <stdint.h>

#include "../model/_joint.h"

#define ONEBOT_STAMP_AT 4 /* in a serialized message that begins with a header */

/* A row of the array that kernel.py makes (_JOINT there); offsets are in bytes. */
struct joint {
  double half_turn, multiplier, offset;
  double constant[ONEBOT_POSE], sine[4], slide[3];
  uint64_t column, stamp_at, values_at;
};

int onebot_all_moderate(const unsigned char *data, size_t at, size_t count);
void onebot_fill_message(unsigned char *message, const unsigned char *blank, size_t size,
                         const struct joint *joints, size_t count, const unsigned char *data,
                         size_t at);
