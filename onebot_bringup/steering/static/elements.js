/** Helpers for the page's elements. */

/** Set an element's text if it differs: screen readers speak every change. */
export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

export function make(tag, properties = {}) {
  return Object.assign(document.createElement(tag), properties);
}

const contents = new WeakMap(); // JSON of the items in an element

/** Fill an element with the result of `make` for each item; return false if it has them already. */
export function fill(element, items, make) {
  const text = JSON.stringify(items);
  if (contents.get(element) === text) return false;
  contents.set(element, text);
  element.replaceChildren(...items.map(make));
  return true;
}

/** Let Enter apply the value, as leaving the field does, and give the keys back to driving. */
export function onEnterLeave(input) {
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") input.blur();
  });
}
