/**
 * Runs in Rerun's page before its own scripts: it lets a page that draws slowly, such as without a
 * graphics card, keep up with its data.
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
   * Drawing time without a graphics card is proportional to the number of pixels. A picture gets as
   * many as can be drawn in time, and the browser enlarges it.
   */
  class Resolution {
    static MAX_PIXELS = 1.5e6;
    static MIN_RATIO = 0.6; // pixels of the picture per pixel of the page: text stays legible
    static SLOW = 400; // ms for a picture
    static WANTED = 250;
    static FAST = 150;
    static PICTURES = 4; // number of pictures that have to be slow, or fast

    constructor() {
      this.most = Resolution.MAX_PIXELS;
      this.times = [];
      const ratio = Object.getOwnPropertyDescriptor(window, "devicePixelRatio").get;
      const fitting = () => Math.sqrt(this.most / (window.innerWidth * window.innerHeight));
      Object.defineProperty(window, "devicePixelRatio", {
        get: () => Math.min(ratio.call(window), Math.max(Resolution.MIN_RATIO, fitting())),
      });
      // Without this, Rerun sizes its canvas by the screen's pixels instead of the ratio.
      delete ResizeObserverEntry.prototype.devicePixelContentBoxSize;
      const { observe } = ResizeObserver.prototype;
      this.apply = () => {};
      const resolution = this;
      ResizeObserver.prototype.observe = function (...target) {
        resolution.apply = () => {
          this.unobserve(target[0]);
          observe.apply(this, target); // this reports the size again
        };
        observe.apply(this, target);
      };
    }

    /** Note the drawing time of a picture, ms. */
    fit(time) {
      this.times.push(time);
      if (this.times.length < Resolution.PICTURES) return;
      const least = Math.min(...this.times);
      const most = Math.max(...this.times);
      this.times = [];
      const pixels = window.innerWidth * window.innerHeight * window.devicePixelRatio ** 2;
      if (least > Resolution.SLOW) this.most = (pixels * Resolution.WANTED) / least;
      else if (most < Resolution.FAST) this.most = Math.min(1.5 * pixels, Resolution.MAX_PIXELS);
      else return;
      this.apply();
    }
  }

  /**
   * Chromium queues the commands of several pictures, which would be old when they are seen. The next
   * picture is only begun when the previous one is drawn.
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
      if (this.end) gl.deleteSync(this.end); // from another callback of the same frame
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
   * In each frame Rerun spends 10 ms on reading data, however long it takes to draw
   * (rerun-io/rerun#7678). With two frames a second that is less than a moving robot sends, and the
   * page would fall further behind with every frame. Rerun measures the 10 ms with performance.now():
   * here that clock runs slower within a slow frame, so that reading may take half as long as the
   * previous frame. A page with at least 50 frames a second is not changed.
   */
  const READING = 10; // ms of a frame, by Rerun's clock
  const SHARE = 0.5; // share of a frame for reading
  const LONGEST = 2000; // ms; in a longer frame the tab was hidden
  const now = performance.now.bind(performance);
  const request = window.requestAnimationFrame.bind(window);
  window.drawnInSoftware = drawnInSoftware(); // also for view_frame.js
  const picture = window.drawnInSoftware ? new Picture() : null;
  let frame = 0; // when the current one began, ms
  let slowness = 1;
  let start = null; // start of the running callback, ms

  performance.now = () => (start === null ? now() : start + (now() - start) / slowness);

  window.requestAnimationFrame = (draw) =>
    request((time) => {
      if (time !== frame) { // otherwise another callback of the same frame
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
