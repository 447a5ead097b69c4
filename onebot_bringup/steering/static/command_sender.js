/**
 * Sends the velocity commands of all inputs (pad, sliders, keys, gamepad, joints) to the server.
 *
 * An input takes control with `take`, called again at every change, and gives it up with `release`.
 * In between the command is sent every 50 ms, also when it stays the same: the server stops the
 * robot when none comes. One input has control at a time; when another takes it, `cancel()` of the
 * previous one is called. A cancelled input takes control again only after new user input.
 */

import { PERIOD_MS } from "./hand.js";

const MOST_WAITING = 6; // commands on their way: a slow connection queues no more, and a stop is next
const STALL_MS = 1000; // a page that stood still for that long may have missed a release
const STILL = { linear: 0, angular: 0, lateral: 0, joints: {} };

export class CommandSender {
  /**
   * @param {import("./connection.js").Connection} connection to the server.
   * @param {(holder: object | null) => void} changed called when another input takes control.
   * @param {() => void} missed called when an input lost control since its hand was not seen.
   */
  constructor(connection, changed, missed) {
    this.connection = connection;
    this.changed = changed;
    this.missed = missed;
    this.holder = null;
    this.enabled = false;
    this.stopped = false; // the stop is pressed
    this.limits = { linear: 0, angular: 0, lateral: 0 };
    this.granted = this.limits; // those of the press: a limit raised since then waits for the next
    this.radius = 0; // the least of a robot that steers, m
    this.sideways = false; // the horizontal axis of the pad and of the sliders is the lateral one
    this.shares = STILL;
    this.ticks = 0;
  }

  /**
   * Drive.
   * @param {object} source the input; has cancel(), and the hands that hold its controls now, all
   *   of which have to be there: hands.
   * @param {{linear?: number, angular?: number, lateral?: number, joints?: Object<string, number>}}
   *   shares -1 to 1 of each limit, forward and to the left positive; of the curvature with the
   *   least radius, where the robot steers; and velocities by the joints' names, rad/s or m/s.
   * @returns {boolean} false if it cannot take control now.
   */
  take(source, shares) {
    if (!this.ready) return false;
    const fresh = this.holder !== source;
    if (fresh) this.setHolder(source);
    this.shares = { ...STILL, ...shares };
    if (fresh) {
      this.sendCommand();
      this.first = this.connection.sent;
    }
    return true;
  }

  /** Give up control, if this input has it. */
  release(source) {
    if (this.holder !== source) return;
    this.setHolder(null);
    this.connection.send({ type: "release" });
  }

  /** Cancel the active input: focus, page or connection was lost, or another page drives. */
  drop() {
    const holder = this.holder;
    if (!holder) return;
    this.release(holder);
    holder.cancel();
  }

  /** Whether an input can take control now. */
  get ready() {
    return this.enabled && !this.stopped && !document.hidden;
  }

  /** Stop the robot, also when another page drives it. */
  stop() {
    this.connection.send({ type: "stop" });
    this.drop();
  }

  /** Stop again, unless the connection is behind with what it has to send. */
  keepStopped() {
    if (this.connection.waiting < MOST_WAITING / 2) this.stop();
  }

  /** Apply the server's state; cancel the active input if another page took control. */
  update(state) {
    this.limits = state.limits;
    this.radius = state.least_radius;
    const lower = ([axis, most]) => [axis, Math.min(this.granted[axis], most)];
    this.granted = Object.fromEntries(Object.entries(this.limits).map(lower));
    // A state sent before our first command arrived does not name us yet; nor if it came too late.
    if (!state.you && !state.late && state.received >= this.first) this.drop();
  }

  /** Whether the drive goes sideways. */
  get strafes() {
    return this.limits.lateral > 0;
  }

  /** The share along the horizontal axis, as `take` expects it. */
  across(share) {
    return this.sideways ? { lateral: share } : { angular: share };
  }

  /** The command now, m/s and rad/s; of joints in their units. */
  get command() {
    const { shares, granted, radius } = this;
    const linear = shares.linear * granted.linear;
    const turn = radius ? linear / radius : granted.angular;
    return {
      linear,
      angular: shares.angular * turn,
      lateral: shares.lateral * granted.lateral,
      joints: shares.joints,
    };
  }

  setHolder(source) {
    const before = this.holder;
    if (!before) this.granted = this.limits;
    this.holder = source;
    this.shares = STILL;
    clearInterval(this.timer);
    if (before && source) before.cancel();
    if (source) {
      this.ticked = performance.now();
      this.timer = setInterval(() => this.tick(), PERIOD_MS);
    }
    this.changed(source);
  }

  tick() {
    const now = performance.now();
    const stalled = now - this.ticked > STALL_MS;
    this.ticked = now;
    this.ticks += 1;
    if (stalled || !this.holder.hands.every((hand) => hand.count())) {
      this.drop();
      this.missed();
      return;
    }
    // Where answers take long, every other one: half a second's commands may be on their way.
    const most = this.ticks % 2 ? MOST_WAITING : MOST_WAITING / 2;
    if (this.connection.waiting < most) this.sendCommand();
  }

  sendCommand() {
    this.connection.send({ type: "drive", stamp: this.connection.stamp, ...this.command });
  }
}
