/** What the robot's drive can do: turn, also drive sideways, or steer. The page has its controls. */

import { write } from "./elements.js";
import { share } from "./readout.js";

const STICKS = {
  turns: "The left stick drives and turns, and the right one turns, too.",
  strafes: "The left stick drives forward and sideways, and the right one turns.",
  steers: "The left stick drives and steers, and the right one steers, too.",
};

export class Drive {
  /**
   * @param {{axis: HTMLElement, sticks: HTMLElement}} places the horizontal slider, with a button
   *   named sideways and a note, and what says that a gamepad drives.
   * @param {import("./command_sender.js").CommandSender} sender
   * @param {() => void} letGo called when a held control would mean something else from now on.
   */
  constructor({ axis, sticks }, sender, letGo) {
    this.axis = axis;
    this.sticks = sticks;
    this.sender = sender;
    this.letGo = letGo;
    this.button = axis.querySelector("[name=sideways]");
    this.button.addEventListener("click", () => this.choose(!sender.sideways));
  }

  /** Show a state of the server. */
  show({ limits, least_radius: radius }) {
    write(this.axis.querySelector("small"), `least radius ${radius.toFixed(2)}\u00a0m`);
    const kind = limits.lateral > 0 ? "strafes" : radius > 0 ? "steers" : "turns";
    if (kind === this.kind) return;
    this.kind = document.body.dataset.drive = kind;
    this.sticks.title = STICKS[kind];
    this.choose(false);
  }

  /** Have the horizontal axis of the pad and of the sliders drive sideways, or turn. */
  choose(sideways) {
    this.letGo();
    this.sender.sideways = sideways;
    this.button.ariaPressed = sideways;
    const turning = this.kind === "steers" ? "Steering" : "Angular speed";
    const name = sideways ? "Lateral speed" : turning;
    this.axis.ariaLabel = name;
    this.axis.querySelector("input").ariaLabel = `${name}, share of its limit, left positive`;
    this.axis.querySelector("[name=zero]").ariaLabel = `${name} 0`;
  }

  /** The share of a command along the horizontal axis. */
  across({ command, limits, least_radius: radius }) {
    if (this.sender.sideways) return share(command.lateral, limits.lateral);
    if (!radius) return share(command.angular, limits.angular);
    // A robot that stands steers, too: no command says so, but the control that is held.
    if (this.sender.holder) return this.sender.shares.angular;
    return share(command.angular * radius, command.linear);
  }
}
