/** Adapts the controls to the robot's drive: it turns, also drives sideways, or steers. */

import { write } from "./elements.js";
import { share } from "./readout.js";

const STICKS = {
  turns: "The left stick drives and turns; the right one also turns.",
  strafes: "The left stick drives forward and sideways; the right one turns.",
  steers: "The left stick drives and steers; the right one also steers.",
};

export class Drive {
  /**
   * @param {{axis: HTMLElement, sticks: HTMLElement}} places the horizontal slider, with a button
   *   named sideways and a note, and the text about gamepads.
   * @param {import("./command_sender.js").CommandSender} sender
   * @param {() => void} letGo called before a control changes its meaning.
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
  show({ limits, minimum_radius: radius }) {
    write(this.axis.querySelector("small"), `minimum radius ${radius.toFixed(2)}\u00a0m`);
    const kind = limits.lateral > 0 ? "strafes" : radius > 0 ? "steers" : "turns";
    if (kind === this.kind) return;
    this.kind = document.body.dataset.drive = kind;
    this.sticks.title = STICKS[kind];
    this.choose(false);
  }

  /** Set whether the horizontal axis of the pad and the sliders drives sideways or turns. */
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
  across({ command, limits, minimum_radius: radius }) {
    if (this.sender.sideways) return share(command.lateral, limits.lateral);
    if (!radius) return share(command.angular, limits.angular);
    // A standing robot can steer, too: only the held control shows it, not the command.
    if (this.sender.holder) return this.sender.shares.angular;
    return share(command.angular * radius, command.linear);
  }
}
