// The page's own modules, with a clock that only `replay` moves, and a server that answers soon.
const timers = new Map();
let now = 0, count = 0;
const start = (run, wait, period) => (timers.set(++count, { at: now + wait, run, period }), count);
performance.now = () => now;
window.setTimeout = (run, wait = 0) => start(run, wait, 0);
window.setInterval = (run, period) => start(run, period, period);
window.clearTimeout = window.clearInterval = (id) => timers.delete(id);
window.WebSocket = class {
  constructor() { window.server = this; this.received = 0; this.commands = []; }
  send(text) {
    this.received += 1;
    if (this.received % 2) setTimeout(() => this.answer("answer"), 10);
    if (text.startsWith('{"type":"drive"')) this.commands.push(now);
  }
  answer(type) {
    this.onmessage({ data: JSON.stringify({ type, stamp: now, received: this.received }) });
  }
  close() {}
};
Element.prototype.setPointerCapture = () => {}; // of pointers that no hardware has
window.stick = null; // the axes of a gamepad
navigator.getGamepads = () => window.stick ? [{
  index: 0, connected: true, mapping: "standard", timestamp: now, axes: window.stick, buttons: [],
}] : [];
window.fetch = () => new Promise(() => {});
function advance(to) {
  for (;;) {
    let next, id;
    for (const [key, timer] of timers) if (!next || timer.at < next.at) [id, next] = [key, timer];
    if (!next || next.at > to) break;
    now = Math.max(now, next.at);
    if (next.period) next.at += next.period;
    else timers.delete(id);
    next.run();
  }
  now = to;
}
window.connect = () => {
  server.answer("welcome");
  setInterval(() => server.answer("answer"), 1000); // a server that is silent has gone
};
window.pass = (duration) => {
  server.commands = [];
  advance(now + duration);
  return server.commands.length;
};
const MODIFIERS = { shiftKey: 2, ctrlKey: 4, altKey: 8, metaKey: 16 };
window.replay = (events, duration) => {
  const begin = now, field = document.getElementById("angular-limit");
  server.commands = [];
  let target = document.body;
  for (const [time, kind, code, flags] of events) {
    advance(begin + time);
    const options = { code, repeat: Boolean(flags & 1), bubbles: true, cancelable: true };
    for (const [name, flag] of Object.entries(MODIFIERS)) options[name] = Boolean(flags & flag);
    if (kind === "focusin") target = field;
    if (kind.startsWith("key")) target.dispatchEvent(new KeyboardEvent(kind, options));
    else (kind.startsWith("focus") && kind !== "focus" ? field : window).dispatchEvent(
      new FocusEvent(kind, { bubbles: true }));
    if (kind === "focusout") target = document.body;
  }
  advance(begin + duration);
  const commands = server.commands.map((time) => time - begin);
  window.dispatchEvent(new Event("blur"));
  return commands;
};
