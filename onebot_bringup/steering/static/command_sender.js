/**
 * Sends the velocity commands of all inputs (pad, sliders, keys, gamepad) to the server.
 *
 * An input takes control with `take`, called again at every change, and gives it up with `release`.
 * In between the command is sent every 50 ms, also when it stays the same: the server stops the
 * robot when none comes. One input has control at a time; when another takes it, `cancel()` of the
 * previous one is called. A cancelled input takes control again only after new user input.
 */

const PERIOD_MS = 50;
const CONFIRM_MS = 1000; // after taking control; later the server's states are not older

export class CommandSender {
  /**
   * @param {(message: object) => void} send to the server.
   * @param {(holder: object | null) => void} changed called when another input takes control.
   */
  constructor(send, changed) {
    this.send = send;
    this.changed = changed;
    this.holder = null;
    this.enabled = false;
    this.stopped = false; // the stop is pressed
    this.limits = { linear: 0, angular: 0 };
    this.linear = this.angular = 0;
    this.sequence = 0;
    this.confirmed = false;
  }

  /**
   * Drive.
   * @param {object} source the input; has cancel().
   * @param {number} linear -1 to 1, forward positive, of the linear limit.
   * @param {number} angular -1 to 1, to the left positive, of the angular limit.
   * @returns {boolean} false if it cannot take control now.
   */
  take(source, linear, angular) {
    if (!this.ready) return false;
    const fresh = this.holder !== source;
    if (fresh) this.setHolder(source);
    this.linear = linear;
    this.angular = angular;
    if (fresh) this.sendCommand();
    return true;
  }

  /** Give up control, if this input has it. */
  release(source) {
    if (this.holder !== source) return;
    this.setHolder(null);
    this.send({ type: "release" });
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
    this.send({ type: "stop" });
    this.drop();
  }

  /** Apply the server's state; cancel the active input if another page took control. */
  update(state) {
    this.limits = state.limits;
    if (!this.holder) return;
    // A state sent before our first command arrived does not name us yet.
    if (state.you) this.confirmed = true;
    else if (this.confirmed || performance.now() - this.since > CONFIRM_MS) this.drop();
  }

  /** The command now, m/s and rad/s. */
  get command() {
    return {
      linear: this.linear * this.limits.linear,
      angular: this.angular * this.limits.angular,
    };
  }

  setHolder(source) {
    const before = this.holder;
    this.holder = source;
    this.linear = this.angular = 0;
    clearInterval(this.timer);
    if (before && source) before.cancel();
    if (!before) {
      this.confirmed = false;
      this.since = performance.now();
    }
    if (source) this.timer = setInterval(() => this.sendCommand(), PERIOD_MS);
    this.changed(source);
  }

  sendCommand() {
    this.sequence += 1;
    this.send({ type: "drive", seq: this.sequence, ...this.command });
  }
}
