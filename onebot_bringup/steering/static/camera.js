/** The picture of the robot's camera: the newest one only, and none while nobody looks. */

import { toolAddress } from "./requests.js";

export class Camera {
  /** @param {HTMLDetailsElement} pane shown where there is a camera; it is asked while open. */
  constructor(pane) {
    this.pane = pane;
    this.busy = false;
    this.number = 0;
  }

  /** Show a state of the server: no more than a picture for each. */
  async show({ camera }) {
    this.pane.hidden = !camera;
    if (!camera || !this.pane.open || document.hidden || this.busy) return;
    this.busy = true;
    const picture = new Image();
    picture.alt = camera;
    picture.src = toolAddress("camera.jpg", { number: this.number++ });
    await picture.decode().then(
      () => this.pane.querySelector("img").replaceWith(picture),
      () => {}, // no picture yet
    );
    this.busy = false;
  }
}
