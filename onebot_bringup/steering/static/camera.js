/** The picture of a camera of the robot: only the newest, and none while the pane is closed. */

import { fill } from "./elements.js";
import { toolAddress } from "./requests.js";

export class Camera {
  /** @param {HTMLDetailsElement} pane shown if there are cameras; requests pictures while open. */
  constructor(pane) {
    this.pane = pane;
    this.select = pane.querySelector("select");
    this.select.addEventListener("change", () => this.select.blur()); // the keys drive again
    this.busy = false;
    this.number = 0;
  }

  /** Show a state of the server; at most one picture is requested for each state. */
  async show({ cameras }) {
    this.offer(cameras);
    const topic = this.select.value;
    if (!topic || !this.pane.open || document.hidden || this.busy) return;
    this.busy = true;
    const picture = new Image();
    picture.alt = topic;
    picture.src = toolAddress("camera.jpg", { topic, number: this.number++ });
    await picture.decode().then(
      () => this.pane.querySelector("img").replaceWith(picture),
      () => this.forget(), // no picture yet, or none any more
    );
    this.busy = false;
  }

  /** Show no picture, rather than an old one. */
  forget() {
    this.pane.querySelector("img").replaceWith(new Image());
  }

  /** Offer these topics; the current one stays. */
  offer(cameras) {
    this.pane.hidden = cameras.length === 0;
    this.select.hidden = cameras.length < 2;
    const shown = this.select.value;
    if (!fill(this.select, cameras, (topic) => new Option(topic))) return;
    this.select.value = cameras.includes(shown) ? shown : (cameras[0] ?? "");
  }
}
