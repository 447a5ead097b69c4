/* A JointState's bytes in, a TFMessage's bytes out: what compiled_path.py tells of, as a builtin.
 *
 * The interpreter's own code is cold when a message comes in: each of the hundred-odd steps of the
 * long way in Python then takes several times what it takes in a loop. So the usual message is
 * handled in one call. Whatever is not usual is left, untouched, to the long way.
 *
 * Python's functions are declared by its stable ABI, as in _tf_message.c.
 */
#include <stdbool.h>
#include <string.h>

#include "_joint_transforms.h"

#define EXPORT __attribute__((visibility("default")))
#define NANO INT64_C(1000000000)
enum { KNOWN = 8, NAMES_AT = 12, CHUNK = 64 };

/* ---- Python ---- */

typedef struct _object PyObject;
typedef PyObject *(*fast_call)(PyObject *, PyObject *const *, intptr_t);
struct method { /* PyMethodDef */
  const char *name;
  fast_call call;
  int flags;
  const char *doc;
};
enum { METH_FASTCALL = 0x80 };
extern PyObject _Py_NoneStruct, *PyExc_TypeError;
extern PyObject *PyBytes_FromStringAndSize(const char *, intptr_t);
extern int PyBytes_AsStringAndSize(PyObject *, char **, intptr_t *);
extern char *PyBytes_AsString(PyObject *);
extern PyObject *PyCFunction_NewEx(struct method *, PyObject *, PyObject *);
extern PyObject *PyErr_Format(PyObject *, const char *, ...);
extern PyObject *PyErr_Occurred(void);
extern long long PyLong_AsLongLong(PyObject *);
extern void *PyLong_AsVoidPtr(PyObject *);
extern PyObject *PyObject_CallFunctionObjArgs(PyObject *, ...);
extern PyObject *PyTuple_GetItem(PyObject *, intptr_t); /* lends the reference */
extern void Py_IncRef(PyObject *);

/* ---- What compiled_path.py keeps ---- */

/* _Layout there. */
struct layout {
  const unsigned char *block, *mask; /* frame_id, names, number of positions; 0 where it is padding */
  uint64_t size;                     /* of both, in bytes */
  uint64_t first, positions;         /* where they begin, in bytes, and how many there are */
  const struct joint *joints;
  uint64_t count;       /* of the joints, at least 1 */
  const int64_t *rows;  /* whose times are theirs */
  const unsigned char *message; /* the TFMessage of the joints, but for stamps and numbers */
  uint64_t message_size;
};

/* _State there. */
struct state {
  int64_t interval, ignore_timestamp;
  int64_t *newest_call, *times; /* the times of the last messages, one a joint */
  uint64_t known, recent;       /* layouts, and the one that served last */
  struct layout layouts[KNOWN];
};

/* ---- One message ---- */

static bool same_text(const unsigned char *data, const struct layout *layout) {
  for (uint64_t at = 0; at < layout->size; at += CHUNK) {
    const uint64_t left = layout->size - at, some = left < CHUNK ? left : CHUNK;
    unsigned char differences = 0;
    for (uint64_t i = at; i < at + some; i++)
      differences |= (unsigned char)((data[i] ^ layout->block[i]) & layout->mask[i]);
    if (differences) return false;
  }
  return true;
}

/* The known layout that a message has, all of whose positions are there; NULL if none. */
static const struct layout *find(struct state *state, const unsigned char *data, uint64_t size) {
  if (size < NAMES_AT || data[0] != 0 || data[1] != 1) return NULL;
  /* First as the bytes stand; then without the padding, whose bytes are arbitrary. */
  for (int masked = 0; masked < 2; masked++) {
    for (uint64_t tried = 0; tried < state->known; tried++) {
      const uint64_t number = (state->recent + tried) % state->known;
      const struct layout *layout = &state->layouts[number];
      if (size < layout->first + layout->positions * sizeof(double)) continue;
      if (masked ? same_text(data + NAMES_AT, layout)
                 : memcmp(data + NAMES_AT, layout->block, layout->size) == 0) {
        state->recent = number;
        return layout;
      }
    }
  }
  return NULL;
}

static int64_t read_stamp(const unsigned char *data) {
  int32_t seconds;
  uint32_t nanoseconds;
  memcpy(&seconds, data + ONEBOT_STAMP_AT, sizeof seconds);
  memcpy(&nanoseconds, data + ONEBOT_STAMP_AT + sizeof seconds, sizeof nanoseconds);
  return seconds * NANO + nanoseconds;
}

static bool is_early(const struct state *state, const struct layout *layout, int64_t stamp) {
  if (state->ignore_timestamp) return false;
  int64_t oldest = INT64_MAX - state->interval;
  for (uint64_t i = 0; i < layout->count; i++) {
    const int64_t time = state->times[layout->rows[i]];
    oldest = time < oldest ? time : oldest;
  }
  return stamp < oldest + state->interval;
}

static PyObject *publish(struct state *state, const struct layout *layout,
                         const unsigned char *data, int64_t stamp) {
  PyObject *bytes = PyBytes_FromStringAndSize(NULL, (intptr_t)layout->message_size);
  if (!bytes) return NULL;
  unsigned char *message = (unsigned char *)PyBytes_AsString(bytes);
  onebot_fill_message(message, layout->message, layout->message_size, layout->joints,
                      layout->count, data, layout->first);
  for (uint64_t i = 0; i < layout->count; i++) state->times[layout->rows[i]] = stamp;
  return bytes;
}

/* self: the address of a struct state, the long way, and what keeps the memory. */
static PyObject *convert(PyObject *self, PyObject *const *arguments, intptr_t count) {
  if (count != 2)
    return PyErr_Format(PyExc_TypeError, "expected data and now_ns, not %zd arguments", count);
  char *text;
  intptr_t size;
  if (PyBytes_AsStringAndSize(arguments[0], &text, &size) < 0) return NULL;
  const int64_t now = PyLong_AsLongLong(arguments[1]);
  if (now == -1 && PyErr_Occurred()) return NULL;
  struct state *state = PyLong_AsVoidPtr(PyTuple_GetItem(self, 0));
  const unsigned char *data = (const unsigned char *)text;
  const struct layout *layout = find(state, data, (uint64_t)size);
  if (layout && now >= *state->newest_call &&
      onebot_all_moderate(data, layout->first, layout->positions)) {
    const int64_t stamp = read_stamp(data);
    if (stamp != 0 || state->ignore_timestamp) {
      const bool early = is_early(state, layout, stamp);
      PyObject *result = early ? &_Py_NoneStruct : publish(state, layout, data, stamp);
      if (early) Py_IncRef(result);
      if (result) *state->newest_call = now;
      return result;
    }
  }
  return PyObject_CallFunctionObjArgs(PyTuple_GetItem(self, 1), arguments[0], arguments[1], NULL);
}

static struct method convert_method = {
  "convert_bytes", convert, METH_FASTCALL,
  "convert_bytes(data, now_ns)\n--\n\nTurn a serialized JointState into a serialized TFMessage.",
};

/* Return the builtin; see convert() for what `self` has to be. */
EXPORT PyObject *onebot_state_converter(PyObject *self) {
  return PyCFunction_NewEx(&convert_method, self, NULL);
}
