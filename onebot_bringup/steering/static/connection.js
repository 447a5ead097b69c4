/**
 * The WebSocket to the robot's server: JSON both ways, and a new one whenever the old is lost.
 *
 * The server tells its state ten times a second, so a silence of two seconds is a lost connection,
 * even where the network says nothing.
 */

import { serverAddress } from "./requests.js";

const SILENCE_MS = 2000;
const FIRST_WAIT_MS = 250;
const LONGEST_WAIT_MS = 4000;
const OVERDUE_MS = 600; // half a second, and until the next state

export class Connection {
  /**
   * @param {object} on what to call:
   *   on.up() when the server has said welcome, on.down(reason) when it is lost (reason: a
   *   sentence, or ""), on.message(object) for every other message.
   */
  constructor(on) {
    this.on = on;
    this.isUp = false;
    this.sent = this.received = 0; // messages of this connection; by the server's word
    this.stamp = null; // the server's newest
    this.wait = FIRST_WAIT_MS;
    this.open();
    const now = () => this.openNow();
    window.addEventListener("online", now);
    for (const type of ["pageshow", "focus", "pointerdown", "keydown"]) {
      window.addEventListener(type, now);
    }
    document.addEventListener("visibilitychange", () => document.hidden || now());
  }

  /** Send a message; one that cannot leave now is dropped, since it would be late. */
  send(message) {
    if (!this.isUp) return;
    if (this.waiting === 0) this.answered = performance.now();
    this.sent += 1;
    this.socket.send(JSON.stringify(message));
  }

  /** How many messages are on their way, as far as the server's answers tell. */
  get waiting() {
    return this.sent - this.received;
  }

  /** Messages are on their way, and none of them has arrived for more than half a second. */
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
    // A dead peer answers no closing handshake: wait for none.
    this.socket.onmessage = this.socket.onclose = null;
    this.socket.close();
    this.isUp = false;
    this.retry = setTimeout(() => this.open(), this.wait * (0.75 + Math.random() / 2));
    this.wait = Math.min(2 * this.wait, LONGEST_WAIT_MS);
    this.on.down("");
    this.askWhy();
  }

  /** A refused WebSocket does not tell why; a plain request does. */
  async askWhy() {
    try {
      const answer = await fetch(location.href, { method: "HEAD", cache: "no-store" });
      if (answer.status === 403 && !this.isUp) {
        this.on.down("The server asks for another token: open the address that it printed.");
      }
    } catch {
      // It does not answer at all, which is what was said already.
    }
  }
}
