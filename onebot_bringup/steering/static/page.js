/** The steering page: connects all inputs to the command sender, and shows the server's state. */

import { Braking } from "./braking.js";
import { Camera } from "./camera.js";
import { Connection } from "./connection.js";
import { Drive } from "./drive.js";
import { write } from "./elements.js";
import { Gamepads } from "./gamepad.js";
import { Joints } from "./joints.js";
import { Keys } from "./keys.js";
import { GroundMap } from "./map.js";
import { Displays, Parameters } from "./panels.js";
import { Pad } from "./pad.js";
import { Readout, share } from "./readout.js";
import { Limits, nameOf, Robot, Topic } from "./settings.js";
import { Sliders } from "./sliders.js";
import { Stop } from "./stop.js";
import { Tools } from "./tools.js";
import { showLegend, View } from "./view.js";
import { CommandSender } from "./command_sender.js";

const MESSAGE_MS = 6000;
const SLOW_MS = 500; // shorter hitches of the network or the browser are not reported
const TOO_SLOW = "The connection is too slow to drive: the robot stays stopped until it is faster.";
const UNSEEN = "Stopped: no sign that the control is still held. Let go and press again.";
const element = (id) => document.getElementById(id);

const connection = new Connection({ up, down, message: receive });
const sender = new CommandSender(connection, showHolder, () => notify(UNSEEN));
const stop = new Stop(element("stop"), sender, letGo);
const pad = new Pad(element("pad"), sender);
const sliders = new Sliders({ linear: element("linear"), across: element("angular") }, sender);
const joints = new Joints(element("joints"), document.querySelector("[name=joints]"), sender);
const inputs = [pad, sliders, joints, new Keys(sender), new Gamepads(sender, stop)];
const robot = new Robot(element("robot"), choose);
const topic = new Topic(element("topic"), choose);
const limits = new Limits(
  {
    linear: element("linear-field"),
    angular: element("angular-field"),
    lateral: element("lateral-field"),
  },
  (chosen) => connection.send({ type: "limits", ...chosen }),
);
const drive = new Drive({ axis: element("angular"), sticks: element("sticks") }, sender, letGo);
const readout = new Readout(element("readout"));
const braking = new Braking(element("braking"));
const camera = new Camera(element("camera"));
const view = new View(element("view"), stop);
const map = new GroundMap(element("ground"), (tool, place) => tools.publish(tool, place));
const panels = {
  displays: new Displays(element("displays")),
  parameters: new Parameters(element("parameters")),
  joints,
};
const tools = new Tools(element("tools"), map, panels, notify);

enable(false);
// Without the focus, the release of a key or a button would not be received.
window.addEventListener("blur", letGo);
window.addEventListener("pagehide", letGo);
document.addEventListener("visibilitychange", () => document.hidden && letGo());
document.addEventListener("freeze", letGo);
// Alt, Meta (macOS reports no keyup of other keys meanwhile) and F10 open menus.
window.addEventListener(
  "keydown",
  (event) => (event.altKey || event.metaKey || event.code === "F10") && letGo(),
  { capture: true },
);
// A finger that rests on a control opens a menu, which would end the press.
window.addEventListener(
  "contextmenu",
  (event) => event.target.closest?.("#pad, #stop, .axis") && event.preventDefault(),
  { capture: true },
);
// A menu, a list or a drag takes the keys, too, unless its default is prevented.
for (const type of ["contextmenu", "dragstart"]) {
  window.addEventListener(type, (event) => event.defaultPrevented || letGo());
}
for (const type of ["pointerdown", "focusin"]) {
  window.addEventListener(type, ({ target }) => target.closest?.("select") && letGo());
}
// After a click in the view, its frame has the keys until the mouse returns.
document.querySelector("aside").addEventListener("pointerenter", () => {
  if (framed()) view.giveBackFocus();
});
for (const type of ["focus", "blur", "focusin"]) window.addEventListener(type, showFocus);

/** Steer another topic; the server stops the previous robot. */
function choose(name) {
  letGo();
  sender.drop();
  connection.send({ type: "topic", topic: name });
}

function letGo() {
  for (const input of inputs) input.cancel();
}

function up() {
  document.body.dataset.connection = "up";
  enable(true);
  write(element("connection"), "Connected");
  notify("");
}

function down(reason) {
  letGo();
  document.body.dataset.connection = "down";
  document.body.dataset.driver = "nobody";
  enable(false);
  for (const input of [pad, sliders]) input.show(0, 0);
  joints.forget();
  readout.forget();
  braking.forget();
  camera.forget();
  limits.forget();
  write(element("connection"), "Connection lost");
  write(element("driver"), "");
  notify(reason || "Connection lost: the robot stops by itself. Reconnecting …", Infinity);
}

function enable(yes) {
  sender.enabled = yes;
  const parts = document.querySelectorAll(
    "#steer :is(input, button):not(#stop), #joints input, #settings, #robot select",
  );
  for (const part of parts) part.disabled = !yes;
  // Not "disabled", which would take the focus: Enter must stop again once the connection is back.
  element("stop").setAttribute("aria-disabled", !yes);
}

function receive(message) {
  if (message.type === "error") {
    // After a rejected message, the server ignores commands until a release.
    sender.drop();
    connection.send({ type: "release" });
    if (message.about === "topic") {
      topic.refuse(message.message);
      robot.refuse();
    } else notify(message.message);
  } else if (message.type === "state") {
    sender.update(message);
    drive.show(message);
    topic.show(message);
    robot.show(message);
    showTitle(message);
    limits.show(message);
    readout.show(message);
    braking.show(message);
    const { command, limits: max } = message;
    for (const input of [pad, sliders]) {
      input.show(share(command.linear, max.linear), drive.across(message));
    }
    joints.show(message);
    if (message.joints.length === 0 && joints.isOpen) tools.toggle("");
    showWhetherItStands(message);
    view.show(message.view);
    showLegend(element("legend"), message.legend);
    camera.show(message);
    showDriver(message);
    showSlow(message.late || connection.overdue);
  }
}

/** For a robot that has joints and does not drive, hide the controls for driving. */
function showWhetherItStands({ joints: moved, listeners }) {
  const stands = moved.length > 0 && listeners === 0;
  if (stands && !standing() && !joints.isOpen) tools.toggle("joints");
  if (stands && ["goal", "estimate"].includes(map.tool)) tools.choose("");
  document.body.classList.toggle("stands", stands);
}

function standing() {
  return document.body.classList.contains("stands");
}

function showDriver({ driver, you, pages, locked, wheels_locked, others, navigation }) {
  document.body.dataset.driver = you ? "you" : driver ? "other" : "nobody";
  const drives = standing() ? "moves it" : "drives";
  const unlocks = wheels_locked ? "drive" : "move a joint";
  const nobody = locked ? `Locked: ${unlocks} to unlock` : `Nobody ${drives}`;
  const yours = standing() ? "You move it" : "You drive";
  const alone = navigation ? `Navigator: ${navigation}` : nobody;
  const words = [you ? yours : driver ? `Another page ${drives}` : locked ? nobody : alone];
  if (pages > 1) words.push(`${pages} pages open`);
  if (others.length) words.push(`commands also from ${others.join(", ")}`);
  write(element("driver"), words.join(" · "));
  element("driver").classList.toggle("locked", locked);
}

let inTime = performance.now(); // when the connection was last fast enough
let slowShown = false;
function showSlow(slow) {
  if (!slow) inTime = performance.now();
  const show = performance.now() - inTime > SLOW_MS;
  if (show !== slowShown) notify(show ? TOO_SLOW : "", Infinity);
  slowShown = show;
}

/** The title distinguishes the pages of several robots. */
function showTitle(state) {
  const name = nameOf(state);
  write(document.querySelector("h1 span"), name);
  const title = `${name} – Steering`;
  if (document.title !== title) document.title = title;
}

function showHolder(holder) {
  document.body.dataset.hand = holder ? holder.label : "";
}

function framed() {
  return document.activeElement?.tagName === "IFRAME";
}

function showFocus() {
  document.body.classList.toggle("keys-away", framed());
}

let fading;
/** Show a sentence for a while; "" hides it. */
function notify(sentence, duration = MESSAGE_MS) {
  clearTimeout(fading);
  write(element("message"), sentence);
  if (sentence && duration !== Infinity) fading = setTimeout(() => notify(""), duration);
}
