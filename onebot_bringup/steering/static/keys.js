/** The keyboard: arrows or W A S D drive while they are down, and Shift halves the speed. */

import { isText, KeyHold } from "./hand.js";

// Linear and angular share of each key, by where it lies: W A S D is one block on any layout.
const KEYS = {
  ArrowUp: [1, 0], KeyW: [1, 0],
  ArrowDown: [-1, 0], KeyS: [-1, 0],
  ArrowLeft: [0, 1], KeyA: [0, 1],
  ArrowRight: [0, -1], KeyD: [0, -1],
}; // prettier-ignore

export class Keys {
  /** @param {import("./command_sender.js").CommandSender} sender */
  constructor(sender) {
    this.sender = sender;
    this.label = "keyboard";
    this.hold = new KeyHold(() => this.drive());
    this.hands = [this.hold];
    // Before any control of the page makes something else of them.
    window.addEventListener("keydown", (event) => this.press(event), { capture: true });
    window.addEventListener("keyup", (event) => this.lift(event), { capture: true });
  }

  /** Forget what is down; a key that still is repeats, and a repeat does not count. */
  cancel() {
    this.hold.end();
    this.sender.release(this);
  }

  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (isText(event.target) || movesSlider(event)) return;
    this.slow = event.shiftKey;
    if (KEYS[event.code]) event.preventDefault(); // it would scroll, or move a slider
    if (KEYS[event.code] && !event.repeat) this.hold.begin(event);
    this.drive();
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
    let [linear, angular] = [0, 0];
    for (const code of this.hold.codes) {
      linear += KEYS[code][0];
      angular += KEYS[code][1];
    }
    const share = (value) => Math.sign(value) * (this.slow ? 0.5 : 1);
    if (!this.sender.take(this, share(linear), share(angular))) this.cancel();
  }
}

/** Whether the slider of a joint or a parameter has the focus, whose keys the arrows are then. */
function movesSlider({ target, code }) {
  return code.startsWith("Arrow") && target.closest?.(".sheet input");
}
