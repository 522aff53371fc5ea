// The surface of an object's best method, to turn.
const relief = {
  look: { mode: "matt", light: [-0.45, 0.5, 0.74], exposure: 1, gloss: 0, sharpness: 40, raking: 12 },

  start() {
    const canvas = at("surface"),
      gl = glOf(canvas);
    if (!gl) return false;
    this.surface = new Surface(gl);
    gl.clearColor(0.85, 0.87, 0.89, 1); // a lit surface is white
    canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      if (e.buttons) this.turn(e.movementX / 120, e.movementY / 120);
    });
    canvas.addEventListener(
      "wheel",
      (e) => {
        e.preventDefault();
        this.surface.zoom = Math.max(0.3, Math.min(8, this.surface.zoom * Math.exp(-e.deltaY / 600)));
        this.draw();
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (!step) return;
      e.preventDefault();
      this.turn(...step);
    });
    return true;
  },

  turn(x, y) {
    this.surface.turn += x;
    this.surface.tilt = Math.max(-1.5, Math.min(1.5, this.surface.tilt + y));
    this.draw();
  },

  show(s, tile) {
    // s: heights as bench/page/layers.py has them; tile: the method's normals
    const canvas = at("surface"),
      said = at("surface-said");
    canvas.parentElement.hidden = !s;
    if (!s) return;
    if (!this.surface && !this.start()) {
      said.textContent = "The surface needs WebGL 2, which this browser does not offer.";
      return;
    }
    said.textContent = `Surface integrated from the normals of ${s.method}. Drag or use the arrow keys to turn it, the wheel to zoom.`;
    const { width: w, height: h } = s,
      level = new Uint16Array(bytesOfText(s.levels).buffer);
    this.surface.shape(
      w,
      h,
      Float32Array.from(level, (v) => (v ? ((v - 1) / 65534 - 0.5) * s.range : NaN)),
    );
    this.size = [tile.w - 2, tile.h - 2];
    this.surface.normals(
      ...this.size,
      Float32Array.from(tile.values, (v) => v / data.unit),
    );
    Object.assign(this.surface, { turn: 0.6, tilt: 0.35, zoom: 1 });
    this.draw();
    document.body.dataset.surface = String(this.surface.count / 3);
  },

  draw() {
    const { gl } = this.surface,
      { drawingBufferWidth: w, drawingBufferHeight: h } = gl;
    gl.clear(gl.COLOR_BUFFER_BIT);
    this.surface.draw({ x: 0, y: 0, w, h }, this.look, false, this.size);
  },
};
