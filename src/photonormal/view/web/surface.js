// A height map as a surface to turn, lit like the picture.
class Surface {
  constructor(gl) {
    this.gl = gl;
    this.turn = 0.45;
    this.tilt = 0.3;
    this.zoom = 1;
    this.shift = [0, 0];
    this.count = 0;
    this.program = new Program(
      gl,
      `
      layout(location = 0) in vec3 position;
      uniform mat3 turned;
      uniform vec2 scale, shift, grid; // grid: pixels of the textures
      uniform float unit; // pixels of the textures in a unit of the positions
      out vec2 place;
      void main() {
        vec3 p = turned * position;
        place = (vec2(position.x, -position.y) * unit + 0.5 * grid + 1.0) / (grid + 2.0);
        gl_Position = vec4(p.xy * scale + shift, -p.z * 0.25, 1.0);
      }`,
      `
      uniform sampler2D normals, colour;
      uniform bool coloured;
      in vec2 place;
      out vec4 pixel;
      ${SHADING}
      void main() {
        vec3 n = texture(normals, place).rgb;
        if (dot(n, n) < 0.1) discard;
        n = normalize(n);
        vec3 albedo = coloured && mode != 2 ? texture(colour, place).rgb : vec3(0.9, 0.88, 0.85);
        vec3 c = lit(n, albedo) + 0.05 * albedo;
        pixel = vec4(gl_FrontFacing ? c : 0.4 * c, 1.0);
      }`,
    );
    this.array = gl.createVertexArray();
    gl.bindVertexArray(this.array);
    this.buffers = [gl.createBuffer(), gl.createBuffer()];
    this.textures = { normals: textureOf(gl, true), colour: textureOf(gl, true) };
  }

  // heights: width x height numbers in the grid's own pixels, NaN where there is none; textures hold a rim of one pixel
  shape(width, height, heights) {
    const gl = this.gl,
      size = Math.max(width, height),
      corners = [];
    let low = Infinity,
      high = -Infinity;
    for (const z of heights)
      if (z === z) {
        low = Math.min(low, z);
        high = Math.max(high, z);
      }
    this.middle = (low + high) / 2;
    this.grid = [width, height];
    this.places = new Float32Array(3 * width * height);
    for (let y = 0, i = 0; y < height; y++)
      for (let x = 0; x < width; x++, i++) {
        this.places.set(
          [(2 * x + 1 - width) / size, (height - 2 * y - 1) / size, (2 * (heights[i] - this.middle)) / size],
          3 * i,
        );
        if (x + 1 === width || y + 1 === height) continue;
        const a = heights[i],
          b = heights[i + 1],
          c = heights[i + width],
          d = heights[i + width + 1];
        if (b !== b || c !== c) continue;
        if (a === a) corners.push(i, i + width, i + 1);
        if (d === d) corners.push(i + 1, i + width, i + width + 1);
      }
    this.count = corners.length;
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[0]);
    gl.bufferData(
      gl.ARRAY_BUFFER,
      this.places.map((v) => (v === v ? v : 0)),
      gl.STATIC_DRAW,
    );
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers[1]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(corners), gl.STATIC_DRAW);
  }

  normals(width, height, vectors) {
    // of the texture: width x height vectors and a rim of one pixel
    const gl = this.gl;
    gl.bindTexture(gl.TEXTURE_2D, this.textures.normals);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, width + 2, height + 2, 0, gl.RGB, gl.FLOAT, vectors);
  }

  matrix() {
    // column by column: about the vertical, then towards the viewer
    const a = Math.cos(this.turn),
      b = Math.sin(this.turn),
      c = Math.cos(this.tilt),
      d = Math.sin(this.tilt);
    return [a, d * b, -c * b, 0, c, d, b, -d * a, c * a];
  }

  scales(pane) {
    const fit = (1.5 * this.zoom * Math.min(pane.w, pane.h)) / 2;
    return [fit / (pane.w / 2) / Math.SQRT2, fit / (pane.h / 2) / Math.SQRT2];
  }

  draw(pane, look, coloured, size) {
    // size: pixels of the textures without their rim
    const gl = this.gl,
      m = this.matrix();
    gl.viewport(pane.x, pane.y, pane.w, pane.h);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(pane.x, pane.y, pane.w, pane.h);
    gl.enable(gl.DEPTH_TEST);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.bindVertexArray(this.array);
    this.program.use();
    ["normals", "colour"].forEach((name, k) => {
      gl.activeTexture(gl.TEXTURE0 + k);
      gl.bindTexture(gl.TEXTURE_2D, this.textures[name]);
    });
    this.program.set({
      ...shadingValues(look, [m[2], m[5], m[8]]),
      normals: { int: 0 },
      colour: { int: 1 },
      coloured: { int: coloured ? 1 : 0 },
      turned: m,
      scale: this.scales(pane),
      shift: this.shift,
      grid: size,
      unit: Math.max(...size) / 2,
    });
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);
    gl.disable(gl.SCISSOR_TEST);
  }

  // Where a pixel of the grid is seen: x to the right and y down in the pane, in parts of it; null where there is none.
  project(x, y, pane) {
    const i = 3 * (Math.round(y) * this.grid[0] + Math.round(x)),
      [px, py, pz] = this.places.subarray(i, i + 3),
      m = this.matrix();
    if (!(pz === pz)) return null;
    const [sx, sy] = this.scales(pane);
    return [
      (1 + (m[0] * px + m[3] * py + m[6] * pz) * sx + this.shift[0]) / 2,
      (1 - (m[1] * px + m[4] * py + m[7] * pz) * sy - this.shift[1]) / 2,
    ];
  }

  // The grid's pixel that is seen nearest to a place of the pane, unless another one near it lies far in front.
  pick(u, v, pane) {
    const m = this.matrix(),
      [sx, sy] = this.scales(pane),
      within = 5 / Math.max(...this.grid);
    let found = null,
      front = -Infinity;
    for (let i = 0; i < this.places.length; i += 3) {
      const x = this.places[i],
        y = this.places[i + 1],
        z = this.places[i + 2];
      const dx = (2 * u - 1 - this.shift[0]) / sx - (m[0] * x + m[3] * y + m[6] * z);
      const dy = (1 - 2 * v - this.shift[1]) / sy - (m[1] * x + m[4] * y + m[7] * z);
      if (dx * dx + dy * dy > within * within) continue;
      const depth = m[2] * x + m[5] * y + m[8] * z - 4 * Math.hypot(dx, dy); // neighbours on a slope are less in front
      if (depth > front) {
        front = depth;
        found = i / 3;
      }
    }
    return found === null ? null : [found % this.grid[0], Math.floor(found / this.grid[0])];
  }
}
