/* One joint's transform from its position; robot_model.py has the formula. */
#include <math.h>

enum { ONEBOT_POSE = 7 }; /* numbers of a transform: translation x y z, rotation x y z w */

/* constant: ONEBOT_POSE numbers, sine: 4, slide: 3, or NULL where nothing slides. */
static inline void onebot_joint_transform(double half_turn, const double *constant,
                                          const double *sine, const double *slide, double position,
                                          double *pose) {
  const double half = position * half_turn, s = sin(half), c = cos(half);
  for (int i = 0; i < 3; i++) pose[i] = constant[i] + (slide ? slide[i] * position : 0.0);
  for (int i = 0; i < 4; i++) pose[3 + i] = constant[3 + i] * c + sine[i] * s;
}
