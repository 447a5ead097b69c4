/** The joystick pad, for mouse and touch: nipplejs draws it and follows the pointer. */

import { PointerHold } from "./pointer_hold.js";
import { SETTLE_MS } from "./sliders.js";
import nipplejs from "./vendor/nipplejs/index.mjs";

const DEAD = 0.06; // dead zone of each axis, share of the radius: nearly straight does not turn
const TRAVEL = 0.68; // share of the zone that the thumb's middle can reach, within the rim

export class Pad {
  /**
   * @param {HTMLElement} zone the element that the pad fills.
   * @param {import("./command_sender.js").CommandSender} sender
   */
  constructor(zone, sender) {
    this.zone = zone;
    this.sender = sender;
    this.label = "joystick";
    this.settled = 0;
    // Filter before nipplejs: only a free pad, the first finger and the main button count.
    zone.addEventListener("pointerdown", (event) => this.press(event), { capture: true });
    this.hand = new PointerHold(() => this.cancel());
    this.hands = [this.hand];
    new ResizeObserver(() => this.draw()).observe(zone);
    this.draw();
  }

  /** Let go, and wait for the next press. */
  cancel() {
    if (this.held) this.manager.all.values().next().value.end(); // and so letGo()
  }

  /** Show the command of another input, or of another page, with the thumb. */
  show(linear, across) {
    if (this.held || performance.now() < this.settled) return;
    const far = Math.max(1, Math.hypot(linear, across)) / (this.size / 2);
    const thumb = this.zone.querySelector(".front");
    thumb.style.transform = `translate(${-across / far}px, ${-linear / far}px)`;
    this.zone.classList.toggle("led", linear !== 0 || across !== 0);
  }

  letGo() {
    this.settled = performance.now() + SETTLE_MS;
    this.held = false;
    this.hand.end();
    this.zone.classList.remove("held");
    this.sender.release(this);
  }

  draw() {
    const width = this.zone.clientWidth;
    const size = Math.round(TRAVEL * width);
    if (size === this.size || size === 0) return;
    this.cancel();
    this.manager?.destroy();
    this.size = size;
    this.zone.style.setProperty("--size", `${width}px`);
    this.manager = nipplejs.create({
      zone: this.zone,
      mode: "static",
      position: { left: "50%", top: "50%" },
      size,
      color: { front: "transparent", back: "transparent" }, // style.css draws them
      restOpacity: 1,
      fadeTime: 120,
    });
    this.manager.on("move", (event) => this.move(event.data.vector));
    this.manager.on("end", () => this.letGo());
  }

  press(event) {
    if (this.held || event.button !== 0 || !this.sender.ready) {
      event.stopImmediatePropagation();
      return;
    }
    this.held = true;
    this.zone.classList.add("held");
    this.zone.classList.remove("led");
    // Keep the pointer over the robot's view and beyond the window's edge.
    this.hand.begin(event);
    this.manager.reposition(); // the panel may have scrolled
  }

  move(vector) {
    const shares = { linear: beyond(vector.y), ...this.sender.across(-beyond(vector.x)) };
    if (this.held && !this.sender.take(this, shares)) this.cancel();
  }
}

/** Remove the dead zone and scale the rest to -1 ... 1, rounded to less than a pixel. */
function beyond(value) {
  const size = Math.round((1000 * Math.max(0, Math.abs(value) - DEAD)) / (1 - DEAD)) / 1000;
  return size === 0 ? 0 : Math.sign(value) * size;
}
