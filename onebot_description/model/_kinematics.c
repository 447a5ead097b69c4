/* Transforms of joints and poses of links for many sets of positions; robot_model.py has the
 * formula. Plain functions on arrays that know nothing of Python or ROS.
 */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "_joint.h"

#define EXPORT __attribute__((visibility("default")))
enum { POSE = ONEBOT_POSE };

/* Some joints, as JointArrays in robot_model.py has them. */
struct joints {
  int64_t count;
  const double *half_turns; /* 1 each */
  const double *constant;   /* POSE each */
  const double *sine;       /* 4 each */
  const double *slide;      /* 3 each */
};

/* Some joints of one state. */
struct some {
  double position[ONEBOT_SOME], sine[ONEBOT_SOME], cosine[ONEBOT_SOME];
};

/* Read up to ONEBOT_SOME rows; a negative one is of a fixed joint. */
static inline void read_some(struct some *some, const struct joints *joints, const int32_t *rows,
                             int64_t count, const unsigned char *positions) {
  double angle[ONEBOT_SOME] = {0.0};
  for (int64_t i = 0; i < count; i++) {
    if (rows[i] < 0) continue;
    some->position[i] = onebot_load(positions, rows[i]);
    angle[i] = some->position[i] * joints->half_turns[rows[i]];
  }
  onebot_sines(angle, some->sine, some->cosine, count);
}

static inline void joint_transform(const struct joints *joints, int64_t row,
                                   const struct some *some, int64_t i, double *pose) {
  onebot_joint_transform(joints->constant + POSE * row, joints->sine + 4 * row,
                         joints->slide + 3 * row, some->position[i], some->sine[i],
                         some->cosine[i], pose);
}

/* Parent-to-child transforms: positions (states, joints) to poses (states, joints, 7). */
EXPORT ONEBOT_WIDE void onebot_transforms(const struct joints *joints, int64_t states,
                                          const unsigned char *positions, double *poses) {
  for (int64_t state = 0; state < states; state++) {
    for (int64_t row = 0; row < joints->count; row += ONEBOT_SOME) {
      const int64_t count = onebot_some_of(joints->count - row);
      int32_t rows[ONEBOT_SOME];
      struct some some;
      for (int64_t i = 0; i < count; i++) rows[i] = (int32_t)(row + i);
      read_some(&some, joints, rows, count, positions);
      for (int64_t i = 0; i < count; i++, poses += POSE)
        joint_transform(joints, row + i, &some, i, poses);
    }
    positions += joints->count * (int64_t)sizeof(double);
  }
}

/* How links hang together: steps in an order in which parents come before children. */
struct tree {
  int64_t links, steps, root;
  const int32_t *parent, *child; /* links, one a step */
  const int32_t *moving;         /* the row of the moving joint; -1 - row of a fixed one */
  const double *fixed;           /* (fixed joints, POSE) */
};

/* out = above * step */
static inline void compose(const double *above, const double *step, double *out) {
  double x = above[3], y = above[4], z = above[5], w = above[6];
  /* v + 2 w (u x v) + 2 u x (u x v) */
  double tx = 2.0 * (y * step[2] - z * step[1]), ty = 2.0 * (z * step[0] - x * step[2]),
         tz = 2.0 * (x * step[1] - y * step[0]);
  out[0] = above[0] + step[0] + w * tx + (y * tz - z * ty);
  out[1] = above[1] + step[1] + w * ty + (z * tx - x * tz);
  out[2] = above[2] + step[2] + w * tz + (x * ty - y * tx);
  double a = step[3], b = step[4], c = step[5], d = step[6];
  out[3] = w * a + x * d + y * c - z * b;
  out[4] = w * b - x * c + y * d + z * a;
  out[5] = w * c + x * b - y * a + z * d;
  out[6] = w * d - x * a - y * b - z * c;
}

/* Poses in the root's frame: positions (states, joints) to poses (states, links, 7). */
EXPORT ONEBOT_WIDE void onebot_link_poses(const struct joints *joints, const struct tree *tree,
                                          int64_t states, const unsigned char *positions,
                                          double *poses) {
  static const double identity[POSE] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0};
  for (int64_t state = 0; state < states; state++) {
    memcpy(poses + POSE * tree->root, identity, sizeof identity);
    for (int64_t first = 0; first < tree->steps; first += ONEBOT_SOME) {
      const int64_t count = onebot_some_of(tree->steps - first);
      struct some some;
      read_some(&some, joints, tree->moving + first, count, positions);
      for (int64_t i = 0; i < count; i++) {
        const int64_t number = first + i, row = tree->moving[number];
        double moved[POSE];
        if (row >= 0) joint_transform(joints, row, &some, i, moved);
        const double *step = row < 0 ? tree->fixed + POSE * (-1 - row) : moved;
        compose(poses + POSE * tree->parent[number], step, poses + POSE * tree->child[number]);
      }
    }
    positions += joints->count * (int64_t)sizeof(double);
    poses += POSE * tree->links;
  }
}
