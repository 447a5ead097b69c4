/* The bytes of a JointState in, the bytes of a TFMessage out: the compiled way of
 * state_converter.py, as a builtin function.
 *
 * One call, because the interpreter's own code is cold when a message comes in: each of the
 * hundred-odd steps that the same takes in Python then takes several times what it takes in a loop.
 * A message that is not recognised is passed on, untouched, to the way through ordinary messages.
 *
 * Python's functions are declared by its stable ABI, as in _type_support.c.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "../../model/_joint.h"

#define EXPORT __attribute__((visibility("default")))
#define NANO INT64_C(1000000000)
#define MODERATE 1e100
enum {
  KNOWN = 16, /* as in state_converter.py */
  BODY_AT = 4,
  STAMP_AT = 4, /* in a serialized message that begins with a header */
  NAMES_AT = 12,
  CHUNK = 64,
};

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

/* ---- What state_converter.py knows of the messages; offsets and sizes are in bytes ---- */

/* A joint that a message moves; a row of the array _JOINT there. */
struct joint {
  double half_turn, multiplier, offset;
  double constant[ONEBOT_POSE], sine[4], slide[3];
  uint64_t column;              /* of the message's positions */
  uint64_t stamp_at, values_at; /* in the TFMessage */
};

/* Messages of one frame_id and one list of joint names; _Layout there. */
struct layout {
  const unsigned char *block, *mask; /* frame_id, names, number of positions; 0 where it is padding */
  uint64_t size;                     /* of both */
  uint64_t first, positions;         /* where they begin, and how many there are */
  const struct joint *joints;        /* in the order of their places in the TFMessage */
  uint64_t count;                    /* of the joints, at least 1 */
  const int64_t *rows;               /* of the joints in state.times */
  const unsigned char *message;      /* the TFMessage of the joints, without stamps and numbers */
  uint64_t message_size;
};

/* _State there. */
struct state {
  int64_t interval, ignore_timestamp;
  int64_t *newest_call, *times; /* stamp of the last publication of each joint */
  uint64_t known, recent;       /* how many layouts there are; the one that was found last */
  struct layout layouts[KNOWN];
};

/* ---- Recognise a message ---- */

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

/* Whether a sequence of doubles begins at `*at` and is whole; `*at` is then behind it. */
static bool skip_doubles(const unsigned char *data, uint64_t size, uint64_t *at) {
  uint32_t count;
  if (size - *at < sizeof count) return false;
  memcpy(&count, data + *at, sizeof count);
  *at += sizeof count;
  if (count == 0) return true;
  *at += -(*at - BODY_AT) % sizeof(double);
  if (size < *at || (size - *at) / sizeof(double) < count) return false;
  *at += count * sizeof(double);
  return true;
}

/* Whether positions, velocities and efforts are all there. */
static bool is_whole(const unsigned char *data, uint64_t size, const struct layout *layout) {
  uint64_t at = layout->first + layout->positions * sizeof(double);
  return size >= at && skip_doubles(data, size, &at) && skip_doubles(data, size, &at);
}

/* The layout that a message has; NULL if it is not known or the message is not whole. */
static const struct layout *find(struct state *state, const unsigned char *data, uint64_t size) {
  if (size < NAMES_AT || data[0] != 0 || data[1] != 1) return NULL;
  /* First as the bytes are; then without the padding, whose bytes are arbitrary. */
  for (int masked = 0; masked < 2; masked++) {
    for (uint64_t tried = 0; tried < state->known; tried++) {
      const uint64_t number = (state->recent + tried) % state->known;
      const struct layout *layout = &state->layouts[number];
      if (size - NAMES_AT < layout->size) continue;
      if (masked ? same_text(data + NAMES_AT, layout)
                 : memcmp(data + NAMES_AT, layout->block, layout->size) == 0) {
        state->recent = number;
        return is_whole(data, size, layout) ? layout : NULL;
      }
    }
  }
  return NULL;
}

static inline double position_of(const struct joint *joint, const unsigned char *positions) {
  return onebot_load(positions, (int64_t)joint->column) * joint->multiplier + joint->offset;
}

/* Whether no joint's position is NaN or larger than MODERATE: its transform is finite then. */
static ONEBOT_WIDE bool all_moderate(const struct layout *layout, const unsigned char *positions) {
  int64_t others = 0;
  for (uint64_t i = 0; i < layout->count; i++)
    others += !(fabs(position_of(layout->joints + i, positions)) <= MODERATE);
  return others == 0;
}

/* ---- Publish it ---- */

static int64_t read_stamp(const unsigned char *data) {
  int32_t seconds;
  uint32_t nanoseconds;
  memcpy(&seconds, data + STAMP_AT, sizeof seconds);
  memcpy(&nanoseconds, data + STAMP_AT + sizeof seconds, sizeof nanoseconds);
  return seconds * NANO + nanoseconds;
}

/* DUE is published, EARLY is not. OLD is left to the way through ordinary messages, which warns. */
enum due { DUE, EARLY, OLD };

static ONEBOT_WIDE enum due when_due(const struct state *state, const struct layout *layout,
                                    int64_t stamp) {
  if (state->ignore_timestamp) return DUE;
  int64_t oldest = INT64_MAX - state->interval;
  for (uint64_t i = 0; i < layout->count; i++) {
    const int64_t time = state->times[layout->rows[i]];
    oldest = time < oldest ? time : oldest;
  }
  if (stamp >= oldest + state->interval) return DUE;
  return stamp >= oldest ? EARLY : OLD;
}

/* Positions of up to ONEBOT_SOME joints, and the sines and cosines of their half turns. */
struct some {
  double position[ONEBOT_SOME], sine[ONEBOT_SOME], cosine[ONEBOT_SOME];
};

static inline void read_some(struct some *some, const struct joint *joints, size_t count,
                             const unsigned char *positions) {
  double angle[ONEBOT_SOME] = {0.0};
  for (size_t i = 0; i < count; i++) {
    some->position[i] = position_of(joints + i, positions);
    angle[i] = some->position[i] * joints[i].half_turn;
  }
  onebot_sines(angle, some->sine, some->cosine, (int64_t)count);
}

/* Write the TFMessage for the JointState `data`, in one pass. */
static ONEBOT_WIDE void fill(unsigned char *message, const struct layout *layout,
                             const unsigned char *data) {
  size_t copied = 0;
  uint64_t stamp;
  memcpy(&stamp, data + STAMP_AT, sizeof stamp);
  for (size_t first = 0; first < layout->count; first += ONEBOT_SOME) {
    const struct joint *joints = layout->joints + first;
    const size_t number = (size_t)onebot_some_of((int64_t)(layout->count - first));
    struct some some;
    read_some(&some, joints, number, data + layout->first);
    const size_t end = joints[number - 1].values_at + ONEBOT_POSE * sizeof(double);
    memcpy(message + copied, layout->message + copied, end - copied);
    copied = end;
    for (size_t i = 0; i < number; i++) {
      const struct joint *joint = joints + i;
      memcpy(message + joint->stamp_at, &stamp, sizeof stamp);
      onebot_joint_transform(joint->constant, joint->sine, joint->slide, some.position[i],
                             some.sine[i], some.cosine[i], message + joint->values_at);
    }
  }
}

static PyObject *publish(struct state *state, const struct layout *layout,
                         const unsigned char *data, int64_t stamp) {
  PyObject *bytes = PyBytes_FromStringAndSize(NULL, (intptr_t)layout->message_size);
  if (!bytes) return NULL;
  fill((unsigned char *)PyBytes_AsString(bytes), layout, data);
  for (uint64_t i = 0; i < layout->count; i++) state->times[layout->rows[i]] = stamp;
  return bytes;
}

/* self: the address of a struct state, the way through ordinary messages, and what keeps the
 * memory. */
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
  if (layout && now >= *state->newest_call && all_moderate(layout, data + layout->first)) {
    const int64_t stamp = read_stamp(data);
    const enum due due = when_due(state, layout, stamp);
    if (due != OLD && (stamp > 0 || state->ignore_timestamp)) {
      PyObject *result = due == EARLY ? &_Py_NoneStruct : publish(state, layout, data, stamp);
      if (due == EARLY) Py_IncRef(result);
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
