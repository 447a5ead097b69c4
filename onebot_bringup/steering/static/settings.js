/** The fields that say what is steered and how fast: the robot, its topic and the limits. */

import { fill, onEnterLeave, write } from "./elements.js";

const UNITS = { linear: "m/s", angular: "rad/s", lateral: "m/s" };
const NUMBER = /^[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?$/i;
const CONFIRM_MS = 1000; // after an entry; later the server's states have it
const STORED = "limits"; // in the tab's storage, which outlives a reload

export class Robot {
  /**
   * @param {HTMLElement} group with a select; hidden while there is no choice.
   * @param {(topic: string) => void} choose called with the topic of the robot that is chosen.
   */
  constructor(group, choose) {
    this.group = group;
    this.select = group.querySelector("select");
    this.select.addEventListener("pointerdown", () => (this.pointed = true));
    this.select.addEventListener("keydown", () => (this.pointed = false));
    this.select.addEventListener("change", () => {
      choose(this.select.value);
      // The keys drive again, unless they choose: their next press must not drive the new robot.
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

  /** The server refused the choice. */
  refuse() {
    this.select.value = this.topic;
  }
}

/** The robot that is steered, by its namespace and its description, or else by its topic. */
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
    // The list offers what fits the text in the field: an empty field offers all.
    this.input.addEventListener("focus", () => this.input.select());
  }

  /** Show why the server refused a topic; the field shows the one that is steered. */
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
   *   hand, by axis; null is as the controller has it.
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

  /** Send what was entered into one field, with the other limits as they are. */
  enter(axis, value) {
    // A state that was sent before the last entry arrived does not have it.
    const confirmed = performance.now() - this.entered > CONFIRM_MS;
    this.entry = { ...(confirmed ? this.chosen : this.entry), [axis]: value };
    this.entered = performance.now();
    this.choose(this.entry);
  }

  /** Show the server's state; a server that was restarted is sent what it has lost. */
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

  /** The connection is lost: the next state may be of a server that was restarted. */
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
      this.hint.refuse(`${typed} refused: ${error.message}`);
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
    const most = `${text(ceiling)} ${this.unit}`;
    if (!from) return `No limit known: at most ${most}.`;
    return chosen > ceiling ? `Held to ${most} by ${from}.` : "";
  }
}

/** The sentence beside a field: why an entry was refused, until the next one, or a warning. */
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
 * The limit that a field says, m/s or rad/s, with a point or a comma; null for an empty field.
 * @throws {RangeError} with what would be right.
 */
export function limitOf(typed) {
  if (typed === "") return null;
  if (!NUMBER.test(typed)) throw new RangeError("write a number, such as 0.5.");
  const value = Number(typed.replace(",", "."));
  if (value === 0 || typed.startsWith("-")) throw new RangeError("a limit is above zero.");
  if (!Number.isFinite(value)) throw new RangeError("the number is too large.");
  return value;
}

function isEmpty(chosen) {
  return Object.values(chosen).every((value) => value === null);
}

/** What was chosen by hand, of this tab; null where the browser keeps nothing. */
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
    // Storage is turned off: a restart of the server and a reload of the page lose the limits.
  }
}

function text(value) {
  return String(Number(value.toPrecision(6)));
}
