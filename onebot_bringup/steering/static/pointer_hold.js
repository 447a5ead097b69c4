/**
 * The pointer that holds a control: a mouse's main button, a finger or a pen. Not every release is
 * reported as one: a browser's menu takes the pointer away, and what comes later has no button down.
 */

export class PointerHold {
  /**
   * @param {(held: boolean) => void} seen called with every event of the pointer: whether it still
   *   holds. When it does not, it is forgotten before.
   */
  constructor(seen) {
    this.seen = seen;
    this.pointer = null;
    for (const type of ["pointermove", "pointerover", "pointerup", "pointercancel"]) {
      window.addEventListener(type, (event) => this.look(event, event.buttons & 1), true);
    }
    for (const type of ["lostpointercapture", "pointerdown"]) {
      // Pressed anew, its release was missed.
      window.addEventListener(type, (event) => this.look(event, false), true);
    }
  }

  /** Hold by the pointer of this pointerdown: all that it does is the control's until it ends. */
  begin(event) {
    this.pointer = event.pointerId;
    event.currentTarget.setPointerCapture(event.pointerId);
  }

  end() {
    this.pointer = null;
  }

  look(event, held) {
    if (event.pointerId !== this.pointer) return;
    if (!held) this.end();
    this.seen(Boolean(held));
  }
}
