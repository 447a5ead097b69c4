/**
 * The hand on a control. A browser does not report every release, for example while its own menu is
 * open or another program has the keys. Therefore the pointer or the keys that hold a control have to
 * prove that the hand is there, and each sign is valid for a limited number of commands.
 */

export const PERIOD_MS = 50; // period of commands
const HAND_MS = 5000; // for which a sign of a pointer is valid
// Only the key that was pressed last repeats; when it is released, none does.
const PRESSED_MS = 2000; // until the first repeat, which the system may suppress
const REPEATED_MS = 600; // until the next repeat
const SHIFT_REPEATS = navigator.platform.startsWith("Win"); // instead of the held key

export class Hand {
  /** Note a sign of the hand, which is valid for a duration, ms. */
  seen(duration = HAND_MS) {
    this.commands = 0; // number since then
    this.limit = duration / PERIOD_MS;
  }

  /** Count a command; return false if the next sign is overdue. */
  count() {
    // Count commands instead of time: a busy page also sees the hand late.
    this.commands += 1;
    return this.commands < this.limit;
  }
}

/** The keys that hold a control. All keys are watched, to notice a swallowed event. */
export class KeyHold extends Hand {
  /** @param {() => void} changed called when keys no longer hold the control. */
  constructor(changed) {
    super();
    this.changed = changed;
    this.codes = new Set(); // codes of the keys that hold
    this.pressed = new Set(); // codes of all keys that are down, according to the events
    // Capture the events before the control sees them.
    window.addEventListener("keydown", (event) => this.press(event), true);
    window.addEventListener("keyup", (event) => this.lift(event), true);
    for (const type of ["focusin", "focusout"]) window.addEventListener(type, () => this.lose());
    window.addEventListener("blur", () => this.pressed.clear()); // later releases are not seen
  }

  /** Also hold with the key of this keydown. */
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
    if (metaKey) this.pressed.clear(); // macOS reports no keyup of other keys while Cmd is down
    if (repeat && this.codes.has(code)) this.seen(REPEATED_MS);
    else if (code.startsWith("Shift") && (repeat || SHIFT_REPEATS)) {
      this.limit = Math.max(this.limit, PRESSED_MS / PERIOD_MS); // since the last sign
    }
  }

  lift({ code }) {
    if (!this.pressed.delete(code)) this.lose();
    else if (this.codes.delete(code)) {
      this.seen(); // the other keys no longer repeat
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
