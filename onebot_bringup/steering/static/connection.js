/**
 * The WebSocket to the robot's server: JSON both ways; it reconnects when the connection is lost.
 *
 * The server sends its state ten times a second, so two seconds of silence are a lost connection,
 * even if the network reports nothing.
 */

import { serverAddress } from "./requests.js";

const SILENCE_MS = 2000;
const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 4000;
const OVERDUE_MS = 600; // half a second, plus the time until the next state

export class Connection {
  /**
   * @param {object} on callbacks: on.up() when the server has sent welcome, on.down(reason) when the
   *   connection is lost (reason: a sentence, or ""), on.message(object) for every other message.
   */
  constructor(on) {
    this.on = on;
    this.isUp = false;
    this.sent = this.received = 0; // messages of this connection; received according to the server
    this.stamp = null; // the server's newest stamp
    this.wait = FIRST_WAIT_MS;
    this.open();
    const now = () => this.openNow();
    window.addEventListener("online", now);
    for (const type of ["pageshow", "focus", "pointerdown", "keydown"]) {
      window.addEventListener(type, now);
    }
    document.addEventListener("visibilitychange", () => document.hidden || now());
  }

  /** Send a message; drop it if it cannot be sent now, since it would be late. */
  send(message) {
    if (!this.isUp) return;
    if (this.waiting === 0) this.answered = performance.now();
    this.sent += 1;
    this.socket.send(JSON.stringify(message));
  }

  /** The number of messages that the server has not confirmed yet. */
  get waiting() {
    return this.sent - this.received;
  }

  /** Whether messages are unconfirmed, and none was confirmed for more than half a second. */
  get overdue() {
    return this.waiting > 0 && performance.now() - this.answered > OVERDUE_MS;
  }

  open() {
    clearTimeout(this.retry);
    this.retry = null;
    const address = serverAddress("ws");
    address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
    const socket = (this.socket = new WebSocket(address));
    socket.onmessage = (event) => this.receive(JSON.parse(event.data));
    socket.onclose = () => this.lose();
    this.expectMore();
  }

  openNow() {
    if (this.retry === null) return;
    this.wait = FIRST_WAIT_MS;
    this.open();
  }

  receive(message) {
    this.expectMore();
    this.stamp = message.stamp ?? this.stamp;
    if (message.type !== "welcome") {
      if (message.received > this.received) this.answered = performance.now();
      this.received = message.received ?? this.received;
      this.on.message(message);
      return;
    }
    this.isUp = true;
    this.sent = this.received = 0;
    this.wait = FIRST_WAIT_MS;
    this.on.up();
  }

  expectMore() {
    clearTimeout(this.silence);
    this.silence = setTimeout(() => this.lose(), SILENCE_MS);
  }

  lose() {
    clearTimeout(this.silence);
    // A dead peer does not answer a closing handshake, so do not wait for it.
    this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.isUp = false;
    this.retry = setTimeout(() => this.open(), this.wait * (0.75 + Math.random() / 2));
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
    this.on.down("");
    this.askWhy();
  }

  /** A rejected WebSocket has no reason; a plain request has one. */
  async askWhy() {
    try {
      const answer = await fetch(location.href, { method: "HEAD", cache: "no-store" });
      if (answer.status === 403 && !this.isUp) {
        this.on.down("The server requires another token: open the address that it printed.");
      }
    } catch {
      // It does not answer at all, which was already reported.
    }
  }
}
