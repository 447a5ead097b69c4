/**
 * The wheel: the one place that commands come through, whatever hand they come from.
 *
 * A source (pad, sliders, keys, gamepad) takes hold with `take`, which may be called again at every
 * change, and lets go with `release`. While it is held, the command goes out every 50 ms, also when
 * it stays the same: the server stops the robot when none comes. Only one source holds the wheel;
 * the next one to take it makes the one before let go. A source whose `cancel()` is called lets go
 * and does not take again before the hand did something new: nothing resumes by itself.
 */

const PERIOD_MS = 50;

export class Wheel {
  /**
   * @param {(message: object) => void} send to the server.
   * @param {(holder: object | null) => void} changed called when another source holds it.
   */
  constructor(send, changed) {
    this.send = send;
    this.changed = changed;
    this.holder = null;
    this.enabled = false;
    this.limits = { linear: 0, angular: 0 };
    this.linear = this.angular = 0;
    this.sequence = 0;
    this.confirmed = false;
  }

  /**
   * Drive.
   * @param {object} source who holds; has cancel().
   * @param {number} linear -1 to 1, forward positive, of the linear limit.
   * @param {number} angular -1 to 1, to the left positive, of the angular limit.
   * @returns {boolean} false if it cannot be held now.
   */
  take(source, linear, angular) {
    if (!this.enabled || document.hidden) return false;
    const fresh = this.holder !== source;
    if (fresh) this.hand(source);
    this.linear = linear;
    this.angular = angular;
    if (fresh) this.say();
    return true;
  }

  /** Let go, if this source holds it. */
  release(source) {
    if (this.holder !== source) return;
    this.hand(null);
    this.send({ type: "release" });
  }

  /** Make whoever holds it let go: focus, page or connection went, or another page drives. */
  drop() {
    const holder = this.holder;
    if (!holder) return;
    this.release(holder);
    holder.cancel();
  }

  /** The stop button: for the robot, whoever drives it. */
  stop() {
    this.send({ type: "stop" });
    this.drop();
  }

  /** Take notice of who drives by the server's word; drop what another page has taken. */
  hear(state) {
    this.limits = state.limits;
    if (!this.holder) return;
    // A state that was sent before our first command came does not know of us yet.
    if (state.you) this.confirmed = true;
    else if (this.confirmed) this.drop();
  }

  /** The command now, m/s and rad/s. */
  get command() {
    return {
      linear: this.linear * this.limits.linear,
      angular: this.angular * this.limits.angular,
    };
  }

  hand(source) {
    const before = this.holder;
    this.holder = source;
    this.linear = this.angular = 0;
    clearInterval(this.timer);
    if (before && source) before.cancel();
    if (!before) this.confirmed = false;
    if (source) this.timer = setInterval(() => this.say(), PERIOD_MS);
    this.changed(source);
  }

  say() {
    this.sequence += 1;
    this.send({ type: "drive", seq: this.sequence, ...this.command });
  }
}
