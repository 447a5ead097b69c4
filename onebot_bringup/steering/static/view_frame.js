/**
 * Runs in the view's frame, before Rerun's own scripts. The frame has its own process and origin; it
 * sends the steering page messages {view: ...}:
 *   shown: the robot's layout is drawn, or Rerun's page shows something other than its progress;
 *     behind: pictures are drawn by the processor, so Rerun falls behind the data
 *   ended: its data has ended, and it will not reconnect
 *   stop: the stop key was pressed
 *   released: the stop key was released, or its release would not be received
 *   focus: the frame took the focus without a click
 */
(() => {
  const SERVICE = "/rerun.sdk_comms.";
  const FRAMES = 4; // from the layout's arrival to its picture; Rerun reads data once per frame
  const page = new URLSearchParams(location.search).get("page");

  function report(what) {
    const message = { view: what, behind: Boolean(window.drawnInSoftware) };
    if (window.parent !== window) window.parent.postMessage(message, page);
  }

  /** Finds the message that activates a layout in a gRPC-web stream of ReadMessagesResponse. */
  class LayoutFinder {
    constructor() {
      this.found = false;
      this.start = []; // start of the current message, with the five bytes of its header
      this.rest = 0; // bytes of the current message to skip
    }

    look(bytes) {
      for (let at = 0; at < bytes.length && !this.found; ) {
        const skipped = Math.min(this.rest, bytes.length - at);
        this.rest -= skipped;
        at += skipped;
        if (at < bytes.length) this.take(bytes[at++]);
      }
    }

    take(byte) {
      this.start.push(byte);
      if (this.start.length < 5) return;
      const [, a, b, c, d, ...content] = this.start;
      const size = ((a * 256 + b) * 256 + c) * 256 + d;
      // Field 1 is a LogMsg, with its size as varint; its field 3 is an activation.
      const end = content.findIndex((value, index) => index > 0 && value < 128);
      if (content.length < size && (end < 0 || content.length < end + 2)) return;
      this.found = content[0] === 0x0a && content[end + 1] === 0x1a;
      this.rest = size - content.length;
      this.start = [];
    }
  }

  function drawn(frames) {
    if (frames > 0) requestAnimationFrame(() => drawn(frames - 1));
    else report("shown");
  }

  /** Return the same response, and watch its data. */
  function watched(response) {
    if (!response.ok || !response.body) return response;
    const reader = response.body.getReader();
    const finder = new LayoutFinder();
    const body = new ReadableStream({
      async pull(controller) {
        const { done, value } = await reader.read().catch((error) => {
          report("ended");
          throw error;
        });
        if (done) {
          report("ended");
          controller.close();
          return;
        }
        controller.enqueue(value);
        if (finder.found) return;
        finder.look(value);
        if (finder.found) drawn(FRAMES);
      },
      cancel: (reason) => reader.cancel(reason),
    });
    return new Response(body, response);
  }

  const fetchAsGiven = window.fetch;
  /** Rerun requests its data from the root of the host; it is below the view's own path. */
  window.fetch = async (resource, options) => {
    const { pathname } = new URL(resource.url ?? resource, location.href);
    if (!pathname.startsWith(SERVICE)) return fetchAsGiven(resource, options);
    const request = new Request(resource, options);
    const { method, headers, signal } = request;
    const body = await request.arrayBuffer();
    return watched(await fetchAsGiven(`.${pathname}`, { method, headers, signal, body }));
  };

  const stop = (event) => {
    if (event.code !== "Space") return;
    event.preventDefault();
    event.stopImmediatePropagation();
    if (!event.repeat) report(event.type === "keydown" ? "stop" : "released");
  };
  window.addEventListener("keydown", stop, { capture: true });
  window.addEventListener("keyup", stop, { capture: true });
  window.addEventListener("blur", () => report("released"));

  // An opaque origin has no storage, and Rerun shows an error if it cannot store settings.
  const items = new Map();
  const localStorage = {
    getItem: (name) => items.get(name) ?? null,
    setItem: (name, value) => void items.set(name, value),
    removeItem: (name) => void items.delete(name),
  };
  Object.defineProperty(window, "localStorage", { value: localStorage });

  // Rerun's page takes the focus when it starts, before any click.
  let pointed = false;
  window.addEventListener("pointerdown", () => (pointed = true), { capture: true });
  window.addEventListener("focus", () => pointed || report("focus"), { capture: true });

  // Rerun reports an old browser, a question on a phone, or a crash in this element.
  document.addEventListener("DOMContentLoaded", () => {
    const text = document.getElementById("center_text");
    const look = () => {
      if (text.classList.contains("visible") && !text.querySelector("#status")) report("shown");
    };
    new MutationObserver(look).observe(text, { attributes: true, childList: true });
    look();
  });
})();
