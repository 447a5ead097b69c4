/**
 * The stop: its button, the space bar, and a gamepad's button. It acts on press. While it is pressed,
 * no input of this page drives, and a drive of another page ends at once; afterwards, a control that
 * is still held has to be released and pressed again.
 */

const PERIOD_MS = 100; // period of stop messages while it is pressed
const KEYS = ["Space", "Enter", "NumpadEnter"];

export class Stop {
  /**
   * @param {HTMLButtonElement} button
   * @param {import("./command_sender.js").CommandSender} sender
   * @param {() => void} cancelInputs called on press: an input may be held but not drive yet.
   */
  constructor(button, sender, cancelInputs) {
    this.button = button;
    this.sender = sender;
    this.cancelInputs = cancelInputs;
    this.pressers = new Set(); // ids of pointers, codes of keys, names of others
    // React to any pointer: a second finger, or a mouse not yet released, makes no click.
    button.addEventListener("pointerdown", (event) => this.point(event));
    button.addEventListener("lostpointercapture", (event) => this.release(event.pointerId));
    // Assistive technology only makes a click.
    button.addEventListener("click", () => sender.stop());
    window.addEventListener("pointerdown", (event) => this.release(event.pointerId), {
      capture: true, // if it presses again, its release was missed
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

  /** Remove a presser; does nothing if it did not press. */
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
    // Otherwise a mouse released over the view, a page of its own, would press forever.
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
