/**
 * The ground from above, as RViz's top-down view: x to the right, y up; the robot, its scans and the
 * map.
 * A drag moves it, the wheel or two fingers zoom. While a tool is chosen, a press sets a place on the
 * ground, a drag from there its heading, and the release publishes both; numbers do the same.
 */

import { get, toolAddress } from "./requests.js";
import { write } from "./elements.js";

const PERIOD_MS = 200;
const ZOOM = 1.5; // factor of a button's press
const SCALES = [2, 2000]; // pixels per meter
const LINES = 40; // minimum distance of two lines of the grid, pixels
const TURNED = 8; // pixels; a shorter drag has no heading

export class GroundMap {
  /**
   * @param {HTMLElement} pane with an svg, the buttons of the zoom, and a status.
   * @param {(tool: string, place: {frame: string, command_topic: string, x: number, y: number,
   *   yaw: number}) => void} placed called on release with a place on the ground in m and rad, and
   *   the robot that it is for.
   */
  constructor(pane, placed) {
    this.pane = pane;
    this.placed = placed;
    this.status = pane.querySelector("[role=status]");
    this.drawing = pane.querySelector("svg");
    this.typed = pane.querySelector(".typed");
    this.parts = {};
    for (const part of this.drawing.children) this.parts[part.getAttribute("class")] = part;
    this.ground = { frame: "", command_topic: "", robot: null, map: null, scans: [], path: [], footprint: [] };
    this.center = { x: 0, y: 0 };
    this.scale = 80;
    this.follows = true; // the robot stays in the middle
    this.tool = "";
    this.place = null; // the pressed place on the ground, m and rad
    this.pointers = new Map(); // the last positions of the pointers that are down, pixels
    const on = (type, act) => this.drawing.addEventListener(type, act);
    on("pointerdown", (event) => this.press(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.release(event));
    on("pointercancel", (event) => this.cancel(event));
    on("wheel", (event) => this.roll(event));
    const zoom = (factor) => this.zoom(factor, this.middle);
    const buttons = {
      closer: () => zoom(ZOOM),
      farther: () => zoom(1 / ZOOM),
      center: () => this.follow(),
      publish: () => this.publishTyped(),
    };
    for (const [name, act] of Object.entries(buttons)) {
      pane.querySelector(`[name=${name}]`).addEventListener("click", act);
    }
    new ResizeObserver(() => this.draw()).observe(this.drawing);
  }

  get isOpen() {
    return !this.pane.hidden;
  }

  open(yes) {
    if (yes === this.isOpen) return;
    this.pane.hidden = !yes;
    clearTimeout(this.timer);
    if (yes) this.poll();
    else this.choose("");
  }

  /** Take the next press as a place for this tool; "" for none. */
  choose(tool) {
    this.tool = tool;
    this.place = null;
    this.drawing.classList.toggle("aims", tool !== "");
    this.typed.hidden = tool === "";
    this.input("yaw").parentElement.hidden = tool === "point";
    this.draw();
  }

  say(sentence) {
    write(this.status, sentence);
  }

  async poll() {
    try {
      this.show(await get("ground"));
    } catch (error) {
      this.say(error.message);
    }
    if (this.isOpen) this.timer = setTimeout(() => this.poll(), PERIOD_MS);
  }

  show(ground) {
    if (ground.map && ground.map.version !== this.ground.map?.version) {
      this.parts.map.setAttribute("href", toolAddress("map.png", { version: ground.map.version }));
    }
    const { frame, command_topic } = this.ground;
    if (this.place && (frame !== ground.frame || command_topic !== ground.command_topic)) {
      this.place = null;
      this.say("The robot or the frame has changed: press again.");
    }
    this.ground = ground;
    if (this.follows && ground.robot && !this.place) this.center = { ...ground.robot };
    this.draw();
  }

  follow() {
    this.follows = true;
    this.show(this.ground);
  }

  // --- pixels and meters -----------------------------------------------------------------------

  get middle() {
    const { width, height } = this.drawing.getBoundingClientRect();
    return { x: width / 2, y: height / 2 };
  }

  /** The place on the ground at a pixel of the drawing. */
  at({ x, y }) {
    const { middle, center, scale } = this;
    return { x: center.x + (x - middle.x) / scale, y: center.y - (y - middle.y) / scale };
  }

  pixel({ x, y }) {
    const { middle, center, scale } = this;
    return { x: middle.x + (x - center.x) * scale, y: middle.y - (y - center.y) * scale };
  }

  // --- pointers --------------------------------------------------------------------------------

  position(event) {
    const { left, top } = this.drawing.getBoundingClientRect();
    return { x: event.clientX - left, y: event.clientY - top };
  }

  press(event) {
    if (event.button !== 0) return;
    const position = this.position(event);
    this.drawing.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, position);
    if (this.pointers.size > 1) this.place = null; // two fingers zoom
    else if (this.tool) this.place = { ...this.at(position), yaw: 0 };
    this.draw();
  }

  move(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const now = this.position(event);
    if (this.pointers.size > 1) this.pinch(event.pointerId, before, now);
    else if (this.place) this.turn(now);
    else if (!this.tool) this.drag(before, now);
    this.pointers.set(event.pointerId, now);
    this.draw();
  }

  turn(now) {
    const from = this.pixel(this.place);
    if (distance(from, now) > TURNED) this.place.yaw = Math.atan2(from.y - now.y, now.x - from.x);
  }

  drag(before, now) {
    this.follows = false;
    this.center.x -= (now.x - before.x) / this.scale;
    this.center.y += (now.y - before.y) / this.scale;
  }

  pinch(id, before, now) {
    const [, other] = [...this.pointers].find(([each]) => each !== id);
    this.zoom(distance(other, now) / Math.max(1, distance(other, before)), other);
  }

  release(event) {
    const place = this.pointers.size === 1 ? this.place : null;
    this.cancel(event);
    if (place) this.publish(place);
  }

  publish(place) {
    const { frame, command_topic } = this.ground;
    if (frame) this.placed(this.tool, { frame, command_topic, ...place });
    else this.say("Not published: the frame of the ground is not known yet.");
  }

  input(name) {
    return this.typed.querySelector(`[name=${name}]`);
  }

  publishTyped() {
    const texts = ["x", "y", "yaw"].map((name) => this.input(name).value.trim().replace(",", "."));
    const [x, y, turn] = texts.map(Number);
    const isPlace = texts[0] && texts[1] && [x, y, turn].every(Number.isFinite);
    if (isPlace) this.publish({ x, y, yaw: (turn * Math.PI) / 180 });
    else this.say("Write numbers, such as 0.5.");
  }

  cancel(event) {
    this.pointers.delete(event.pointerId);
    this.place = null;
    this.draw();
  }

  roll(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY / 500), this.position(event));
  }

  /** Zoom by a factor, with the ground at a pixel staying where it is. */
  zoom(factor, pixel) {
    const fixed = this.at(pixel);
    this.scale = Math.max(SCALES[0], Math.min(SCALES[1], this.scale * factor));
    const moved = this.at(pixel);
    if (!this.follows) {
      this.center = { x: this.center.x + fixed.x - moved.x, y: this.center.y + fixed.y - moved.y };
    }
    this.draw();
  }

  // --- the drawing -----------------------------------------------------------------------------

  draw() {
    if (!this.isOpen) return;
    const { robot, map, scans, path, footprint } = this.ground;
    this.parts.grid.setAttribute("d", this.grid());
    this.parts.scan.setAttribute("d", this.points(scans));
    this.parts.path.setAttribute("d", this.line(path));
    this.parts.footprint.setAttribute("d", footprint.length ? `${this.line(footprint)}Z` : "");
    this.arrow(this.parts.robot, robot, Math.max(1, this.scale / 60));
    this.arrow(this.parts.placed, this.place, this.tool === "point" ? 0.4 : 2);
    toggle(this.parts.map, map);
    if (!map) return;
    const origin = this.pixel(map);
    const turn = `rotate(${degrees(-map.yaw)}) scale(${this.scale}) translate(0 ${-map.height})`;
    this.parts.map.setAttribute("transform", `translate(${origin.x} ${origin.y}) ${turn}`);
    this.parts.map.setAttribute("width", map.width);
    this.parts.map.setAttribute("height", map.height);
  }

  /** Draw a part, 20 pixels long at size 1, at a pose on the ground; hide it without one. */
  arrow(part, pose, size) {
    toggle(part, pose);
    if (!pose) return;
    const { x, y } = this.pixel(pose);
    const turn = `rotate(${degrees(-pose.yaw)}) scale(${size})`;
    part.setAttribute("transform", `translate(${x} ${y}) ${turn}`);
  }

  /** A dot for each place, as a line without length. */
  points(places) {
    const dots = places.map(([x, y]) => this.pixel({ x, y }));
    return dots.map(({ x, y }) => `M${x.toFixed(1)} ${y.toFixed(1)}h0`).join("");
  }

  /** A line through places. */
  line(places) {
    const pixels = places.map(([x, y]) => this.pixel({ x, y }));
    return pixels.map(({ x, y }, n) => `${n ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
  }

  /** The lines of the grid, at round numbers of meters. */
  grid() {
    const step = 10 ** Math.ceil(Math.log10(LINES / this.scale));
    const { x: right, y: bottom } = { x: 2 * this.middle.x, y: 2 * this.middle.y };
    const [low, high] = [this.at({ x: 0, y: bottom }), this.at({ x: right, y: 0 })];
    const lines = [];
    for (let x = Math.ceil(low.x / step); x * step < high.x; x++) {
      lines.push(`M${this.pixel({ x: x * step, y: 0 }).x} 0V${bottom}`);
    }
    for (let y = Math.ceil(low.y / step); y * step < high.y; y++) {
      lines.push(`M0 ${this.pixel({ x: 0, y: y * step }).y}H${right}`);
    }
    return lines.join("");
  }
}

const degrees = (angle) => (angle * 180) / Math.PI;
const distance = (a, b) => Math.hypot(a.x - b.x, a.y - b.y);
const toggle = (part, shown) => part.classList.toggle("absent", !shown);
