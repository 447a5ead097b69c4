/** The fields that say what is steered and how fast: the topic and the limits. */

export class Topic {
  /**
   * @param {HTMLElement} group with an input, a datalist and an output.
   * @param {(topic: string) => void} choose called with what the user enters.
   */
  constructor(group, choose) {
    this.input = group.querySelector("input");
    this.list = group.querySelector("datalist");
    this.note = group.querySelector("output");
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

  /** Show the server's word, but not over what the user is typing. */
  show(state) {
    this.known = state.topic;
    if (document.activeElement !== this.input) this.input.value = state.topic;
    const offered = state.topics.join("\n");
    if (offered !== this.offered) {
      this.offered = offered;
      this.list.replaceChildren(...state.topics.map((topic) => new Option("", topic)));
    }
    const type = state.topic_type.split("/").pop();
    const subscribers = ["no subscriber", "1 subscriber"][state.listeners];
    write(this.note, `${type}, ${subscribers ?? `${state.listeners} subscribers`}`);
    this.note.classList.toggle("warning", state.listeners === 0);
  }
}

export class Limits {
  /**
   * @param {{linear: HTMLInputElement, angular: HTMLInputElement}} inputs in m/s and rad/s.
   * @param {(limits: {linear: number, angular: number}) => void} choose called with new ones.
   */
  constructor(inputs, choose) {
    this.inputs = inputs;
    for (const [name, input] of Object.entries(inputs)) {
      input.addEventListener("change", () => {
        const value = input.valueAsNumber;
        if (Number.isFinite(value) && value > 0) choose({ ...this.known, [name]: value });
        else input.value = text(this.known[name]);
      });
      onEnterLeave(input);
    }
  }

  /** Show the server's word, but not over what the user is typing. */
  show(limits) {
    this.known = limits;
    for (const [name, input] of Object.entries(this.inputs)) {
      if (document.activeElement !== input) input.value = text(limits[name]);
    }
  }
}

/** Enter takes the value up, as leaving the field does, and gives the keys back to driving. */
function onEnterLeave(input) {
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") input.blur();
  });
}

function text(value) {
  return String(Number(value.toFixed(3)));
}

/** Set an element's text, if it is another one: screen readers speak every change. */
export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}
