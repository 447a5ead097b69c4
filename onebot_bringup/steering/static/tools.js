/** The buttons above the view: RViz's tools on the map, and the view's camera. */

import { fixed } from "./readout.js";
import { get, post } from "./requests.js";

const HEIGHT = 3; // of the eye that looks down, m
const COVERS = matchMedia("(max-width: 899px)"); // a panel covers the map; see style.css
const LEAN = 0.03; // share of that height; with 0.01 or straight down, Rerun turns the picture

export class Tools {
  /**
   * @param {HTMLElement} bar with buttons.
   * @param {import("./map.js").GroundMap} map
   * @param {object} panels the panels by their buttons' names; one is open at a time.
   * @param {(sentence: string) => void} notify shows a problem.
   */
  constructor(bar, map, panels, notify) {
    this.bar = bar;
    this.map = map;
    this.panels = panels;
    this.notify = notify;
    bar.addEventListener("click", ({ target }) => this.press(target.closest("button")));
    window.addEventListener("keydown", ({ code }) => code === "Escape" && this.choose(""));
  }

  press(button) {
    if (!button) return;
    const { tool, camera } = button.dataset;
    if (tool) this.choose(this.map.tool === tool ? "" : tool);
    else if (camera) this.look(camera);
    else if (button.name === "map") this.open(!this.map.isOpen);
    else this.toggle(button.name);
  }

  open(yes) {
    if (yes && COVERS.matches) this.toggle("");
    this.map.open(yes);
    this.show();
  }

  toggle(wanted) {
    for (const [name, panel] of Object.entries(this.panels)) {
      panel.open(name === wanted && !panel.isOpen);
    }
    this.show();
  }

  choose(tool) {
    if (tool) this.open(true);
    this.map.choose(tool);
    if (tool) this.map.say(tool === "point" ? "Press, or enter:" : "Press and drag, or enter:");
    this.show();
  }

  show() {
    for (const button of this.bar.querySelectorAll("[aria-pressed]")) {
      const { tool } = button.dataset;
      const pane = this.panels[button.name] ?? this.map;
      const pressed = tool ? tool === this.map.tool : pane.isOpen;
      button.setAttribute("aria-pressed", String(pressed));
    }
  }

  /** Publish a place on the ground; as in RViz, a tool is then deselected. */
  async publish(tool, place) {
    this.choose("");
    try {
      const { topic, subscribers } = await post("click", { tool, ...place });
      this.map.say(published(topic, subscribers, tool, place));
    } catch (error) {
      this.map.say(error.message);
    }
  }

  /** Set the camera of the 3D view. */
  async look(name) {
    this.open(false);
    try {
      const { viewer } = await get("nodes");
      if (!viewer) throw new Error("There is no viewer with a camera to set.");
      const { parameters } = await get("parameters", { node: viewer });
      const known = Object.fromEntries(parameters.map(({ name, value }) => [name, value]));
      const { base, robot } = await get("ground", { frame: known.fixed_frame });
      // Several robots are not in the frame of the view's file, but in the frame above them.
      const place = robot ?? (await get("ground")).robot ?? { x: 0, y: 0 };
      const values = cameras[name](place, linkOf(base, known));
      const { rejected } = await post("parameters", { node: viewer, values });
      for (const reason of Object.values(rejected)) throw new Error(reason);
    } catch (error) {
      this.notify(error.message);
    }
  }
}

/** The parameters of the viewer's camera, in YAML. */
const cameras = {
  top: ({ x, y }) => ({
    "camera.eye": vector(x, y - LEAN * HEIGHT, HEIGHT),
    "camera.target": vector(x, y, 0),
    "camera.follow": "",
  }),
  follow: (_, link) => ({ "camera.eye": "[]", "camera.target": "[]", "camera.follow": link }),
  fit: () => ({ "camera.eye": "[]", "camera.target": "[]", "camera.follow": "" }),
};

const vector = (...numbers) => `[${numbers.map((each) => each.toFixed(3)).join(", ")}]`;

/** A link's name for camera.follow; with several robots, its frame. */
function linkOf(frame, { robots, frame_prefix: prefix = "" }) {
  return robots === "[]" && frame.startsWith(prefix) ? frame.slice(prefix.length) : frame;
}

function published(topic, subscribers, tool, { frame, x, y, yaw }) {
  const turn = tool === "point" ? "" : `, ${fixed((yaw * 180) / Math.PI, 0)}°`;
  const unheard = subscribers ? "" : " It has no subscriber.";
  return `Published ${topic}: x ${fixed(x, 2)} m, y ${fixed(y, 2)} m${turn} in ${frame}.${unheard}`;
}
