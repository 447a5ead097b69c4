/** The panels: check boxes for what the view shows, and the parameters of any node. */

import { fill, make, onEnterLeave, write } from "./elements.js";
import { get, post } from "./requests.js";

const PERIOD_MS = 3000;
// The viewer's booleans that show something; the others set how it looks.
const SHOWS = /\.visible$|^(automatic|collision)$|^(axes|joint_plot)\./;
const WIDEST = 1e4; // maximum range of a slider
const STEPS = 200; // steps of a slider

/** A sheet over the view, which is kept up to date while it is open. */
class Panel {
  /** @param {HTMLElement} sheet with a place for rows, and a status. */
  constructor(sheet) {
    this.sheet = sheet;
    this.rows = sheet.querySelector(".rows");
    this.status = sheet.querySelector("[role=status]");
    this.node = ""; // the node whose parameters the fields set
    this.fields = new Map(); // keys: JSON of the name, type and range shown
  }

  get isOpen() {
    return !this.sheet.hidden;
  }

  open(yes) {
    if (yes === this.isOpen) return;
    this.sheet.hidden = !yes;
    if (yes) this.refresh();
    else clearTimeout(this.timer);
  }

  async refresh() {
    clearTimeout(this.timer);
    await this.attempt(() => this.load());
    if (this.isOpen) this.timer = setTimeout(() => this.refresh(), PERIOD_MS);
  }

  /** Run an action, and show the reason if it fails. */
  async attempt(action) {
    try {
      write(this.status, await action());
    } catch (error) {
      write(this.status, error.message);
    }
  }

  /**
   * Show these rows of a node; existing fields stay, with what the user is entering.
   * @param {object[]} rows with name, label, type, value, description, rule, range, and
   *   `values`: returns the parameters to set, by name, for a value of the row.
   */
  show(node, rows) {
    const before = node === this.node ? this.fields : new Map();
    this.node = node;
    this.fields = new Map();
    for (const row of rows) {
      const key = JSON.stringify([row.name, row.type, row.range]);
      const kind = row.type === "boolean" ? CheckBox : TextField;
      const set = (field, value) => this.set(field, value);
      const field = before.get(key) ?? new kind(row, set);
      field.show(row);
      this.fields.set(key, field);
    }
    if ([...before.keys()].join() !== [...this.fields.keys()].join()) {
      this.rows.replaceChildren(...[...this.fields.values()].map((field) => field.element));
    }
  }

  async set(field, value) {
    await this.attempt(async () => {
      const values = field.row.values(value);
      const { rejected } = await post("parameters", { node: this.node, values });
      field.refuse(Object.values(rejected).join(" "));
      return "";
    });
    this.refresh();
  }
}

/** A check box for each topic that the viewer could show, and for each part of its view. */
export class Displays extends Panel {
  async load() {
    const { viewer, shown } = await get("nodes");
    if (!viewer) return "There is no viewer.";
    const { parameters } = await get("parameters", { node: viewer });
    const lists = Object.fromEntries(parameters.map(({ name, value }) => [name, value]));
    const topics = shown.map(({ topic, type, visible }) => ({
      name: topic,
      type: "boolean",
      value: String(visible),
      description: type,
      values: (on) => moved(lists, topic, on === "true"),
    }));
    const parts = parameters
      .filter(({ name, type }) => type === "boolean" && SHOWS.test(name))
      .map((row) => ({ ...settable(row), label: titled(row.name) }));
    this.show(viewer, [...topics, ...parts]);
    return "";
  }
}

const settable = (row) => ({ ...row, values: (value) => ({ [row.name]: value }) });
const titled = (name) => name.replace(/\.visible$/, "").replaceAll(/[._]/g, " ");

/** The viewer's parameters `hidden` and `shown`, with the topic in one of them. */
function moved(lists, topic, on) {
  const others = (name) => listed(lists[name]).filter((one) => !names(one, topic));
  const [to, from] = on ? ["shown", "hidden"] : ["hidden", "shown"];
  return { [to]: JSON.stringify([...others(to), topic]), [from]: JSON.stringify(others(from)) };
}

/** The topics of a list in YAML, which are names without quotes or commas. */
const listed = (yaml = "[]") => yaml.match(/[\w/]+/g) ?? [];

/** Whether a name, which may be relative, is that of a topic. */
const names = (name, topic) => name === topic || topic.endsWith(`/${name}`);

/** The parameters of the chosen node, initially the robot's controller. */
export class Parameters extends Panel {
  constructor(sheet) {
    super(sheet);
    this.select = sheet.querySelector("select");
    this.filter = sheet.querySelector("[type=search]");
    this.chosen = "";
    this.select.addEventListener("change", () => {
      this.chosen = this.select.value;
      this.refresh();
    });
    this.filter.addEventListener("input", () => this.sift());
    onEnterLeave(this.filter);
  }

  async load() {
    const { nodes } = await get("nodes");
    const node = nodes.includes(this.chosen) ? this.chosen : nodes[0];
    fill(this.select, nodes, (name) => new Option(name));
    this.select.value = node ?? "";
    if (!node) return "No node has parameters.";
    const { parameters } = await get("parameters", { node });
    const rows = parameters.filter(({ read_only: fixed }) => !fixed);
    this.show(node, rows.map(settable));
    this.sift();
    return rows.length ? "" : "None of its parameters can be set.";
  }

  /** Show the parameters whose names contain all words of the filter. */
  sift() {
    const words = this.filter.value.toLowerCase().split(/\s+/);
    for (const { element, name } of this.fields.values()) {
      element.hidden = !words.every((word) => name.toLowerCase().includes(word));
    }
  }
}

let count = 0;

/** The row of a parameter: its name, the input, its description, and why a value was rejected. */
class Field {
  constructor({ name, label, description, rule }, inputs) {
    this.name = name;
    this.input = inputs[0];
    this.input.id = `field-${(count += 1)}`;
    this.element = make("div", { className: "row" });
    const title = make("label", { textContent: label ?? name, htmlFor: this.input.id });
    const about = make("p", { className: "about", id: `${this.input.id}-about` });
    about.textContent = [description, rule].filter(Boolean).join("; ");
    this.hint = make("p", { className: "hint", id: `${this.input.id}-hint`, ariaLive: "polite" });
    this.input.setAttribute("aria-describedby", `${about.id} ${this.hint.id}`);
    this.element.append(title, ...inputs, about, this.hint);
  }

  refuse(sentence) {
    write(this.hint, sentence);
    this.input.setAttribute("aria-invalid", String(sentence !== ""));
  }
}

class CheckBox extends Field {
  constructor(row, set) {
    const box = make("input", { type: "checkbox" });
    super(row, [box]);
    box.addEventListener("change", () => set(this, String(box.checked)));
    // The space bar stops the robot, and after a click the keys drive it again.
    box.addEventListener("keydown", ({ key }) => key === "Enter" && box.click());
    box.addEventListener("click", ({ detail }) => detail > 0 && box.blur());
  }

  show(row) {
    this.row = row;
    this.input.checked = row.value === "true";
  }
}

class TextField extends Field {
  constructor(row, set) {
    const input = make("input", { type: "text", autocomplete: "off", spellcheck: false });
    if (row.type === "double" || row.type === "integer") input.inputMode = "decimal";
    const slider = makeSlider(row);
    super(row, slider ? [input, slider] : [input]);
    this.slider = slider;
    input.addEventListener("change", () => set(this, input.value));
    onEnterLeave(input);
    slider?.addEventListener("input", () => (input.value = slider.value));
    slider?.addEventListener("change", () => set(this, slider.value));
  }

  /** Show the node's value, but not over what the user is typing. */
  show(row) {
    this.row = row;
    const focus = document.activeElement;
    if (focus === this.input || focus === this.slider) return;
    this.input.value = row.value;
    if (this.slider) this.slider.value = row.value;
  }
}

/** A slider for a number between two that are not far apart; null for others. */
function makeSlider({ name, type, range }) {
  if (!range || !(range[1] - range[0] <= WIDEST)) return null;
  const step = type === "integer" ? 1 : (range[1] - range[0]) / STEPS;
  const [min, max] = range;
  const slider = make("input", { type: "range", min, max, step, ariaLabel: `${name}, slider` });
  slider.addEventListener("pointerup", () => slider.blur());
  return slider;
}
