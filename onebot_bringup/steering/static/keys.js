/**
 * The keyboard: arrows or W A S D drive while they are down, Q and E drive sideways if the drive
 * can, and Shift halves the speed.
 */

import { isText, KeyHold } from "./hand.js";

// The axis and direction of each key, by its place: W A S D is one block on any layout.
const KEYS = {
  ArrowUp: ["linear", 1], KeyW: ["linear", 1],
  ArrowDown: ["linear", -1], KeyS: ["linear", -1],
  ArrowLeft: ["angular", 1], KeyA: ["angular", 1],
  ArrowRight: ["angular", -1], KeyD: ["angular", -1],
  KeyQ: ["lateral", 1], KeyE: ["lateral", -1],
}; // prettier-ignore

export class Keys {
  /** @param {import("./command_sender.js").CommandSender} sender */
  constructor(sender) {
    this.sender = sender;
    this.label = "keyboard";
    this.hold = new KeyHold(() => this.drive());
    this.hands = [this.hold];
    // Capture the keys before any control of the page uses them.
    window.addEventListener("keydown", (event) => this.press(event), { capture: true });
    window.addEventListener("keyup", (event) => this.lift(event), { capture: true });
  }

  /** Forget the keys that are down; a key that is still held repeats, which does not count. */
  cancel() {
    this.hold.end();
    this.sender.release(this);
  }

  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (isText(event.target) || movesSlider(event)) return;
    this.slow = event.shiftKey;
    if (this.drives(event)) {
      event.preventDefault(); // it would scroll, or move a slider
      if (!event.repeat) this.hold.begin(event);
    }
    this.drive();
  }

  /** Whether a key drives this robot. */
  drives({ code }) {
    return code in KEYS && (KEYS[code][0] !== "lateral" || this.sender.strafes);
  }

  lift(event) {
    this.slow = event.shiftKey;
    this.drive();
  }

  drive() {
    if (this.hold.codes.size === 0) {
      this.sender.release(this);
      return;
    }
    const sums = { linear: 0, angular: 0, lateral: 0 };
    for (const code of this.hold.codes) {
      const [axis, sign] = KEYS[code];
      sums[axis] += sign;
    }
    const share = ([axis, sum]) => {
      const slows = this.slow && !(axis === "angular" && this.sender.radius); // the same curve
      return [axis, Math.sign(sum) * (slows ? 0.5 : 1)];
    };
    const shares = Object.fromEntries(Object.entries(sums).map(share));
    if (!this.sender.take(this, shares)) this.cancel();
  }
}

/** Whether the slider of a joint or a parameter has the focus, and so takes the arrow keys. */
function movesSlider({ target, code }) {
  return code.startsWith("Arrow") && target.closest?.(".sheet input");
}
