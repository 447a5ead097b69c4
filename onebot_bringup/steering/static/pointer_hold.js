/**
 * The pointer that holds a control: a mouse's main button, a finger or a pen. Not every release is
 * reported: a browser's menu takes the pointer away, and later events have no button down.
 */

import { Hand } from "./hand.js";

export class PointerHold extends Hand {
  /** @param {() => void} lost called when the pointer no longer holds the control. */
  constructor(lost) {
    super();
    this.lost = lost;
    this.pointer = null;
    for (const type of ["pointermove", "pointerover", "pointerup", "pointercancel"]) {
      window.addEventListener(type, (event) => this.look(event, event.buttons & 1), true);
    }
    for (const type of ["lostpointercapture", "pointerdown"]) {
      // If it is pressed again, its release was missed.
      window.addEventListener(type, (event) => this.look(event, false), true);
    }
  }

  /** Hold with the pointer of this pointerdown, and capture its events until the release. */
  begin(event) {
    this.pointer = event.pointerId;
    event.currentTarget.setPointerCapture(event.pointerId);
    this.seen();
  }

  end() {
    this.pointer = null;
  }

  look(event, held) {
    if (event.pointerId !== this.pointer) return;
    if (held) {
      this.seen();
    } else {
      this.end();
      this.lost();
    }
  }
}
