/* Transforms of frames over time, and the transform between two frames at a time, as tf2 computes
 * it; transform_buffer.py has the names of frames, and words for what fails. Plain functions on
 * numbers that know nothing of Python or ROS.
 */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))

enum { POSE = 7 };                /* translation x y z, m; rotation x y z w */
enum { DEEPEST = 1000 };          /* frames above each other; more are a loop */
enum { ABSENT, MOVING, STATIC };  /* what is known of a frame: nothing, a history, one transform */
enum {                            /* as in transform_buffer.py */
  OK, LOOP, UNCONNECTED, EMPTY, ONE_TIME, TOO_LATE, TOO_EARLY, OUT_OF_MEMORY,
};

/* The pose of a frame in its parent at a time. */
struct sample {
  int64_t stamp, parent; /* nanoseconds; number of the parent's frame */
  double pose[POSE];
};

/* The history of a frame, by stamps; of equal stamps, the last received is the last. */
struct frame {
  int64_t kind, count, capacity;
  struct sample *samples, *first; /* the memory; the oldest in it */
};

struct buffer {
  struct frame *frames; /* by number; 0 is no frame */
  int64_t count, total; /* frames; samples in all of them */
  int64_t cache;        /* how long samples are kept, nanoseconds */
  int64_t live;         /* 0: as tf2; else how far stamps may go back before the history restarts,
                         * as it also does with another parent; an equal stamp replaces a sample */
  int64_t most;         /* samples kept in all frames */
};

/* A transform to add. */
struct row {
  int64_t parent, child, stamp;
  double pose[POSE];
};

struct result {
  int64_t stamp, edge; /* the time used or requested; the stamp that it lies beyond */
  double pose[POSE];
};

/* ---- Rotations, in the order of operations of tf2: the sign of a result depends on rounding ---- */

static void multiply(const double a[4], const double b[4], double out[4]) {
  const double product[4] = {
      a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
      a[3] * b[1] + a[1] * b[3] + a[2] * b[0] - a[0] * b[2],
      a[3] * b[2] + a[2] * b[3] + a[0] * b[1] - a[1] * b[0],
      a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  };
  memcpy(out, product, sizeof product);
}

/* q v q*, which also scales by the squared length of q. */
static void rotate(const double q[4], const double v[3], double out[3]) {
  const double vector[4] = {v[0], v[1], v[2], 0.0}, back[4] = {-q[0], -q[1], -q[2], q[3]};
  double product[4];
  multiply(q, vector, product);
  multiply(product, back, product);
  memcpy(out, product, 3 * sizeof *out);
}

static void to_basis(const double q[4], double m[3][3]) {
  const double scale = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  const double x = q[0] * scale, y = q[1] * scale, z = q[2] * scale;
  const double wx = q[3] * x, wy = q[3] * y, wz = q[3] * z, xx = q[0] * x, xy = q[0] * y;
  const double xz = q[0] * z, yy = q[1] * y, yz = q[1] * z, zz = q[2] * z;
  const double rows[3][3] = {{1.0 - (yy + zz), xy - wz, xz + wy},
                             {xy + wz, 1.0 - (xx + zz), yz - wx},
                             {xz - wy, yz + wx, 1.0 - (xx + yy)}};
  memcpy(m, rows, sizeof rows);
}

static void to_quaternion(double m[3][3], double q[4]) {
  const double trace = m[0][0] + m[1][1] + m[2][2];
  if (trace > 0.0) {
    double s = sqrt(trace + 1.0);
    q[3] = s * 0.5;
    s = 0.5 / s;
    q[0] = (m[2][1] - m[1][2]) * s;
    q[1] = (m[0][2] - m[2][0]) * s;
    q[2] = (m[1][0] - m[0][1]) * s;
    return;
  }
  const int i = m[0][0] < m[1][1] ? (m[1][1] < m[2][2] ? 2 : 1) : (m[0][0] < m[2][2] ? 2 : 0);
  const int j = (i + 1) % 3, k = (i + 2) % 3;
  double s = sqrt(m[i][i] - m[j][j] - m[k][k] + 1.0);
  q[i] = s * 0.5;
  s = 0.5 / s;
  q[3] = (m[k][j] - m[j][k]) * s;
  q[j] = (m[j][i] + m[i][j]) * s;
  q[k] = (m[k][i] + m[i][k]) * s;
}

/* From `first` to `second` by `part`, along the shorter arc. */
static void slerp(const double first[4], const double second[4], double part, double out[4]) {
  double inner = 0.0, lengths[2] = {0.0, 0.0};
  for (int i = 0; i < 4; i++) {
    inner += first[i] * second[i];
    lengths[0] += first[i] * first[i];
    lengths[1] += second[i] * second[i];
  }
  const double cosine = fabs(inner) / sqrt(lengths[0] * lengths[1]);
  const double angle = acos(cosine > 1.0 ? 1.0 : cosine);
  if (angle == 0.0) {
    memcpy(out, first, 4 * sizeof *out);
    return;
  }
  const double scale = 1.0 / sin(angle), from = sin((1.0 - part) * angle);
  const double to = inner < 0.0 ? -sin(part * angle) : sin(part * angle);
  for (int i = 0; i < 4; i++) out[i] = (first[i] * from + second[i] * to) * scale;
}

/* ---- A frame's history ---- */

static struct frame *frame_of(const struct buffer *buffer, int64_t number) {
  if (number <= 0 || number >= buffer->count) return NULL;
  struct frame *frame = &buffer->frames[number];
  return frame->kind == ABSENT ? NULL : frame;
}

static int64_t latest_stamp(const struct frame *frame) {
  return frame->kind == STATIC || frame->count == 0 ? 0 : frame->first[frame->count - 1].stamp;
}

static int64_t latest_parent(const struct frame *frame) {
  return frame && frame->count ? frame->first[frame->count - 1].parent : 0;
}

static void drop(struct buffer *buffer, struct frame *frame, int64_t count) {
  frame->first += count;
  frame->count -= count;
  buffer->total -= count;
}

static void prune(struct buffer *buffer, struct frame *frame) {
  const int64_t latest = latest_stamp(frame);
  int64_t old = 0;
  while (old < frame->count && frame->first[old].stamp + buffer->cache < latest) old++;
  drop(buffer, frame, old);
}

/* Make room for one more sample at the end. */
static bool reserve(struct frame *frame) {
  const int64_t at = frame->first - frame->samples;
  if (at + frame->count < frame->capacity) return true;
  if (at > frame->capacity / 2) {
    memmove(frame->samples, frame->first, (size_t)frame->count * sizeof *frame->first);
    frame->first = frame->samples;
    return true;
  }
  const int64_t capacity = frame->capacity ? frame->capacity * 2 : 1;
  struct sample *samples = realloc(frame->samples, (size_t)capacity * sizeof *samples);
  if (!samples) return false;
  *frame = (struct frame){frame->kind, frame->count, capacity, samples, samples + at};
  return true;
}

/* The number of samples with a stamp of at most `stamp`. */
static int64_t count_until(const struct frame *frame, int64_t stamp) {
  int64_t low = 0, high = frame->count;
  if (high && frame->first[high - 1].stamp <= stamp) return high;
  while (low < high) {
    const int64_t middle = (low + high) / 2;
    if (frame->first[middle].stamp <= stamp) low = middle + 1;
    else high = middle;
  }
  return low;
}

static bool is_known(const struct frame *frame, const struct sample *sample, int64_t until) {
  for (int64_t i = until; i-- > 0 && frame->first[i].stamp == sample->stamp;) {
    const struct sample *same = &frame->first[i];
    bool equal = same->parent == sample->parent;
    for (int j = 0; j < POSE; j++) equal = equal && same->pose[j] == sample->pose[j];
    if (equal) return true;
  }
  return false;
}

/* Insert a sample; false if it is older than the history may be. */
static bool insert(struct buffer *buffer, struct frame *frame, const struct sample *sample) {
  const int64_t latest = latest_stamp(frame);
  if (!buffer->live) prune(buffer, frame);
  else if (latest - sample->stamp > buffer->live || latest_parent(frame) != sample->parent)
    drop(buffer, frame, frame->count);
  if (frame->count && sample->stamp < latest - buffer->cache) return false;
  if (frame->count && buffer->total >= buffer->most) drop(buffer, frame, 1);
  const int64_t at = count_until(frame, sample->stamp);
  struct sample *place = frame->first + at;
  if (buffer->live && at && place[-1].stamp == sample->stamp) {
    place[-1] = *sample;
    return true;
  }
  if (is_known(frame, sample, at)) return true;
  if (!reserve(frame)) return false;
  place = frame->first + at;
  memmove(place + 1, place, (size_t)(frame->count - at) * sizeof *place);
  *place = *sample;
  frame->count++;
  buffer->total++;
  if (buffer->live) prune(buffer, frame);
  return true;
}

/* Find a frame's sample at a time, 0 for the latest. Beyond the history it is the nearest for a
 * lookup with a `span`, unless the time is earlier by more than that: then it seems to be of
 * another clock, and the sample is the latest. */
static int sample_at(const struct frame *frame, int64_t stamp, int64_t span, struct sample *out,
                     int64_t *edge) {
  if (frame->count == 0) return EMPTY;
  const struct sample *first = frame->first, *last = frame->first + frame->count - 1;
  *out = *last;
  if (frame->kind == STATIC || stamp == 0 || stamp == last->stamp) return OK;
  if (stamp < first->stamp || stamp > last->stamp) {
    *edge = stamp < first->stamp ? first->stamp : last->stamp;
    if (!span) return first == last ? ONE_TIME : stamp < first->stamp ? TOO_EARLY : TOO_LATE;
    if (stamp < first->stamp && stamp > first->stamp - span) *out = *first;
    return OK;
  }
  if (stamp == first->stamp) {
    *out = *first;
    return OK;
  }
  const struct sample *one = first + count_until(frame, stamp) - 1, *two = one + 1;
  *out = *one;
  if (one->parent != two->parent) return OK;
  const double part = (double)(stamp - one->stamp) / (double)(two->stamp - one->stamp);
  for (int i = 0; i < 3; i++) out->pose[i] = (1.0 - part) * one->pose[i] + part * two->pose[i];
  slerp(one->pose + 3, two->pose + 3, part, out->pose + 3);
  return OK;
}

/* ---- Between frames ---- */

/* The latest time at which all transforms between two frames are known; 0 if all are static. */
static int common_time(const struct buffer *buffer, int64_t target, int64_t source,
                       int64_t *stamp) {
  struct step {
    int64_t stamp, parent;
  } steps[DEEPEST + 1];
  int64_t count = 0, time = INT64_MAX;
  const struct frame *frame;
  if (target == source) {
    frame = frame_of(buffer, source);
    *stamp = frame ? latest_stamp(frame) : 0;
    return OK;
  }
  for (int64_t number = source; latest_parent(frame = frame_of(buffer, number));) {
    steps[count++] = (struct step){latest_stamp(frame), number = latest_parent(frame)};
    if (latest_stamp(frame) && latest_stamp(frame) < time) time = latest_stamp(frame);
    if (number == target) {
      *stamp = time == INT64_MAX ? 0 : time;
      return OK;
    }
    if (count > DEEPEST) return LOOP;
  }
  time = INT64_MAX;
  int64_t depth = 0, common = 0;
  for (int64_t number = target; latest_parent(frame = frame_of(buffer, number));) {
    if (latest_stamp(frame) && latest_stamp(frame) < time) time = latest_stamp(frame);
    number = latest_parent(frame);
    for (int64_t i = 0; i < count && !common; i++)
      if (steps[i].parent == number) common = number;
    if (common) break;
    if (number == source) {
      *stamp = time == INT64_MAX ? 0 : time;
      return OK;
    }
    if (++depth > DEEPEST) return LOOP;
  }
  if (!common) return UNCONNECTED;
  for (int64_t i = 0; i < count; i++) {
    if (steps[i].stamp && steps[i].stamp < time) time = steps[i].stamp;
    if (steps[i].parent == common) break;
  }
  *stamp = time == INT64_MAX ? 0 : time;
  return OK;
}

/* Place a pose that is in a frame in the frame's parent. */
static void raise_pose(const double frame[POSE], double pose[POSE]) {
  double at[3];
  rotate(frame + 3, pose, at);
  for (int i = 0; i < 3; i++) pose[i] = at[i] + frame[i];
  multiply(frame + 3, pose + 3, pose + 3);
}

/* The pose of `source` in `target`: both are followed to a frame above them, `limit` if it is not
 * 0. With such a limit, the nearest samples are used, and the latest of each frame for time 0. */
static int find_pose(const struct buffer *buffer, int64_t target, int64_t source, int64_t stamp,
                     int64_t limit, struct result *out) {
  const int64_t span = limit ? buffer->cache : 0;
  const double identity[POSE] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  double up[POSE];
  memcpy(up, identity, sizeof up);
  memcpy(out->pose, identity, sizeof identity);
  if (stamp == 0 && !limit) {
    const int failure = common_time(buffer, target, source, &stamp);
    if (failure) return failure;
  }
  out->stamp = stamp;
  if (source == target) return OK;
  struct sample sample;
  int failure = OK;
  int64_t depth = 0, top = source;
  for (int64_t number = source; number != 0;) {
    const struct frame *frame = frame_of(buffer, top = number);
    if (!frame || number == limit) break;
    if ((failure = sample_at(frame, stamp, span, &sample, &out->edge))) break;
    if (number == target) {
      memcpy(out->pose, up, sizeof up);
      return OK;
    }
    raise_pose(sample.pose, up);
    number = sample.parent;
    if (++depth > DEEPEST) return LOOP;
  }
  double down[POSE];
  memcpy(down, identity, sizeof down);
  depth = 0;
  bool below = false; /* whether `source` is above `target` */
  int64_t number = target;
  while (number != top && !below) {
    const struct frame *frame = frame_of(buffer, number);
    if (!frame) break;
    const int error = sample_at(frame, stamp, span, &sample, &out->edge);
    if (error) return error;
    below = number == source;
    if (below) break;
    raise_pose(sample.pose, down);
    number = sample.parent;
    if (++depth > DEEPEST) return LOOP;
  }
  if (!below && number != top) return failure ? failure : UNCONNECTED;
  const double back[4] = {-down[3], -down[4], -down[5], down[6]};
  const double negative[3] = {-down[0], -down[1], -down[2]};
  double at[3];
  rotate(back, negative, out->pose);
  memcpy(out->pose + 3, back, sizeof back);
  if (below) return OK;
  rotate(back, up, at);
  for (int i = 0; i < 3; i++) out->pose[i] += at[i];
  multiply(back, up + 3, out->pose + 3);
  return OK;
}

/* ---- The interface ---- */

EXPORT struct buffer *onebot_buffer_new(int64_t cache, int64_t live, int64_t most) {
  struct buffer *buffer = calloc(1, sizeof *buffer);
  if (buffer) *buffer = (struct buffer){NULL, 0, 0, cache, live, most};
  return buffer;
}

EXPORT void onebot_buffer_free(struct buffer *buffer) {
  for (int64_t i = 0; i < buffer->count; i++) free(buffer->frames[i].samples);
  free(buffer->frames);
  free(buffer);
}

/* Have `count` frames, numbered from 0, of which 0 is none. */
EXPORT int onebot_buffer_grow(struct buffer *buffer, int64_t count) {
  struct frame *frames = realloc(buffer->frames, (size_t)count * sizeof *frames);
  if (!frames) return OUT_OF_MEMORY;
  memset(frames + buffer->count, 0, (size_t)(count - buffer->count) * sizeof *frames);
  buffer->frames = frames;
  buffer->count = count;
  return OK;
}

/* Forget a frame's samples; `kind` is MOVING for an empty history, ABSENT for no frame. */
EXPORT void onebot_buffer_empty(struct buffer *buffer, int64_t number, int64_t kind) {
  struct frame *frame = &buffer->frames[number];
  buffer->total -= frame->count;
  free(frame->samples);
  *frame = (struct frame){kind, 0, 0, NULL, NULL};
}

/* Make a quaternion of any length the one that tf2 keeps, which makes it a matrix first; NaN if it
 * has no direction. */
EXPORT void onebot_buffer_unit(double *rotation) {
  double basis[3][3];
  to_basis(rotation, basis);
  to_quaternion(basis, rotation);
}

/* Add transforms. Returns how many were taken, plus 2^32 for each frame with another parent. */
EXPORT int64_t onebot_buffer_add(struct buffer *buffer, const struct row *rows, int64_t count,
                                 int64_t is_static) {
  const int64_t kind = is_static ? STATIC : MOVING;
  int64_t result = 0;
  for (const struct row *row = rows; row < rows + count; row++) {
    struct frame *frame = &buffer->frames[row->child];
    struct sample sample = {is_static ? 0 : row->stamp, row->parent, {0.0}};
    memcpy(sample.pose, row->pose, sizeof sample.pose);
    if (!buffer->live) onebot_buffer_unit(sample.pose + 3);
    const int64_t before = latest_parent(frame);
    if (is_static || frame->kind != kind) onebot_buffer_empty(buffer, row->child, kind);
    result += insert(buffer, frame, &sample);
    if (latest_parent(frame) != before) result += INT64_C(1) << 32;
  }
  return result;
}

/* The pose of `source` in `target` at a time, 0 for the latest. */
EXPORT int onebot_buffer_lookup(const struct buffer *buffer, int64_t target, int64_t source,
                                int64_t stamp, int64_t limit, struct result *out) {
  const int failure = find_pose(buffer, target, source, stamp, limit, out);
  if (failure) return failure;
  onebot_buffer_unit(out->pose + 3);
  return OK;
}

EXPORT int onebot_buffer_common_time(const struct buffer *buffer, int64_t target, int64_t source,
                                     int64_t *stamp) {
  return common_time(buffer, target, source, stamp);
}

/* The time up to which all transforms between a frame and `top`, above it, are known. */
EXPORT int64_t onebot_buffer_known_until(const struct buffer *buffer, int64_t number, int64_t top) {
  int64_t until = INT64_MAX;
  while (number != top) {
    const struct frame *frame = frame_of(buffer, number);
    if (frame->kind == MOVING && latest_stamp(frame) < until) until = latest_stamp(frame);
    number = latest_parent(frame);
  }
  return until;
}

/* One row of `states` for each of some frames: kind, parent, samples, oldest and latest stamp; and
 * one of `poses`. */
EXPORT void onebot_buffer_states(const struct buffer *buffer, int64_t first, int64_t count,
                                 int64_t *states, double *poses) {
  for (int64_t i = first; i < first + count; i++, states += 5, poses += POSE) {
    const struct frame *frame = &buffer->frames[i];
    const int64_t oldest = frame->kind == MOVING && frame->count ? frame->first->stamp : 0;
    const int64_t row[5] = {frame->kind, latest_parent(frame), frame->count, oldest,
                            latest_stamp(frame)};
    memcpy(states, row, sizeof row);
    if (frame->count) memcpy(poses, frame->first[frame->count - 1].pose, POSE * sizeof *poses);
  }
}
