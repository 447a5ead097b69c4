/**
 * The joints that controllers move with trajectories, a slider for each: it commands a velocity while
 * a pointer or the arrow keys hold it, and springs back to zero.
 */

import { make, write } from "./elements.js";
import { fixed } from "./readout.js";
import { handsOn, HeldRange } from "./sliders.js";

const SIGNS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 };

export class Joints {
  /**
   * @param {HTMLElement} sheet the sheet, with a place for rows.
   * @param {HTMLButtonElement} button opens the sheet; hidden while there are no joints.
   * @param {import("./command_sender.js").CommandSender} sender
   */
  constructor(sheet, button, sender) {
    this.sheet = sheet;
    this.button = button;
    this.sender = sender;
    this.label = "joints";
    this.rows = sheet.querySelector(".rows");
    this.sliders = [];
    this.shown = "";
  }

  get isOpen() {
    return !this.sheet.hidden;
  }

  open(yes) {
    if (!yes) this.cancel();
    this.sheet.hidden = !yes;
  }

  /** Let go, and wait for the next press. */
  cancel() {
    for (const slider of this.sliders) slider.spring();
    this.sender.release(this);
  }

  get hands() {
    return handsOn(this.sliders);
  }

  /** Show the server's joints, their positions, and the commanded velocities. */
  show({ joints, command }) {
    const kinds = JSON.stringify(joints.map((joint) => [joint.name, joint.unit, joint.max_speed]));
    if (kinds !== this.shown) this.list(joints);
    this.shown = kinds;
    this.button.hidden = joints.length === 0;
    for (const [index, { name, position }] of joints.entries()) {
      this.sliders[index].tell(position, command.joints[name] ?? 0);
    }
  }

  /** The connection is lost: the joints' positions are unknown. */
  forget() {
    for (const slider of this.sliders) slider.tell(null, 0);
  }

  list(joints) {
    this.cancel();
    this.sliders = joints.map((joint, index) => new JointSlider(joint, `joint-${index}`, this));
    this.rows.replaceChildren(...this.sliders.map((slider) => slider.row));
  }

  drive() {
    const held = this.sliders.filter((slider) => slider.held);
    const joints = Object.fromEntries(held.map(({ name, velocity }) => [name, velocity]));
    if (held.length === 0) this.sender.release(this);
    else if (!this.sender.take(this, { joints })) this.cancel();
  }
}

class JointSlider extends HeldRange {
  constructor({ name, unit, max_speed: maxSpeed }, id, joints) {
    const range = make("input", { type: "range", min: -1, max: 1, step: 0.01, value: 0, id });
    super(range, joints);
    this.name = name;
    this.unit = unit;
    this.maxSpeed = maxSpeed;
    this.position = make("b", { id: `${id}-position` });
    this.row = make("div", { className: "row" });
    const track = make("span", { className: "axis" });
    track.append(range);
    this.row.append(make("label", { textContent: name, htmlFor: id }), this.position, track);
    range.setAttribute("aria-describedby", this.position.id);
    range.addEventListener("keydown", (event) => this.press(event));
    // The arrow keys drive again.
    range.addEventListener("pointerup", () => range.blur());
  }

  /** The commanded velocity, in the joint's unit per second. */
  get velocity() {
    return this.value * this.maxSpeed;
  }

  /** Show the joint's position, null if unknown, and a commanded velocity. */
  tell(position, velocity) {
    write(this.position, `${position === null ? "–" : fixed(position, 3)} ${this.unit}`);
    this.show(velocity / this.maxSpeed);
    const words = `${fixed(this.velocity, 2)} ${this.unit}/s`;
    if (this.range.ariaValueText !== words) this.range.ariaValueText = words;
  }

  press(event) {
    const sign = SIGNS[event.code];
    if (!sign || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault(); // the browser would move the slider by a step
    if (!event.repeat) this.hold(this.keys, event, event.shiftKey ? sign / 2 : sign);
  }

  /** @param {number} share the share of the maximum velocity that a key commands. */
  begin(share) {
    this.range.value = String(share);
    this.input.drive();
  }
}
