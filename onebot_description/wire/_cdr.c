/* Reads sequences of CDR messages whose items hold strings; cdr.py has the format. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))
#define NANO INT64_C(1000000000)
enum { BODY_AT = 4 };

/* A message, and where the next field is looked for. */
struct reader {
  const unsigned char *data;
  uint64_t size, at;
};

/* Copy the next field, of `size` bytes at a multiple of `alignment`; false if it is not there. */
static bool read(struct reader *reader, void *to, uint64_t size, uint64_t alignment) {
  reader->at += -(reader->at - BODY_AT) % alignment;
  if (reader->at > reader->size || reader->size - reader->at < size) return false;
  memcpy(to, reader->data + reader->at, size);
  reader->at += size;
  return true;
}

static bool read_stamp(struct reader *reader, int64_t *stamp) {
  int32_t seconds;
  uint32_t nanoseconds;
  if (!read(reader, &seconds, sizeof seconds, 4)) return false;
  if (!read(reader, &nanoseconds, sizeof nanoseconds, 4)) return false;
  *stamp = seconds * NANO + nanoseconds;
  return true;
}

/* Copy a string with its length before it, as it lies there but for padding. */
static bool read_string(struct reader *reader, unsigned char **to) {
  uint32_t length;
  if (!read(reader, &length, sizeof length, 4)) return false;
  memcpy(*to, &length, sizeof length);
  *to += sizeof length;
  if (!read(reader, *to, length, 1)) return false;
  *to += length;
  return true;
}

/* Read `count` items from byte `at` on. Each has a stamp (if `stamps` is not NULL), so many strings
 * and so many doubles. `text` has room for as many bytes as follow `at`. `*text_size` becomes what
 * is used of it. Return where the items end, or -1 if the message ends before. */
EXPORT int64_t onebot_read_items(const unsigned char *data, uint64_t size, uint64_t at,
                                 uint64_t count, uint64_t strings, uint64_t doubles,
                                 int64_t *stamps, unsigned char *text, uint64_t *text_size,
                                 double *values) {
  struct reader reader = {data, size, at};
  unsigned char *end = text;
  for (uint64_t item = 0; item < count; item++) {
    if (stamps && !read_stamp(&reader, stamps + item)) return -1;
    for (uint64_t i = 0; i < strings; i++)
      if (!read_string(&reader, &end)) return -1;
    if (doubles && !read(&reader, values + item * doubles, doubles * sizeof *values, 8)) return -1;
  }
  *text_size = (uint64_t)(end - text);
  return (int64_t)reader.at;
}
