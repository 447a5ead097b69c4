/**
 * Runs in Rerun's page before its own scripts: it keeps up where it draws slowly, such as without a
 * graphics card.
 */

/**
 * In each frame Rerun reads what has come in for 10 ms, however long it takes to draw
 * (rerun-io/rerun#7678). With two frames a second that is less than a moving robot sends, and the
 * page would be further behind with every frame. The 10 ms are counted by performance.now(): here
 * that clock runs slower within a slow frame, so that they last for half of the frame before. A page
 * with 50 frames a second and more is left as it is.
 */
(() => {
  const READING = 10; // ms of a frame, by Rerun's clock
  const SHARE = 0.5; // of a frame, for reading
  const LONGEST = 2000; // ms; more was no frame: the tab was hidden
  const now = performance.now.bind(performance);
  const request = window.requestAnimationFrame.bind(window);
  let frame = 0; // when the current one began, ms
  let slowness = 1;
  let start = null; // of the callback that runs now, ms

  performance.now = () => (start === null ? now() : start + (now() - start) / slowness);

  window.requestAnimationFrame = (draw) =>
    request((time) => {
      if (time !== frame) { // else another callback of the same frame
        slowness = Math.max(1, (SHARE * Math.min(time - frame, LONGEST)) / READING);
        frame = time;
      }
      start = now();
      try {
        draw(time);
      } finally {
        start = null;
      }
    });
})();

/**
 * A picture that the processor draws takes as long as it has pixels. On fine or large screens it
 * gets fewer than the screen has, and the browser enlarges it.
 */
(() => {
  const MOST = 1.5e6; // pixels
  const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

  function drawnInSoftware() {
    const context = document.createElement("canvas").getContext("webgl2");
    if (!context) return false;
    const names = context.getExtension("WEBGL_debug_renderer_info");
    const renderer = context.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER);
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return SOFTWARE.test(renderer);
  }

  window.drawnInSoftware = drawnInSoftware(); // also for view_frame.js
  if (!window.drawnInSoftware) return;
  const ratio = Object.getOwnPropertyDescriptor(window, "devicePixelRatio").get;
  const most = () => Math.sqrt(MOST / (window.innerWidth * window.innerHeight));
  Object.defineProperty(window, "devicePixelRatio", {
    get: () => Math.min(ratio.call(window), most()),
  });
  // Rerun then makes its canvas by the ratio, not as the screen's pixels are.
  delete ResizeObserverEntry.prototype.devicePixelContentBoxSize;
})();
