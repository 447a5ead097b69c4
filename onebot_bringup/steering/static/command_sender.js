/**
 * Sends the velocity commands of all inputs (pad, sliders, keys, gamepad, joints) to the server.
 *
 * An input takes control with `take`, called again at every change, and gives it up with `release`.
 * In between, the command is sent every 50 ms, even if it stays the same: the server stops the robot
 * without commands. One input has control at a time; when another takes it, the previous one's
 * `cancel()` is called. A cancelled input takes control again only after new user input.
 */

import { PERIOD_MS } from "./hand.js";

const MAX_WAITING = 6; // unconfirmed commands: a slow connection queues no more before a stop
const STALL_MS = 1000; // a page that stalled for that long may have missed a release
const STILL = { linear: 0, angular: 0, lateral: 0, joints: {} };

export class CommandSender {
  /**
   * @param {import("./connection.js").Connection} connection the connection to the server.
   * @param {(holder: object | null) => void} changed called when another input takes control.
   * @param {() => void} missed called when an input lost control because its hand was not seen.
   */
  constructor(connection, changed, missed) {
    this.connection = connection;
    this.changed = changed;
    this.missed = missed;
    this.holder = null;
    this.enabled = false;
    this.stopped = false; // whether the stop is pressed
    this.limits = { linear: 0, angular: 0, lateral: 0 };
    this.granted = this.limits; // the limits at the press; a raised limit waits for the next press
    this.radius = 0; // minimum radius of a robot that steers, m
    this.sideways = false; // whether the horizontal axis of the pad and sliders drives sideways
    this.shares = STILL;
    this.ticks = 0;
  }

  /**
   * Drive.
   * @param {object} source the input; has cancel() and `hands`, the hands that hold its controls
   *   now, all of which have to be there.
   * @param {{linear?: number, angular?: number, lateral?: number, joints?: Object<string, number>}}
   *   shares -1 to 1 of each limit, forward and to the left positive (if the robot steers, of the
   *   curvature with the minimum radius); and velocities by the joints' names, rad/s or m/s.
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

  /** Stop the robot, even if another page drives it. */
  stop() {
    this.connection.send({ type: "stop" });
    this.drop();
  }

  /** Stop again, unless the connection has a backlog. */
  keepStopped() {
    if (this.connection.waiting < MAX_WAITING / 2) this.stop();
  }

  /** Apply the server's state; cancel the active input if another page took control. */
  update(state) {
    this.limits = state.limits;
    this.radius = state.minimum_radius;
    const lower = ([axis, max]) => [axis, Math.min(this.granted[axis], max)];
    this.granted = Object.fromEntries(Object.entries(this.limits).map(lower));
    // A state sent before our first command arrived, or if it arrived late, does not name us yet.
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

  /** The current command, m/s and rad/s; joints in their units. */
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
    // If answers take long, send every other command: up to half a second's may be unconfirmed.
    const limit = this.ticks % 2 ? MAX_WAITING : MAX_WAITING / 2;
    if (this.connection.waiting < limit) this.sendCommand();
  }

  sendCommand() {
    this.connection.send({ type: "drive", stamp: this.connection.stamp, ...this.command });
  }
}
