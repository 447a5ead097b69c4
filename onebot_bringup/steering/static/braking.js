/**
 * The distance that the robot needs to stop from the current speed limits: the longer of forward and
 * sideways.
 */

import { write } from "./elements.js";

/**
 * The distance from a speed to rest, m; 0 if nothing limits the braking.
 * @param {number} speed m/s, steady until then.
 * @param {{deceleration: number | null, jerk: number | null}} limits in m/s² and m/s³. The jerk
 *   limits how fast the deceleration grows; as in the controller, it ends at once.
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
  /** @param {HTMLElement} place has an output, and a note for an obstacle. */
  constructor(place) {
    this.place = place;
    this.output = place.querySelector("output");
    this.note = place.querySelector("small");
  }

  /** Show a state of the server. */
  show({ limits, braking, obstacle }) {
    const axes = Object.entries(braking).filter(([, by]) => by && (by.deceleration ?? by.jerk) !== null);
    const known = axes.length > 0;
    const distance = Math.max(...axes.map(([axis, by]) => brakingDistance(limits[axis], by)));
    const near = obstacle !== null && obstacle < distance;
    write(this.output, known ? `${distance.toFixed(2)} m` : "–");
    write(this.note, near ? `obstacle at ${obstacle.toFixed(2)} m` : "");
    this.place.classList.toggle("near", near);
  }

  /** Show that nothing is known. */
  forget() {
    this.show({ limits: {}, braking: {}, obstacle: null });
  }
}
