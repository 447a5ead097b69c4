/* Joints' transforms from their positions, some at once; robot_model.py has the formula. */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum {
  ONEBOT_POSE = 7,  /* numbers of a transform: translation x y z, rotation x y z w */
  ONEBOT_LANES = 8, /* angles at once; whatever the machine's registers hold, the same results */
  /* Joints at once. With as few as there are lanes, each step would wait for the one before: what
   * was just stored as numbers cannot be loaded as lanes yet. */
  ONEBOT_SOME = 32,
};

/* Once for any processor and once for each of those with wider registers; GCC chooses as the library
 * is loaded. All do the same arithmetic (nothing is fused): the same results, bit by bit. */
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__)
#define ONEBOT_WIDE __attribute__((target_clones("default", "avx2", "avx512f")))
#else
#define ONEBOT_WIDE
#endif

typedef double onebot_numbers __attribute__((vector_size(8 * ONEBOT_LANES)));
typedef int64_t onebot_bits __attribute__((vector_size(8 * ONEBOT_LANES)));
typedef double onebot_quaternion __attribute__((vector_size(8 * 4)));

/* Sines and cosines of ONEBOT_LANES angles, to one unit in the last place of 1.
 *
 * The angle less the next multiple k of pi/2 (Cody and Waite: pi/2 in two parts, the first of 33
 * bits, so that its product with k is exact) goes into Taylor's series.
 */
static inline void onebot_sines_of_lanes(const double *angles, double *sines, double *cosines) {
  const double round = 0x1.8p52; /* adding it leaves no bits behind the point */
  onebot_numbers angle;
  memcpy(&angle, angles, sizeof angle);
  const onebot_numbers shifted = angle * 0x1.45f306dc9c883p-1 + round; /* 2/pi */
  const onebot_numbers k = shifted - round;
  const onebot_numbers first = angle - k * 0x1.921fb544p0, second = k * 0x1.0b4611a626331p-34;
  const onebot_numbers x = first - second, rest = (first - x) - second, z = x * x;
  /* x - x^3/3! + ... x^17/17!, and 1 - x^2/2! + ... x^16/16!, and what x + rest adds to them */
  onebot_numbers odd = z * (1.0 / 355687428096000.0) - 1.0 / 1307674368000.0;
  odd = ((odd * z + 1.0 / 6227020800.0) * z - 1.0 / 39916800.0) * z + 1.0 / 362880.0;
  odd = ((odd * z - 1.0 / 5040.0) * z + 1.0 / 120.0) * z - 1.0 / 6.0;
  onebot_numbers even = z * (1.0 / 20922789888000.0) - 1.0 / 87178291200.0;
  even = ((even * z + 1.0 / 479001600.0) * z - 1.0 / 3628800.0) * z + 1.0 / 40320.0;
  even = (even * z - 1.0 / 720.0) * z + 1.0 / 24.0;
  const onebot_numbers half = 0.5 * z, most_of = 1.0 - half;
  const onebot_bits s = (onebot_bits)(x + (rest + x * z * odd));
  const onebot_numbers lost = (1.0 - most_of) - half;
  const onebot_bits c = (onebot_bits)(most_of + (lost + (z * z * even - x * rest)));
  /* By the quarter turns: which of the two, and its sign. */
  const onebot_bits turns = (onebot_bits)shifted, swap = -(turns & 1);
  const onebot_bits sine = ((s & ~swap) | (c & swap)) ^ ((turns & 2) << 62);
  const onebot_bits cosine = ((c & ~swap) | (s & swap)) ^ (((turns + 1) & 2) << 62);
  memcpy(sines, &sine, sizeof sine);
  memcpy(cosines, &cosine, sizeof cosine);
}

/* The same of up to ONEBOT_SOME angles; the arrays have room for so many, and hold numbers. An angle
 * that is not finite, or beyond what k counts exactly, is left to the C library. */
static inline void onebot_sines(const double *angles, double *sines, double *cosines,
                                int64_t count) {
  for (int64_t i = 0; i < count; i += ONEBOT_LANES)
    onebot_sines_of_lanes(angles + i, sines + i, cosines + i);
  const double most = 0x1p17;
  int64_t far = 0; /* counted, not branched on: in lanes, too */
  for (int64_t i = 0; i < count; i++) far += !(fabs(angles[i]) <= most);
  for (int64_t i = 0; far > 0 && i < count; i++) {
    if (fabs(angles[i]) <= most) continue;
    sines[i] = sin(angles[i]);
    cosines[i] = cos(angles[i]);
  }
}

static inline int64_t onebot_some_of(int64_t count) {
  return count < ONEBOT_SOME ? count : ONEBOT_SOME;
}

/* Positions may be a view into a message, where they need not be aligned. */
static inline double onebot_load(const unsigned char *numbers, int64_t index) {
  double number;
  memcpy(&number, numbers + index * (int64_t)sizeof number, sizeof number);
  return number;
}

/* constant: ONEBOT_POSE numbers, sine: 4, slide: 3. s, c: sine and cosine
 * of the position times the joint's half turn. pose: may be in a message, unaligned. */
static inline void onebot_joint_transform(const double *constant, const double *sine,
                                          const double *slide, double position, double s, double c,
                                          void *pose) {
  double slid[3];
  for (int i = 0; i < 3; i++) slid[i] = constant[i] + slide[i] * position;
  onebot_quaternion at_zero, factor;
  memcpy(&at_zero, constant + 3, sizeof at_zero);
  memcpy(&factor, sine, sizeof factor);
  const onebot_quaternion turned = at_zero * c + factor * s;
  memcpy(pose, slid, sizeof slid);
  memcpy((unsigned char *)pose + sizeof slid, &turned, sizeof turned);
}
