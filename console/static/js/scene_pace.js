// In the scene's page, before viser's own script: what it draws must not hold up the hand. The page around it shares
// its thread, and a clutch that is not heard for 0.3 s lets go. Without a graphics card a browser waits, on that
// thread, until the picture that it is to show has been computed. So the scene is drawn beside the screen, is put on it
// once it is finished, and is drawn anew after a rest as long as it took; where it is slow its resolution falls.

(() => {
  const asked = new URLSearchParams(location.search);
  if (!asked.has("fixedDpr")) return; // full drawing: for graphics cards
  const MOST = Number(asked.get("fixedDpr"));
  const STILL = 1; // of what stands still
  const LEAST = 0.35;
  const SLOW_MS = 45;
  const FAST_MS = 15;
  const STEP = 1.25;
  const EACH = 8; // pictures between two changes of the resolution
  const POLL_MS = 4;
  const REST_MS = 400; // without a new picture: then one is drawn in the resolution of the screen
  const LONGEST_MS = 1000; // a picture that is never said to be finished

  // A framebuffer of our own in the place of the screen's.
  class Beside {
    constructor(gl) {
      this.gl = gl;
      this.drawn = false;
      this.size = "";
      this.bind = gl.bindFramebuffer.bind(gl);
      this.own = gl.createFramebuffer();
      this.colour = gl.createRenderbuffer();
      this.depth = gl.createRenderbuffer();
      this.drawing = this.reading = this.own;
      this.fit();
      gl.bindFramebuffer = (target, framebuffer) => {
        const wanted = framebuffer ?? this.own;
        if (target !== gl.READ_FRAMEBUFFER) this.drawing = wanted;
        if (target !== gl.DRAW_FRAMEBUFFER) this.reading = wanted;
        this.bind(target, wanted);
      };
      const drawBuffers = gl.drawBuffers.bind(gl);
      gl.drawBuffers = (buffers) => drawBuffers(buffers.map((buffer) => (buffer === gl.BACK ? gl.COLOR_ATTACHMENT0 : buffer)));
      this.clear = gl.clear.bind(gl);
      gl.clear = (mask) => {
        this.drawn = true;
        this.clear(mask);
      };
    }

    // The screen may have another size now.
    fit() {
      const { gl } = this;
      const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
      if (this.size === `${width} ${height}`) return;
      this.size = `${width} ${height}`;
      this.bind(gl.FRAMEBUFFER, this.own);
      for (const [buffer, format, place] of [
        [this.colour, gl.RGBA8, gl.COLOR_ATTACHMENT0],
        [this.depth, gl.DEPTH24_STENCIL8, gl.DEPTH_STENCIL_ATTACHMENT],
      ]) {
        gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
        gl.renderbufferStorage(gl.RENDERBUFFER, format, width, height);
        gl.framebufferRenderbuffer(gl.FRAMEBUFFER, place, gl.RENDERBUFFER, buffer);
      }
      gl.bindRenderbuffer(gl.RENDERBUFFER, null);
      this.restore();
    }

    restore() {
      this.bind(this.gl.READ_FRAMEBUFFER, this.reading);
      this.bind(this.gl.DRAW_FRAMEBUFFER, this.drawing);
    }

    // Put the finished picture on the screen.
    present() {
      const { gl } = this;
      const [width, height] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
      if (this.size !== `${width} ${height}`) return; // of the size before: the next one follows
      const cut = gl.isEnabled(gl.SCISSOR_TEST);
      if (cut) gl.disable(gl.SCISSOR_TEST);
      this.bind(gl.READ_FRAMEBUFFER, this.own);
      this.bind(gl.DRAW_FRAMEBUFFER, null);
      this.clear(gl.COLOR_BUFFER_BIT); // else the browser would clear it at the next drawing, before it is shown
      gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
      if (cut) gl.enable(gl.SCISSOR_TEST);
      this.restore();
    }
  }

  let gl = null;
  let beside = null;
  const getContext = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, options) {
    if (kind !== "webgl2") return getContext.call(this, kind, options);
    // smoothed edges are four times the work, and a kept picture is a copy more
    const context = getContext.call(this, kind, { ...options, antialias: false, preserveDrawingBuffer: false });
    if (this.isConnected && context && gl !== context) {
      gl = context;
      beside = new Beside(gl);
    }
    return context;
  };

  const request = window.requestAnimationFrame.bind(window);
  let waiting = new Map();
  let last = 0;
  let drawing = false;
  let scale = MOST;
  let times = [];
  let resting = null;
  let sharp = false;

  const setScale = (ratio) => window.__viserTestpoints?.devSettings.set({ fixedDpr: ratio }); // viser's own switch; its version is pinned

  window.requestAnimationFrame = (callback) => {
    last += 1;
    waiting.set(last, callback);
    if (!drawing) {
      drawing = true;
      clearTimeout(resting);
      request(draw);
    }
    return last;
  };
  window.cancelAnimationFrame = (number) => waiting.delete(number); // the browser's numbers are not ours

  function draw(time) {
    const began = performance.now();
    const now = waiting;
    waiting = new Map();
    beside?.fit();
    for (const callback of now.values()) {
      try {
        callback(time);
      } catch (error) {
        reportError(error); // one that fails stops none of the others
      }
    }
    if (!beside?.drawn || gl.isContextLost()) {
      next();
      return;
    }
    beside.drawn = false;
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    setTimeout(finish, POLL_MS, began, fence);
  }

  function finish(began, fence) {
    const took = performance.now() - began;
    if (took < LONGEST_MS && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
      setTimeout(finish, POLL_MS, began, fence);
      return;
    }
    setTimeout(next, Math.min(took, LONGEST_MS));
    gl.deleteSync(fence);
    beside.present();
    adapt(took);
  }

  function next() {
    drawing = waiting.size > 0;
    if (drawing) request(draw);
    else if (!sharp) resting = setTimeout(rest, REST_MS);
  }

  // What stands still is drawn once more, sharply; what moves next is drawn as before.
  function rest() {
    sharp = true;
    setScale(STILL);
  }

  function adapt(took) {
    if (sharp) {
      if (waiting.size > 0) {
        sharp = false;
        setScale(scale);
      }
      return;
    }
    times.push(took);
    if (times.length < EACH) return;
    const middle = times.sort((a, b) => a - b)[EACH / 2];
    times = [];
    const wanted = middle > SLOW_MS ? scale / STEP : middle < FAST_MS ? scale * STEP : scale;
    scale = Math.min(MOST, Math.max(LEAST, wanted));
    setScale(scale);
  }
})();
