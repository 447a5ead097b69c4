/**
 * The hand on a control. A browser does not report every release: not while its own menu is open or
 * another program has the keys. So only the control that drives proves that a hand is there, by the
 * pointer or the keys that hold it, and each sign is good for a number of commands and no more.
 */

export const PERIOD_MS = 50; // of commands
const HAND_MS = 5000;
// Only the key that was pressed last repeats; when it is let go, none does.
const PRESSED_MS = 2000; // until it repeats, which the system may not want it to
const REPEATED_MS = 600; // until it repeats again
const SHIFT_REPEATS = navigator.platform.startsWith("Win"); // in place of the key that is held

export class Hand {
  /** There was a sign of it, which is good for so long. */
  seen(duration = HAND_MS) {
    this.commands = 0; // since then
    this.most = duration / PERIOD_MS;
  }

  /** Count a command; false where the next sign is overdue. */
  count() {
    // By the number of commands, not by the clock: a busy page also sees the hand late.
    this.commands += 1;
    return this.commands < this.most;
  }
}

/** The keys that hold a control. It watches all keys: their events tell where one was swallowed. */
export class KeyHold extends Hand {
  /** @param {() => void} changed called when keys do not hold any more. */
  constructor(changed) {
    super();
    this.changed = changed;
    this.codes = new Set(); // of the keys that hold
    this.pressed = new Set(); // the codes of all keys that are down, as far as events tell
    // Before the control sees them.
    window.addEventListener("keydown", (event) => this.press(event), true);
    window.addEventListener("keyup", (event) => this.lift(event), true);
    for (const type of ["focusin", "focusout"]) window.addEventListener(type, () => this.lose());
    window.addEventListener("blur", () => this.pressed.clear()); // what is released then is not seen
  }

  /** Hold by the key of this keydown, too. */
  begin({ code }) {
    this.codes.add(code);
    this.seen(PRESSED_MS);
  }

  end() {
    this.codes.clear();
  }

  /** An event was swallowed, or the hand is elsewhere. */
  lose() {
    if (this.codes.size === 0) return;
    this.end();
    this.changed();
  }

  press({ code, repeat, metaKey, target }) {
    if (repeat !== this.pressed.has(code) || code === "Escape" || isText(target)) this.lose();
    this.pressed.add(code);
    if (metaKey) this.pressed.clear(); // macOS reports no keyup of others while Cmd is down
    if (repeat && this.codes.has(code)) this.seen(REPEATED_MS);
    else if (code.startsWith("Shift") && (repeat || SHIFT_REPEATS)) {
      this.most = Math.max(this.most, PRESSED_MS / PERIOD_MS); // since the last sign
    }
  }

  lift({ code }) {
    if (!this.pressed.delete(code)) this.lose();
    else if (this.codes.delete(code)) {
      this.seen(); // of the others, which do not repeat any more
      this.changed();
    }
  }
}

/** Whether an element needs the keys itself. */
export function isText(element) {
  return (
    element instanceof HTMLSelectElement ||
    (element instanceof HTMLInputElement && element.type !== "range")
  );
}
