/**
 * The two sliders of rqt_robot_steering, linear and angular, with - 0 + and editable limits; the
 * second one also drives sideways, or steers. They drive while they are held, both at once with two
 * fingers, and spring back to zero.
 */

import { KeyHold } from "./hand.js";
import { PointerHold } from "./pointer_hold.js";

const STEP = 0.1; // share of the limit
const STEP_MS = 150;
export const SETTLE_MS = 250; // after letting go, for which older states of the server are ignored

export class Sliders {
  /**
   * @param {{linear: HTMLElement, across: HTMLElement}} groups the vertical and the horizontal one,
   *   each with an input[type=range] from -1 to 1 and buttons named minus, zero and plus.
   * @param {import("./command_sender.js").CommandSender} sender
   */
  constructor(groups, sender) {
    this.sender = sender;
    this.label = "sliders";
    const { linear, across } = groups;
    this.axes = [linear, across].map((group) => new Axis(group, this));
  }

  /** Let go, and wait for the next press. */
  cancel() {
    for (const axis of this.axes) axis.spring();
    this.sender.release(this);
  }

  get hands() {
    return handsOn(this.axes);
  }

  /** Show the command of another input, or of another page. */
  show(linear, across) {
    this.axes[0].show(linear);
    this.axes[1].show(across);
  }

  drive() {
    const [linear, across] = this.axes;
    const shares = { linear: linear.value, ...this.sender.across(across.value) };
    if (!linear.held && !across.held) this.sender.release(this);
    else if (!this.sender.take(this, shares)) this.cancel();
  }
}

/** The hands that hold any of these ranges. */
export function handsOn(ranges) {
  return ranges.filter((range) => range.held).map((range) => range.hand);
}

/** A range from -1 to 1 that counts while it is held, and springs back to zero. */
export class HeldRange {
  /**
   * @param {HTMLInputElement} range
   * @param {object} input the input that it belongs to: has `sender`, and `drive`, called at changes.
   */
  constructor(range, input) {
    this.range = range;
    this.input = input;
    this.pointer = new PointerHold(() => this.letGo());
    this.keys = new KeyHold(() => this.letGo());
    this.hand = null; // the pointer or the keys, whichever holds it
    this.settled = 0;
    range.addEventListener("pointerdown", (event) => this.point(event));
    range.addEventListener("input", () => this.slide());
  }

  get held() {
    return this.hand !== null;
  }

  get value() {
    return Number(this.range.value);
  }

  /** Return to zero, no longer held. */
  spring() {
    this.range.value = "0";
    this.pointer.end();
    this.keys.end();
    if (this.held) this.settled = performance.now() + SETTLE_MS;
    this.hand = null;
  }

  show(value) {
    if (this.held || performance.now() < this.settled) return;
    this.range.value = String(value);
  }

  letGo() {
    const held = this.held;
    this.spring();
    if (held) this.input.drive();
  }

  /** @param {number} [share] argument of `begin`; undefined for the slider itself. */
  point(event, share) {
    if (event.button === 0) this.hold(this.pointer, event, share);
  }

  hold(hand, event, share) {
    if (this.held || !this.input.sender.ready) return;
    this.hand = hand;
    hand.begin(event);
    if (share !== undefined) this.begin(share); // otherwise an "input" event follows
  }

  slide() {
    if (this.held) this.input.drive();
    else this.range.value = "0"; // not held: no release would follow
  }
}

class Axis extends HeldRange {
  constructor(group, sliders) {
    super(group.querySelector("input[type=range]"), sliders);
    for (const [name, sign] of Object.entries({ minus: -1, zero: 0, plus: 1 })) {
      const button = group.querySelector(`button[name=${name}]`);
      button.addEventListener("pointerdown", (event) => this.point(event, sign));
      button.addEventListener("keydown", (event) => this.key(event, sign));
    }
  }

  spring() {
    clearInterval(this.timer);
    super.spring();
  }

  key(event, sign) {
    if (event.code !== "Enter" || event.repeat) return;
    event.preventDefault();
    this.hold(this.keys, event, sign);
  }

  /** @param {number} sign the sign of a button's steps. */
  begin(sign) {
    this.range.value = "0";
    this.step(sign);
    if (sign !== 0) this.timer = setInterval(() => this.step(sign), STEP_MS);
  }

  step(sign) {
    this.range.value = String(sign === 0 ? 0 : this.value + sign * STEP);
    this.input.drive();
  }
}
