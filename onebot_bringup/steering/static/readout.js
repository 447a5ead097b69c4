/** The commanded and measured speeds, in numbers and bars, and the odometry. */

import { write } from "./elements.js";

const OLD_S = 1.0; // age after which odometry is no longer live
const UNITS = { linear: "m/s", angular: "rad/s", lateral: "m/s" };

export class Readout {
  /** @param {HTMLElement} root the part of the page that holds the elements with data-show. */
  constructor(root) {
    this.root = root;
    this.fields = {};
    for (const field of root.querySelectorAll("[data-show]")) {
      this.fields[field.dataset.show] = field;
    }
  }

  /** Show a state of the server. */
  show({ command, odometry, limits }) {
    for (const axis of Object.keys(UNITS)) {
      const measured = odometry ? odometry[axis] : null;
      this.number(`${axis}-command`, command[axis], 2);
      this.number(`${axis}-measured`, measured, 2);
      const bar = this.fields[`${axis}-bar`];
      bar.style.setProperty("--command", share(command[axis], limits[axis]));
      bar.style.setProperty("--measured", share(measured, limits[axis]));
      bar.setAttribute("aria-valuenow", share(measured, limits[axis]).toFixed(2));
      bar.setAttribute("aria-valuetext", `${(measured ?? 0).toFixed(2)} ${UNITS[axis]}`);
    }
    for (const name of ["x", "y", "yaw"]) this.number(name, odometry?.[name], 3);
    const degrees = odometry ? (odometry.yaw * 180) / Math.PI : 0;
    this.number("degrees", odometry && degrees, 1);
    this.fields.needle.style.setProperty("--turn", `${-degrees}deg`);
    const old = !odometry || odometry.age > OLD_S;
    this.root.classList.toggle("old", old);
    write(this.fields.source, source(odometry, old));
  }

  /** The connection is lost: nothing is commanded, and the odometry is no longer live. */
  forget() {
    for (const axis of Object.keys(UNITS)) {
      this.number(`${axis}-command`, 0, 2);
      this.fields[`${axis}-bar`].style.setProperty("--command", 0);
    }
    this.root.classList.add("old");
    write(this.fields.source, "connection lost");
  }

  number(name, value, digits) {
    write(this.fields[name], Number.isFinite(value) ? fixed(value, digits) : "–");
  }
}

function source(odometry, old) {
  if (!odometry) return "no odometry yet";
  return old ? `${odometry.topic}, silent for ${odometry.age.toFixed(0)} s` : odometry.topic;
}

/** A value as a share of its limit, -1 to 1; 0 if the limit is 0. */
export function share(value, limit) {
  return Math.max(-1, Math.min(1, (value ?? 0) / limit)) || 0;
}

/** A number as text with a real minus sign, as wide as a plus, and no minus before zero. */
export function fixed(value, digits) {
  const words = value.toFixed(digits);
  return Number(words) === 0 ? words.replace("-", "") : words.replace("-", "\u2212");
}
