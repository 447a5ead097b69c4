/**
 * A gamepad (the Gamepad API): the left stick drives, the right one turns, too, and the second
 * button (B, circle) stops the robot. If the drive can go sideways, the left stick does that, and
 * only the right one turns, as with teleop_twist_joy.
 */

import { Hand, PERIOD_MS } from "./hand.js";

const DEAD = 0.15; // dead zone: sticks do not return to exactly zero
const STOP_BUTTON = 1;

export class Gamepads {
  /**
   * @param {import("./command_sender.js").CommandSender} sender
   * @param {import("./stop.js").Stop} stop
   */
  constructor(sender, stop) {
    this.sender = sender;
    this.stop = stop;
    this.label = "gamepad";
    this.hands = [new Hand()];
    this.driving = null; // index of the pad that drives
    this.values = ""; // its last values
    this.centered = new Set(); // indices of pads whose sticks were at rest since they last drove
    window.addEventListener("gamepadconnected", (event) => this.plug(event.gamepad));
    window.addEventListener("gamepaddisconnected", (event) => this.unplug(event.gamepad));
    if (pads().length > 0) this.watch();
  }

  /** Let go; the stick has to return to its center before it drives again. */
  cancel() {
    this.centered.clear();
    this.driving = null;
    this.sender.release(this);
  }

  watch() {
    this.timer ??= setInterval(() => this.poll(), PERIOD_MS);
  }

  plug(pad) {
    this.centered.delete(pad.index); // maybe of another pad; this one has to be seen at rest first
    this.watch();
  }

  unplug(pad) {
    this.centered.delete(pad.index);
    this.stop.release(presser(pad));
    this.poll();
  }

  poll() {
    const found = pads();
    if (found.length === 0) {
      clearInterval(this.timer);
      this.timer = null;
    }
    const lost = this.driving !== null && !found.some((pad) => pad.index === this.driving);
    if (lost) this.cancel();
    for (const pad of found) this.read(pad);
  }

  read(pad) {
    if (pad.buttons[STOP_BUTTON]?.pressed) this.stop.press(presser(pad));
    else this.stop.release(presser(pad));
    const shares = sticks(pad, this.sender.strafes);
    if (Object.values(shares).every((share) => share === 0)) {
      this.centered.add(pad.index);
      if (this.driving === pad.index) this.rest();
    } else if (this.centered.has(pad.index) && (this.driving ?? pad.index) === pad.index) {
      // A live pad has noise; a disconnected one may report the same values forever.
      const values = JSON.stringify([pad.axes, pad.buttons.map(({ value }) => value)]);
      if (this.driving === null || values !== this.values) this.hands[0].seen();
      this.values = values;
      this.driving = pad.index;
      // A pad works without the focus, but must not drive from a window in the background.
      if (!document.hasFocus() || !this.sender.take(this, shares)) this.cancel();
    }
  }

  rest() {
    this.driving = null;
    this.sender.release(this);
  }
}

function pads() {
  // Firefox has none unless the page is from this computer or HTTPS.
  return [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad && pad.connected);
}

/** The pad's name for the stop. */
function presser(pad) {
  return `gamepad ${pad.index}`;
}

/** The shares of the axes, -1 to 1; the axes of the sticks point right and down. */
function sticks(pad, strafes) {
  const [x, y] = outside(pad.axes[0] ?? 0, pad.axes[1] ?? 0);
  // In a non-standard layout, the third axis may be a trigger, at rest at -1.
  const standard = pad.mapping === "standard";
  const [turn] = standard ? outside(pad.axes[2] ?? 0, 0) : [0];
  if (strafes && standard) return { linear: -y, angular: -turn, lateral: -x };
  return { linear: -y, angular: -(Math.abs(turn) > Math.abs(x) ? turn : x) };
}

/** Remove a stick's dead zone, and scale the rest to reach 1 in every direction. */
function outside(x, y) {
  const length = Math.hypot(x, y);
  if (!(length > DEAD)) return [0, 0];
  const scale = Math.min((length - DEAD) / (1 - DEAD), 1) / length;
  return [x * scale, y * scale];
}
