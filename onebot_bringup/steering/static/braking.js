/** The distance that the robot needs to stop, from full speed with the limits in force. */

import { write } from "./settings.js";

/**
 * The way from a speed to rest, in m; 0 if nothing limits the braking.
 * @param {number} speed m/s, at a steady speed until then.
 * @param {{deceleration: number | null, jerk: number | null}} limits in m/s² and m/s³. The jerk
 *   limits how fast the deceleration grows; it ends at once, as the controller ends it.
 */
export function brakingDistance(speed, limits) {
  const deceleration = limits.deceleration ?? Infinity;
  const jerk = limits.jerk ?? Infinity;
  const growth = deceleration / jerk; // s until the deceleration is reached
  if (speed > (deceleration * growth) / 2) {
    return (
      speed ** 2 / (2 * deceleration) + (speed * growth) / 2 - (deceleration * growth ** 2) / 24
    );
  }
  return ((2 * speed) / 3) * Math.sqrt((2 * speed) / jerk);
}

export class Braking {
  /** @param {HTMLOutputElement} output */
  constructor(output) {
    this.output = output;
  }

  /** Show a state of the server. */
  show({ limits, braking }) {
    const known = braking && (braking.deceleration ?? braking.jerk) !== null;
    write(this.output, known ? `${brakingDistance(limits.linear, braking).toFixed(2)} m` : "–");
  }

  /** What was shown is no longer known. */
  forget() {
    write(this.output, "–");
  }
}
