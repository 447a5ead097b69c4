/**
 * The stop: its button, the space bar, and a gamepad's button. It acts on press. While anything
 * presses it, no input of this page drives and a drive of another page ends at once; after that,
 * what is still held has to be released and pressed again.
 */

const PERIOD_MS = 100; // of stop messages while it is pressed
const KEYS = ["Space", "Enter", "NumpadEnter"];

export class Stop {
  /**
   * @param {HTMLButtonElement} button
   * @param {import("./command_sender.js").CommandSender} sender
   * @param {() => void} cancelInputs called on press: an input may be held and not drive yet.
   */
  constructor(button, sender, cancelInputs) {
    this.button = button;
    this.sender = sender;
    this.cancelInputs = cancelInputs;
    this.pressers = new Set(); // the ids of pointers, the codes of keys, names of others
    // Any pointer: a second finger and a mouse that is not yet released make no click.
    button.addEventListener("pointerdown", (event) => this.point(event));
    button.addEventListener("lostpointercapture", (event) => this.release(event.pointerId));
    // Assistive technology makes a click and nothing else.
    button.addEventListener("click", () => sender.stop());
    window.addEventListener("pointerdown", (event) => this.release(event.pointerId), {
      capture: true, // its release was missed, if it presses anew
    });
    window.addEventListener("keydown", (event) => this.pressKey(event), { capture: true });
    window.addEventListener("keyup", (event) => this.liftKey(event), { capture: true });
    window.addEventListener("blur", () => this.releaseKeys()); // no keyup would be received
  }

  /** Stop the robot now, and until `release` of the same presser. */
  press(presser) {
    if (this.pressers.has(presser)) return; // a key that repeats
    this.pressers.add(presser);
    this.changed();
    this.sender.stop();
    this.cancelInputs();
  }

  /** One presser less; does nothing if it did not press. */
  release(presser) {
    if (this.pressers.delete(presser)) this.changed();
  }

  changed() {
    const pressed = this.pressers.size > 0;
    this.sender.stopped = pressed;
    this.button.classList.toggle("held", pressed);
    clearInterval(this.timer);
    if (pressed) this.timer = setInterval(() => this.sender.keepStopped(), PERIOD_MS);
  }

  point(event) {
    // Else a mouse that is released over the view, a page of its own, would press for ever.
    this.button.setPointerCapture(event.pointerId);
    this.press(event.pointerId);
  }

  pressKey(event) {
    if (event.metaKey) this.releaseKeys(); // macOS reports no keyup while Cmd is down
    if (event.metaKey || !this.stops(event)) return;
    event.preventDefault(); // it would also press the button that has the focus
    event.stopPropagation();
    this.press(event.code);
  }

  liftKey(event) {
    if (this.stops(event)) event.preventDefault();
    this.release(event.code);
  }

  releaseKeys() {
    for (const code of KEYS) this.release(code);
  }

  stops(event) {
    return event.code === "Space" || (event.key === "Enter" && event.target === this.button);
  }
}
