/* The transforms of a robot's joints, written straight into a serialized TFMessage.
 *
 * The same arithmetic as JointArrays.transforms in model/robot_model.py, in one pass and without the
 * dozen calls of numpy, which cost more than the arithmetic itself below some hundred joints.
 */
#include "_joint_transforms.h"

#define EXPORT __attribute__((visibility("default")))
#define MODERATE 1e100

/* Transforms of up to ONEBOT_SOME joints, from positions that need not be aligned. */
static inline void transforms(const struct joint *joints, size_t count,
                              const unsigned char *positions, double *out) {
  double position[ONEBOT_SOME], angle[ONEBOT_SOME] = {0.0};
  double sine[ONEBOT_SOME], cosine[ONEBOT_SOME];
  for (size_t i = 0; i < count; i++) {
    position[i] = onebot_load(positions, (int64_t)joints[i].column);
    position[i] = position[i] * joints[i].multiplier + joints[i].offset;
    angle[i] = position[i] * joints[i].half_turn;
  }
  onebot_sines(angle, sine, cosine, (int64_t)count);
  for (size_t i = 0; i < count; i++)
    onebot_joint_transform(joints[i].constant, joints[i].sine, joints[i].slide, position[i],
                           sine[i], cosine[i], out + ONEBOT_POSE * i);
}

static inline size_t some_of(size_t count) { return (size_t)onebot_some_of((int64_t)count); }

/* Whether none of the doubles from byte `at` on, which need not be aligned, is NaN or larger in
 * magnitude than MODERATE, of which kernel.py has the same number. */
EXPORT int onebot_all_moderate(const unsigned char *data, size_t at, size_t count) {
  for (size_t i = 0; i < count; i++)
    if (!(fabs(onebot_load(data + at, (int64_t)i)) <= MODERATE)) return 0;
  return 1;
}

/* Make `message` of `blank`, of `size` bytes, which is the same but for stamps and numbers, and of
 * the JointState `data`, whose positions begin at byte `at`. The joints stand in the order of their
 * places. */
EXPORT ONEBOT_WIDE void onebot_fill_message(unsigned char *message, const unsigned char *blank,
                                            size_t size, const struct joint *joints, size_t count,
                                            const unsigned char *data, size_t at) {
  size_t copied = 0;
  for (size_t first = 0; first < count; first += ONEBOT_SOME) {
    const struct joint *some = joints + first;
    const size_t number = some_of(count - first);
    double values[ONEBOT_SOME * ONEBOT_POSE];
    transforms(some, number, data + at, values);
    const size_t end = some[number - 1].values_at + ONEBOT_POSE * sizeof *values;
    memcpy(message + copied, blank + copied, end - copied);
    copied = end;
    for (size_t i = 0; i < number; i++) {
      memcpy(message + some[i].stamp_at, data + ONEBOT_STAMP_AT, 8);
      memcpy(message + some[i].values_at, values + ONEBOT_POSE * i, ONEBOT_POSE * sizeof *values);
    }
  }
  memcpy(message + copied, blank + copied, size - copied);
}

/* The same numbers into an array of `count` rows of seven doubles. */
EXPORT ONEBOT_WIDE void onebot_joint_transforms(double *values, const struct joint *joints,
                                                size_t count, const unsigned char *positions) {
  for (size_t first = 0; first < count; first += ONEBOT_SOME)
    transforms(joints + first, some_of(count - first), positions, values + ONEBOT_POSE * first);
}
