/** The robot's Rerun view, in a frame of its own on this page's origin. */

const NOTE_FOR = 30000; // ms; about as long as it takes to catch up
const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

/** Whether pictures are drawn by the processor: then Rerun falls behind what comes in. */
function drawnInSoftware() {
  const context = document.createElement("canvas").getContext("webgl2");
  if (!context) return false;
  const names = context.getExtension("WEBGL_debug_renderer_info");
  const renderer = context.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER);
  context.getExtension("WEBGL_lose_context")?.loseContext();
  return SOFTWARE.test(renderer);
}

export class View {
  /**
   * @param {HTMLElement} place holds the frame, and a sentence to be seen while there is none.
   * @param {import("./command_sender.js").CommandSender} sender
   */
  constructor(place, sender) {
    this.place = place;
    this.sender = sender;
    this.address = null;
    this.frame = null;
    this.note = place.querySelector("#slow");
    this.noteEnds = undefined;
  }

  /** Show the view at an address of this server, or none. */
  show(address) {
    if (address === this.address) return;
    this.address = address;
    this.frame?.remove();
    this.frame = null;
    this.place.classList.toggle("empty", !address);
    this.explain(false);
    if (address) this.load(address);
  }

  /** Nothing in the frame reconnects by itself: load it again next time. */
  forget() {
    this.address = undefined;
  }

  load(address) {
    this.frame = document.createElement("iframe");
    this.frame.title = "The robot in Rerun";
    this.frame.src = address;
    this.frame.addEventListener("load", () => this.loaded(this.frame.contentWindow));
    this.place.append(this.frame);
  }

  /** Say for a while why the view is behind, or no longer. */
  explain(behind) {
    clearTimeout(this.noteEnds);
    this.note.hidden = !behind;
    if (behind) this.noteEnds = setTimeout(() => this.explain(false), NOTE_FOR);
  }

  /** Hand the keys from the frame back to the page. */
  giveBackFocus() {
    this.frame?.blur();
    window.focus();
  }

  loaded(inside) {
    this.explain(drawnInSoftware());
    // Keys pressed in the frame stay there; but the space bar stops the robot everywhere.
    const stop = (event) => {
      if (event.code !== "Space") return;
      event.preventDefault();
      event.stopImmediatePropagation();
      if (event.type === "keydown" && !event.repeat) this.sender.stop();
    };
    inside.addEventListener("keydown", stop, { capture: true });
    inside.addEventListener("keyup", stop, { capture: true });
    // Rerun's page takes the focus as it starts, before anybody pointed at it or went to it.
    let asked = false;
    const ask = (event) => (asked ||= event.type === "pointerdown" || event.code === "Tab");
    inside.addEventListener("pointerdown", ask, { capture: true });
    window.addEventListener("keydown", ask, { capture: true });
    inside.addEventListener("focus", () => asked || this.giveBackFocus(), { capture: true });
    if (document.activeElement === this.frame) this.giveBackFocus();
  }
}
