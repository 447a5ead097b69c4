/* The transforms of a robot's joints, written straight into a serialized TFMessage.
 *
 * The same arithmetic as JointArrays.transforms in model/robot_model.py, in one pass and without the
 * dozen calls of numpy, which cost more than the arithmetic itself below some hundred joints.
 */
#include "_joint_transforms.h"

#include <math.h>
#include <string.h>

#define EXPORT __attribute__((visibility("default")))
#define MODERATE 1e100

static void transform(const struct joint *joint, const unsigned char *positions, double *out) {
  double position;
  memcpy(&position, positions + joint->column * sizeof position, sizeof position);
  position = position * joint->multiplier + joint->offset;
  onebot_joint_transform(joint->half_turn, joint->constant, joint->sine, joint->slide, position, out);
}

/* Whether none of the doubles from byte `at` on, which need not be aligned, is NaN or larger in
 * magnitude than MODERATE, of which kernel.py has the same number. */
EXPORT int onebot_all_moderate(const unsigned char *data, size_t at, size_t count) {
  for (size_t i = 0; i < count; i++) {
    double position;
    memcpy(&position, data + at + i * sizeof position, sizeof position);
    if (!(fabs(position) <= MODERATE)) return 0;
  }
  return 1;
}

/* Fill `message` from the JointState `data`, whose positions begin at byte `at`. */
EXPORT void onebot_fill_message(unsigned char *message, const struct joint *joints, size_t count,
                                const unsigned char *data, size_t at) {
  for (const struct joint *joint = joints; joint < joints + count; joint++) {
    double values[ONEBOT_POSE];
    transform(joint, data + at, values);
    memcpy(message + joint->stamp_at, data + ONEBOT_STAMP_AT, 8);
    memcpy(message + joint->values_at, values, sizeof values);
  }
}

/* The same numbers into an array of `count` rows of seven doubles. */
EXPORT void onebot_joint_transforms(double *values, const struct joint *joints, size_t count,
                                    const unsigned char *positions) {
  for (size_t i = 0; i < count; i++) transform(joints + i, positions, values + ONEBOT_POSE * i);
}
