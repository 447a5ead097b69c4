/* Reads CDR messages of any type, by the programs that schema.py makes of their definition.
 *
 * The messages are untrusted; the programs, and the rows that were made by them, are not checked.
 * Python's functions are declared by its stable ABI, as in _type_support.c.
 */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "_program.h"

#define EXPORT __attribute__((visibility("default")))
enum { BODY_AT = 4, PARTS = 64, KNOWN = 64, HASHED = 16 };

typedef struct _object PyObject;
extern PyObject _Py_NoneStruct;
extern PyObject *PyBytes_FromStringAndSize(const char *, intptr_t);
extern char *PyBytes_AsString(PyObject *);
extern PyObject *PyList_New(intptr_t);
extern int PyList_SetItem(PyObject *, intptr_t, PyObject *); /* takes over the reference */
extern PyObject *PyUnicode_DecodeUTF8(const char *, intptr_t, const char *);
extern PyObject *PyUnicode_DecodeUTF16(const char *, intptr_t, const char *, int *);
extern void Py_IncRef(PyObject *);
extern void Py_DecRef(PyObject *);

/* ---- Structs ---- */

struct message {
  const unsigned char *data;
  uint64_t size;
  const unsigned char *block;
};

/* Return where `count` numbers of `size` bytes each lie from byte `at` on, 0 if they do not. */
static uint64_t find(const struct message *message, uint64_t at, uint64_t size, uint64_t count) {
  at += -(at - BODY_AT) & (size - 1);
  return at <= message->size && message->size - at >= size * count ? at : 0;
}

static bool are_booleans(const unsigned char *bytes, uint64_t count) {
  unsigned char all = 0;
  for (uint64_t i = 0; i < count; i++) all |= bytes[i];
  return all <= 1;
}

static uint64_t read_structs(const struct message *message, uint64_t at, uint32_t number,
                             uint64_t count, unsigned char *row);

static uint64_t read_numbers(const struct message *message, uint64_t at,
                             const struct operation *operation, unsigned char *row) {
  const uint64_t size = (uint64_t)operation->size * operation->count;
  at = find(message, at, operation->size, operation->count);
  if (!at || (operation->booleans && !are_booleans(message->data + at, size))) return 0;
  if (row) memcpy(row + operation->to, message->data + at, size);
  return at + size;
}

static uint64_t read_sequence(const struct message *message, uint64_t at,
                              const struct operation *operation, unsigned char *row) {
  uint32_t slot[2] = {0, operation->count};
  if (!operation->count) {
    at = find(message, at, sizeof *slot, 1);
    if (!at) return 0;
    memcpy(slot + 1, message->data + at, sizeof *slot);
    at += sizeof *slot;
  }
  slot[0] = (uint32_t)at;
  if (!slot[1]) { /* and no padding before nothing */
  } else if (operation->kind == STRUCTS) {
    at = read_structs(message, at, operation->program, slot[1], NULL);
    if (!at) return 0;
  } else {
    at = find(message, at, operation->size, slot[1]);
    if (!at || (operation->booleans && !are_booleans(message->data + at, slot[1]))) return 0;
    slot[0] = (uint32_t)at;
    at += (uint64_t)operation->size * slot[1];
  }
  if (row) memcpy(row + operation->to, slot, sizeof slot);
  return at;
}

/* Return how many of `count` structs after the one from byte `from` to `to`, which is read, have
 * sequences as long as its own, and so all fields at the same distance. */
static uint64_t count_alike(const struct message *message, const struct operation *operation,
                            const struct operation *end, uint64_t from, uint64_t to,
                            uint64_t count) {
  struct {
    uint64_t at, size;
    bool booleans;
  } parts[PARTS]; /* its lengths, and what else needs a check */
  const uint64_t span = to - from;
  uint32_t known = 0;
  if (span % PHASES) return 0;
  for (uint64_t at = from; operation < end; operation++) {
    uint32_t length = operation->count;
    if (known + 2 > PARTS) return 0;
    if (operation->kind != NUMBERS && !length) {
      at = find(message, at, sizeof length, 1);
      memcpy(&length, message->data + at, sizeof length);
      parts[known].at = at;
      parts[known].size = sizeof length;
      parts[known++].booleans = false;
      at += sizeof length;
      if (!length) continue;
    }
    if (operation->kind == STRUCTS) return 0;
    at = find(message, at, operation->size, length);
    if (operation->booleans) {
      parts[known].at = at;
      parts[known].size = length;
      parts[known++].booleans = true;
    }
    at += (uint64_t)operation->size * length;
  }
  for (uint64_t more = 0; more < count; more++) {
    const uint64_t moved = (more + 1) * span;
    if (message->size - to < moved) return more;
    for (uint32_t i = 0; i < known; i++) {
      const unsigned char *part = message->data + parts[i].at;
      if (parts[i].booleans ? !are_booleans(part + moved, parts[i].size)
                            : memcmp(part + moved, part, sizeof(uint32_t)))
        return more;
    }
  }
  return count;
}

/* Read `count` structs from byte `at` on, each into a row unless `row` is NULL. Return where they
 * end, 0 if they are not there. */
static uint64_t read_structs(const struct message *message, uint64_t at, uint32_t number,
                             uint64_t count, unsigned char *row) {
  const struct program *program = (const struct program *)message->block + number;
  const uint64_t left = message->size - at, phase = (at - BODY_AT) % PHASES;
  if (count * program->smallest > left) return 0;
  if (!row && count && program->stride[phase]) {
    const uint64_t span = program->size[phase] + (count - 1) * program->stride[phase];
    return span <= left ? at + span : 0;
  }
  const struct operation *first =
      (const struct operation *)(message->block + program->operations_at);
  const struct operation *end = first + program->operations;
  bool mostly_alike = !row;
  for (uint64_t item = 0; item < count; item++) {
    const uint64_t from = at;
    for (const struct operation *operation = first; operation < end; operation++) {
      at = operation->kind == NUMBERS ? read_numbers(message, at, operation, row)
                                      : read_sequence(message, at, operation, row);
      if (!at) return 0;
    }
    if (row) row += program->row_size;
    if (mostly_alike) {
      const uint64_t more = count_alike(message, first, end, from, at, count - item - 1);
      at += more * (at - from);
      item += more;
      mostly_alike = more || !item; /* the first one may have another padding */
    }
  }
  return at;
}

/* Read `count` structs of a program from byte `at` of a message on. Return their rows as bytes, or
 * None if the message is not that. */
EXPORT PyObject *onebot_read_structs(const unsigned char *data, uint64_t size, uint64_t at,
                                     uint64_t count, const unsigned char *block, uint32_t number) {
  const struct message message = {data, size, block};
  const struct program *program = (const struct program *)block + number;
  /* The rows are a few times as large as the structs at most. */
  if (size > UINT32_MAX || at > size || count > UINT32_MAX || count * program->smallest > size - at) {
    Py_IncRef(&_Py_NoneStruct);
    return &_Py_NoneStruct;
  }
  PyObject *rows = PyBytes_FromStringAndSize(NULL, (intptr_t)(count * program->row_size));
  if (!rows ||
      read_structs(&message, at, number, count, (unsigned char *)PyBytes_AsString(rows)))
    return rows;
  Py_DecRef(rows);
  Py_IncRef(&_Py_NoneStruct);
  return &_Py_NoneStruct;
}

/* ---- Strings ---- */

struct text {
  const unsigned char *bytes;
  uint64_t size;
  PyObject *made; /* lent by the list that holds it */
};

static uint64_t hash(const unsigned char *bytes, uint64_t size) {
  uint64_t value = size; /* and the end, where strings differ most */
  for (uint64_t i = size > HASHED ? size - HASHED : 0; i < size; i++) value = value * 31 + bytes[i];
  return value ^ value >> 7;
}

static PyObject *decode(const struct text *text, uint64_t width) {
  const char *bytes = (const char *)text->bytes;
  uint64_t size = text->size;
  if (width == 1) {
    const char *nul = memchr(bytes, 0, size); /* where rclpy ends it, too */
    return PyUnicode_DecodeUTF8(bytes, nul ? nul - bytes : (intptr_t)size, "replace");
  }
  if (size && !bytes[size - 1] && !bytes[size - width]) size -= width; /* the closing NUL */
  int little_endian = -1;
  return PyUnicode_DecodeUTF16(bytes, (intptr_t)size, "replace", &little_endian);
}

/* Return a list of the strings in `count` rows, `stride` bytes apart, each with where its string
 * lies in the message at byte `at`; equal strings are mostly one object. `width`: bytes of a
 * character. */
EXPORT PyObject *onebot_read_strings(const unsigned char *data, const unsigned char *rows,
                                     uint64_t at, int64_t stride, uint64_t count, uint64_t width) {
  struct text known[KNOWN] = {{0}};
  PyObject *list = PyList_New((intptr_t)count);
  for (uint64_t row = 0; list && row < count; row++) {
    uint32_t slot[2];
    memcpy(slot, rows + at + (int64_t)row * stride, sizeof slot);
    struct text text = {data + slot[0], slot[1] * width, NULL};
    struct text *same = known + hash(text.bytes, text.size) % KNOWN;
    if (same->made && same->size == text.size && !memcmp(same->bytes, text.bytes, text.size)) {
      Py_IncRef(text.made = same->made);
    } else if (!(text.made = decode(&text, width))) {
      Py_DecRef(list);
      return NULL;
    }
    *same = text;
    PyList_SetItem(list, (intptr_t)row, text.made);
  }
  return list;
}
