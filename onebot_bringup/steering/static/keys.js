/** The keyboard: arrows or W A S D drive while they are down, and Shift halves the speed. */

// Linear and angular share of each key, by where it lies: W A S D is one block on any layout.
const KEYS = {
  ArrowUp: [1, 0], KeyW: [1, 0],
  ArrowDown: [-1, 0], KeyS: [-1, 0],
  ArrowLeft: [0, 1], KeyA: [0, 1],
  ArrowRight: [0, -1], KeyD: [0, -1],
}; // prettier-ignore

// How long a key counts as down without another word of the keyboard. It may have been let go where
// no keyup reaches the page. Only the key that was pressed last repeats; when it is let go, none does.
export const PRESSED_MS = 2000; // until it repeats, which the system may not want it to
export const REPEATED_MS = 600; // until it repeats again

export class Keys {
  /** @param {import("./command_sender.js").CommandSender} sender */
  constructor(sender) {
    this.sender = sender;
    this.label = "keyboard";
    this.down = new Set();
    // Before any control of the page makes something else of them.
    window.addEventListener("keydown", (event) => this.press(event), { capture: true });
    window.addEventListener("keyup", (event) => this.lift(event), { capture: true });
  }

  /** Forget what is down; a key that still is repeats, and a repeat does not count. */
  cancel() {
    this.down.clear();
    this.sender.release(this);
  }

  press(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    if (isText(event.target) || movesSlider(event)) return;
    this.slow = event.shiftKey;
    if (KEYS[event.code]) event.preventDefault(); // it would scroll, or move a slider
    if (KEYS[event.code] && !event.repeat) this.down.add(event.code);
    this.drive();
    this.sender.seen(this, event.repeat ? REPEATED_MS : PRESSED_MS);
  }

  lift(event) {
    this.slow = event.shiftKey;
    this.down.delete(event.code);
    this.drive();
    this.sender.seen(this);
  }

  drive() {
    if (this.down.size === 0) {
      this.sender.release(this);
      return;
    }
    let [linear, angular] = [0, 0];
    for (const code of this.down) {
      linear += KEYS[code][0];
      angular += KEYS[code][1];
    }
    const share = (value) => Math.sign(value) * (this.slow ? 0.5 : 1);
    if (!this.sender.take(this, share(linear), share(angular))) this.cancel();
  }
}

/** Whether an element needs these keys itself. */
function isText(element) {
  return (
    element instanceof HTMLSelectElement ||
    (element instanceof HTMLInputElement && element.type !== "range")
  );
}

/** Whether the slider of a joint or a parameter has the focus, whose keys the arrows are then. */
function movesSlider({ target, code }) {
  return code.startsWith("Arrow") && target.closest?.(".sheet input");
}
