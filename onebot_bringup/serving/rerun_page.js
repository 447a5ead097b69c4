/**
 * Runs in Rerun's page before its own scripts: it keeps up where it draws slowly, such as without a
 * graphics card.
 */
(() => {
  const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;

  function drawnInSoftware() {
    const context = document.createElement("canvas").getContext("webgl2");
    if (!context) return false;
    const names = context.getExtension("WEBGL_debug_renderer_info");
    const renderer = context.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER);
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return SOFTWARE.test(renderer);
  }

  /**
   * A picture that the processor draws takes as long as it has pixels. It gets as many as are drawn
   * in time, and the browser enlarges it.
   */
  class Resolution {
    static MOST = 1.5e6; // pixels
    static LEAST = 0.6; // pixels of the picture for one of the page, in a row: text stays legible
    static SLOW = 400; // ms for a picture
    static WANTED = 250;
    static FAST = 150;
    static PICTURES = 4; // of which all are slow, or fast

    constructor() {
      this.most = Resolution.MOST;
      this.times = [];
      const ratio = Object.getOwnPropertyDescriptor(window, "devicePixelRatio").get;
      const fitting = () => Math.sqrt(this.most / (window.innerWidth * window.innerHeight));
      Object.defineProperty(window, "devicePixelRatio", {
        get: () => Math.min(ratio.call(window), Math.max(Resolution.LEAST, fitting())),
      });
      // Rerun then makes its canvas by the ratio, not as the screen's pixels are.
      delete ResizeObserverEntry.prototype.devicePixelContentBoxSize;
      const { observe } = ResizeObserver.prototype;
      this.apply = () => {};
      const resolution = this;
      ResizeObserver.prototype.observe = function (...target) {
        resolution.apply = () => {
          this.unobserve(target[0]);
          observe.apply(this, target); // which reports the size once more
        };
        observe.apply(this, target);
      };
    }

    /** Note that a picture took so long, ms. */
    fit(time) {
      this.times.push(time);
      if (this.times.length < Resolution.PICTURES) return;
      const least = Math.min(...this.times);
      const most = Math.max(...this.times);
      this.times = [];
      const pixels = window.innerWidth * window.innerHeight * window.devicePixelRatio ** 2;
      if (least > Resolution.SLOW) this.most = (pixels * Resolution.WANTED) / least;
      else if (most < Resolution.FAST) this.most = Math.min(1.5 * pixels, Resolution.MOST);
      else return;
      this.apply();
    }
  }

  /**
   * Chromium takes the commands of some pictures ahead, which were then old before they are seen.
   * The next picture is begun when the one before is drawn.
   */
  class Picture {
    constructor() {
      const picture = this;
      const { getContext } = HTMLCanvasElement.prototype;
      HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
        const context = getContext.call(this, kind, ...options);
        if (kind === "webgl2") picture.context = context;
        return context;
      };
      this.context = this.end = null;
      this.begun = 0; // ms
      this.resolution = new Resolution();
    }

    begin() {
      const gl = this.context;
      if (!gl) return;
      if (this.end) gl.deleteSync(this.end); // of another callback of the same frame
      this.end = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
      gl.flush();
      this.begun = performance.now();
    }

    isDrawn() {
      const gl = this.context;
      if (!this.end) return true;
      if (gl.getSyncParameter(this.end, gl.SYNC_STATUS) === gl.UNSIGNALED) return false;
      gl.deleteSync(this.end);
      this.end = null;
      this.resolution.fit(performance.now() - this.begun);
      return true;
    }
  }

  /**
   * In each frame Rerun reads what has come in for 10 ms, however long it takes to draw
   * (rerun-io/rerun#7678). With two frames a second that is less than a moving robot sends, and the
   * page would be further behind with every frame. The 10 ms are counted by performance.now(): here
   * that clock runs slower within a slow frame, so that they last for half of the frame before. A
   * page with 50 frames a second and more is left as it is.
   */
  const READING = 10; // ms of a frame, by Rerun's clock
  const SHARE = 0.5; // of a frame, for reading
  const LONGEST = 2000; // ms; more was no frame: the tab was hidden
  const now = performance.now.bind(performance);
  const request = window.requestAnimationFrame.bind(window);
  window.drawnInSoftware = drawnInSoftware(); // also for view_frame.js
  const picture = window.drawnInSoftware ? new Picture() : null;
  let frame = 0; // when the current one began, ms
  let slowness = 1;
  let start = null; // of the callback that runs now, ms

  performance.now = () => (start === null ? now() : start + (now() - start) / slowness);

  window.requestAnimationFrame = (draw) =>
    request((time) => {
      if (time !== frame) { // else another callback of the same frame
        if (picture && !picture.isDrawn()) {
          window.requestAnimationFrame(draw);
          return;
        }
        slowness = Math.max(1, (SHARE * Math.min(time - frame, LONGEST)) / READING);
        frame = time;
      }
      start = now();
      try {
        draw(time);
      } finally {
        start = null;
        picture?.begin();
      }
    });
})();
