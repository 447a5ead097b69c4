/** What the parts of the page do with its elements. */

/** Set an element's text, if it is another one: screen readers speak every change. */
export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

export function make(tag, properties = {}) {
  return Object.assign(document.createElement(tag), properties);
}

const contents = new WeakMap(); // JSON of what an element has been filled with

/** Fill an element with one that `make` gives for each item; false if it has them already. */
export function fill(element, items, make) {
  const text = JSON.stringify(items);
  if (contents.get(element) === text) return false;
  contents.set(element, text);
  element.replaceChildren(...items.map(make));
  return true;
}

/** Enter applies the value, as leaving the field does, and gives the keys back to driving. */
export function onEnterLeave(input) {
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") input.blur();
  });
}
