/** The fields that choose what is steered and how fast: the robot, its topic and the limits. */

import { fill, onEnterLeave, write } from "./elements.js";

const UNITS = { linear: "m/s", angular: "rad/s", lateral: "m/s" };
const NUMBER = /^[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?$/i;
const CONFIRM_MS = 1000; // after an entry, until the server's states certainly have it
const STORED = "limits"; // in the tab's storage, which outlives a reload

export class Robot {
  /**
   * @param {HTMLElement} group with a select; hidden while there is no choice.
   * @param {(topic: string) => void} choose called with the topic of the chosen robot.
   */
  constructor(group, choose) {
    this.group = group;
    this.select = group.querySelector("select");
    this.select.addEventListener("pointerdown", () => (this.pointed = true));
    this.select.addEventListener("keydown", () => (this.pointed = false));
    this.select.addEventListener("change", () => {
      choose(this.select.value);
      // The keys drive again, unless they made the choice: the next press must not drive the robot.
      if (this.pointed) this.select.blur();
    });
    onEnterLeave(this.select);
  }

  /** Show the server's robots, and the one that is steered. */
  show({ topic, robots }) {
    const known = robots.some((robot) => robot.topic === topic);
    const offered = known ? robots : [...robots, { name: topic, topic }];
    const isNew = fill(this.select, offered, ({ name, topic }) => new Option(name, topic));
    if (!isNew && topic === this.topic) return;
    this.group.hidden = offered.length < 2;
    this.topic = this.select.value = topic;
  }

  /** The server rejected the choice. */
  refuse() {
    this.select.value = this.topic;
  }
}

/** The name of the steered robot: its namespace and its description's name, or else its topic. */
export function nameOf({ topic, robots, robot_name: described }) {
  const name = robots.find((robot) => robot.topic === topic)?.name ?? topic;
  if (!described) return name;
  return name === topic ? described : `${name} (${described})`;
}

export class Topic {
  /**
   * @param {HTMLElement} group with an input, a datalist and an output.
   * @param {(topic: string) => void} choose called with what the user enters.
   */
  constructor(group, choose) {
    this.input = group.querySelector("input");
    this.list = group.querySelector("datalist");
    this.note = group.querySelector("output");
    this.hint = new Hint(group, this.input);
    this.known = "";
    this.input.addEventListener("change", () => {
      const topic = this.input.value.trim();
      if (topic && topic !== this.known) choose(topic);
      else this.input.value = this.known;
    });
    onEnterLeave(this.input);
    // The list offers what matches the text in the field: an empty field offers all.
    this.input.addEventListener("focus", () => this.input.select());
  }

  /** Show why the server rejected a topic; the field shows the current one. */
  refuse(sentence) {
    this.hint.refuse(sentence);
    this.input.value = this.known;
  }

  /** Show the server's topic, but not over what the user is typing. */
  show(state) {
    this.known = state.topic;
    if (document.activeElement !== this.input) this.input.value = state.topic;
    fill(this.list, state.topics, (topic) => new Option("", topic));
    const type = state.topic_type.split("/").pop();
    const subscribers = ["no subscriber", "1 subscriber"][state.listeners];
    write(this.note, `${type}, ${subscribers ?? `${state.listeners} subscribers`}`);
    this.note.classList.toggle("warning", state.listeners === 0);
  }
}

export class Limits {
  /**
   * @param {Object<string, HTMLElement>} groups by axis, each with an input and a hint.
   * @param {(limits: Object<string, number | null>) => void} choose called with what is chosen by
   *   hand, by axis; null is the controller's limit.
   */
  constructor(groups, choose) {
    this.choose = choose;
    this.fields = {};
    for (const [axis, unit] of Object.entries(UNITS)) {
      const enter = (value) => this.enter(axis, value);
      this.fields[axis] = new LimitField(groups[axis], unit, enter);
    }
    this.entered = -Infinity;
    this.forget();
  }

  /** Send the entry of one field, with the other limits unchanged. */
  enter(axis, value) {
    // A state sent before the last entry arrived does not contain it.
    const confirmed = performance.now() - this.entered > CONFIRM_MS;
    this.entry = { ...(confirmed ? this.chosen : this.entry), [axis]: value };
    this.entered = performance.now();
    this.choose(this.entry);
  }

  /** Show the server's state; send the limits again to a server that was restarted. */
  show({ chosen, limits, ceiling, ceiling_from: from }) {
    this.chosen = chosen;
    for (const [axis, field] of Object.entries(this.fields)) {
      field.show(chosen[axis], limits[axis], ceiling[axis], from[axis]);
    }
    const lost = this.fresh && isEmpty(chosen) ? load() : null;
    this.fresh = false;
    if (lost) this.choose({ ...chosen, ...lost });
    else save(chosen);
  }

  /** The connection is lost: the next state may come from a restarted server. */
  forget() {
    this.fresh = true;
  }
}

class LimitField {
  constructor(group, unit, choose) {
    this.input = group.querySelector("input");
    this.hint = new Hint(group, this.input);
    this.unit = unit;
    this.choose = choose;
    this.input.addEventListener("change", () => this.enter());
    onEnterLeave(this.input);
  }

  enter() {
    const typed = this.input.value.trim();
    try {
      this.choose(limitOf(typed));
    } catch (error) {
      if (!(error instanceof RangeError)) throw error;
      this.hint.refuse(`${typed} rejected: ${error.message}`);
      this.input.value = this.known;
    }
  }

  /** Show the server's numbers, but not over what the user is typing. */
  show(chosen, limit, ceiling, from) {
    this.known = chosen === null ? text(limit) : String(chosen);
    if (document.activeElement !== this.input) this.input.value = this.known;
    this.hint.warn(this.warning(chosen, ceiling, from));
  }

  warning(chosen, ceiling, from) {
    const max = `${text(ceiling)} ${this.unit}`;
    if (!from) return `No limit known: at most ${max}.`;
    return chosen > ceiling ? `Limited to ${max} by ${from}.` : "";
  }
}

/** The sentence beside a field: why an entry was rejected, until the next entry, or a warning. */
class Hint {
  constructor(group, input) {
    this.element = group.querySelector(".hint");
    this.input = input;
    this.refusal = this.warning = "";
    input.addEventListener("input", () => this.refuse(""));
  }

  refuse(sentence) {
    this.refusal = sentence;
    this.input.setAttribute("aria-invalid", sentence !== "");
    this.show();
    if (sentence) this.element.scrollIntoView({ block: "nearest" });
  }

  warn(sentence) {
    this.warning = sentence;
    this.show();
  }

  show() {
    write(this.element, this.refusal || this.warning);
  }
}

/**
 * Parse the limit in a field, m/s or rad/s, with a point or a comma; null for an empty field.
 * @throws {RangeError} with a sentence about a valid entry.
 */
export function limitOf(typed) {
  if (typed === "") return null;
  if (!NUMBER.test(typed)) throw new RangeError("write a number, such as 0.5.");
  const value = Number(typed.replace(",", "."));
  if (value === 0 || typed.startsWith("-")) throw new RangeError("a limit must be above zero.");
  if (!Number.isFinite(value)) throw new RangeError("the number is too large.");
  return value;
}

function isEmpty(chosen) {
  return Object.values(chosen).every((value) => value === null);
}

/** The limits chosen by hand in this tab; null if the browser has stored none. */
function load() {
  try {
    const kept = JSON.parse(sessionStorage.getItem(STORED));
    return kept && !isEmpty(kept) ? kept : null;
  } catch {
    return null;
  }
}

function save(chosen) {
  try {
    sessionStorage.setItem(STORED, JSON.stringify(chosen));
  } catch {
    // Storage is disabled: a restart of the server or a reload of the page loses the limits.
  }
}

function text(value) {
  return String(Number(value.toPrecision(6)));
}
