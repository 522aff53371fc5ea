// A height map as a surface to turn, in WebGL 2.
const surface = {
  turn: 0.6, tilt: 0.35, zoom: 1, count: 0, gl: null,

  start() {
    const canvas = document.getElementById("surface");
    const gl = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    if (!gl) return false;
    const compile = (kind, text) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      return shader;
    };
    const program = gl.createProgram();
    gl.attachShader(program, compile(gl.VERTEX_SHADER, `#version 300 es
      layout(location = 0) in vec3 place;
      layout(location = 1) in vec3 normal;
      uniform mat3 turned;
      uniform float zoom;
      out vec3 n;
      void main() {
        n = turned * normal;
        vec3 p = turned * place * zoom;
        gl_Position = vec4(p.xy, -p.z * 0.3, 1.0);
      }`));
    gl.attachShader(program, compile(gl.FRAGMENT_SHADER, `#version 300 es
      precision highp float;
      in vec3 n;
      out vec4 colour;
      void main() {
        vec3 m = normalize(n);
        if (!gl_FrontFacing) m = -m;
        float shade = 0.12 + 0.83 * max(dot(m, normalize(vec3(-0.45, 0.5, 0.74))), 0.0);
        colour = vec4(pow(vec3(0.93, 0.91, 0.87) * shade, vec3(1.0 / 1.6)), 1.0);
      }`));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    gl.clearColor(1, 1, 1, 1);
    this.gl = gl;
    this.program = program;
    this.buffers = [gl.createBuffer(), gl.createBuffer(), gl.createBuffer()];
    canvas.addEventListener("pointerdown", (e) => canvas.setPointerCapture(e.pointerId));
    canvas.addEventListener("pointermove", (e) => {
      if (!e.buttons) return;
      this.turn += e.movementX / 120;
      this.tilt = Math.max(-1.5, Math.min(1.5, this.tilt + e.movementY / 120));
      this.draw();
    });
    canvas.addEventListener("wheel", (e) => {
      e.preventDefault();
      this.zoom = Math.max(0.3, Math.min(8, this.zoom * Math.exp(-e.deltaY / 600)));
      this.draw();
    }, { passive: false });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (!step) return;
      e.preventDefault();
      this.turn += step[0];
      this.tilt += step[1];
      this.draw();
    });
    return true;
  },

  async show(s, picture) {
    const canvas = document.getElementById("surface"), said = document.getElementById("surface-said");
    canvas.parentElement.hidden = !s;
    if (!s) return;
    if (!this.gl && !this.start()) { said.textContent = "The surface needs WebGL 2, which this browser does not offer."; return; }
    said.textContent = `Surface integrated from the normals of ${s.method}. Drag or use the arrow keys to turn it, the wheel to zoom.`;
    const raw = Uint8Array.from(atob(s.levels), (c) => c.charCodeAt(0)), level = new Uint16Array(raw.buffer);
    const { width: w, height: h } = s, size = Math.max(w, h);
    const pen = new OffscreenCanvas(w, h).getContext("2d");
    pen.imageSmoothingEnabled = false; // the white around the object must not mix in
    pen.drawImage(await picture, 0, 0, w, h);
    const colours = pen.getImageData(0, 0, w, h).data;
    const places = new Float32Array(3 * w * h), normals = new Float32Array(3 * w * h), corners = [];
    for (let y = 0, i = 0; y < h; y++) for (let x = 0; x < w; x++, i++) {
      if (!level[i]) continue;
      const z = ((level[i] - 1) / 65534 - 0.5) * s.range;
      places.set([(2 * x - w) / size, (h - 2 * y) / size, (2 * z) / size], 3 * i);
      normals.set([0, 1, 2].map((c) => colours[4 * i + c] / 127.5 - 1), 3 * i);
      if (x + 1 < w && y + 1 < h && level[i + 1] && level[i + w]) {
        corners.push(i, i + w, i + 1);
        if (level[i + w + 1]) corners.push(i + 1, i + w, i + w + 1);
      }
    }
    const gl = this.gl;
    [places, normals].forEach((values, k) => {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[k]);
      gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(k);
      gl.vertexAttribPointer(k, 3, gl.FLOAT, false, 0, 0);
    });
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers[2]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(corners), gl.STATIC_DRAW);
    this.count = corners.length;
    this.turn = 0.6; this.tilt = 0.35; this.zoom = 0.9;
    this.draw();
    document.body.dataset.surface = String(this.count / 3);
  },

  draw() {
    const gl = this.gl, a = Math.cos(this.turn), b = Math.sin(this.turn), c = Math.cos(this.tilt), d = Math.sin(this.tilt);
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    // column by column: about the vertical, then towards the viewer
    gl.uniformMatrix3fv(gl.getUniformLocation(this.program, "turned"), false, [a, d * b, -c * b, 0, c, d, b, -d * a, c * a]);
    gl.uniform1f(gl.getUniformLocation(this.program, "zoom"), this.zoom);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
  },
};
