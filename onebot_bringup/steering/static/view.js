/**
 * The robot's Rerun view, in a frame with its own process: however long Rerun takes to draw, this
 * page and its controls keep working. view_frame.js sends the frame's messages.
 */

import { fill, make } from "./elements.js";

const NOTE_FOR = 30000; // ms; about the time to catch up
const RELOAD_AFTER = 2000; // ms
const ISOLATES_SANDBOXES = /Chrome\/(?!.*Mobile)/; // other browsers isolate sites at most

/** The first address with a view: a tunnel may lead one of loopback's names elsewhere. */
async function findView(addresses) {
  for (const address of addresses) {
    const answer = await fetch(address, { method: "HEAD", cache: "no-store" }).catch(() => null);
    if (answer?.ok) return address;
  }
  return null;
}

const KINDS = {
  trail: (name) => `${name}: trail`,
  covariance: (name) => `${name}: covariance (ellipse: position, sector: heading)`,
};

/**
 * Show a legend of the lines in the view; Rerun has legends only in plots.
 * @param {HTMLUListElement} list
 * @param {{kind: string, name: string, color: string}[]} entries
 */
export function showLegend(list, entries) {
  list.hidden = entries.length === 0;
  fill(list, entries, legendItem);
}

function legendItem({ kind, name, color }) {
  const textContent = KINDS[kind]?.(name) ?? `${name}: ${kind}`;
  const item = make("li", { className: kind, textContent });
  item.style.setProperty("--color", color);
  return item;
}

export class View {
  /**
   * @param {HTMLElement} place holds the frame, and a sentence to show while there is none.
   * @param {import("./stop.js").Stop} stop
   */
  constructor(place, stop) {
    this.place = place;
    this.release = () => stop.release("view");
    this.addresses = null;
    this.frame = null;
    this.ended = false;
    this.loadedAt = -Infinity;
    this.isolated = true; // whether the frame has its own process
    this.note = place.querySelector("#slow");
    this.noteEnds = undefined;
    this.wanted = false; // whether the user went to the frame with the Tab key
    this.on = {
      shown: ({ behind }) => this.uncover(behind),
      ended: () => (this.ended = true),
      stop: () => stop.press("view"),
      released: this.release,
      focus: () => this.wanted || this.giveBackFocus(),
    };
    window.addEventListener("message", (event) => this.receive(event));
    window.addEventListener("focus", this.release); // a busy frame reports that late
    const want = ({ code }) => (this.wanted = code === "Tab");
    window.addEventListener("keydown", want, { capture: true });
  }

  /**
   * Show the view at one of these addresses, best first, or no view. It is only reloaded if they
   * change, or if its data has ended.
   */
  show(addresses) {
    const same = addresses?.join() === this.addresses?.join();
    if (same && !(this.ended && performance.now() - this.loadedAt > RELOAD_AFTER)) return;
    this.addresses = addresses;
    this.ended = false;
    this.frame?.remove();
    this.frame = null;
    this.release();
    this.place.classList.toggle("empty", !addresses);
    this.place.classList.toggle("loading", Boolean(addresses));
    this.explain(false);
    if (addresses) this.load(addresses);
  }

  async load(addresses) {
    this.loadedAt = performance.now();
    const address = await findView(addresses);
    if (addresses !== this.addresses) return;
    if (!address) {
      this.ended = true;
      return;
    }
    this.isolated =
      new URL(address).host !== location.host || ISOLATES_SANDBOXES.test(navigator.userAgent);
    this.frame = document.createElement("iframe");
    this.frame.title = "The robot in Rerun";
    this.frame.allow = "clipboard-write";
    this.frame.src = address;
    this.place.append(this.frame);
  }

  receive({ source, origin, data }) {
    if (!this.frame || source !== this.frame.contentWindow || origin !== "null") return;
    if (Object.hasOwn(this.on, data?.view)) this.on[data.view](data);
  }

  uncover(behind) {
    if (!this.place.classList.contains("loading")) return;
    this.place.classList.remove("loading");
    this.explain(behind === true);
    this.on.focus(); // an inactive window reports no focus
  }

  /** Show for a while that the view lags behind, or permanently if it can stall this page. */
  explain(behind) {
    clearTimeout(this.noteEnds);
    this.note.hidden = !behind;
    this.note.querySelector("span").hidden = this.isolated;
    if (behind && this.isolated) this.noteEnds = setTimeout(() => this.explain(false), NOTE_FOR);
  }

  /** Move the focus from the frame back to the page. */
  giveBackFocus() {
    this.frame?.blur();
    window.focus();
  }
}
