// A result seen from the front: any layer of it, from tiles, at any size.
const DRAWN = ["relit", "normals", "albedo", "height", "degrees", "photograph"]; // what the shader knows to draw
const LAYERS = {
  relit: "Relit",
  photograph: "Photograph",
  normals: "Normals",
  albedo: "Albedo",
  height: "Depth, shaded",
  expected: "Expected error",
  error: "True error",
};

class Picture {
  constructor(gl, tiles, ramp) {
    this.gl = gl;
    this.tiles = tiles;
    this.program = new Program(
      gl,
      `
      layout(location = 0) in vec2 corner; // of a unit square
      uniform vec2 from, to; // where the tile lies, in clip space
      uniform vec2 size; // of the tile in pixels, without its rim
      out vec2 place;
      void main() {
        place = (corner * size + 1.0) / (size + 2.0);
        gl_Position = vec4(mix(from, to, corner), 0.0, 1.0);
      }`,
      `
      uniform sampler2D normals, colour, numbers, ramp;
      uniform int layer;
      uniform vec3 ground;
      uniform float last; // level of the last colour
      in vec2 place;
      out vec4 pixel;
      ${SHADING}
      void main() {
        vec3 c = ground;
        if (layer == 3) {
          vec4 h = texture(numbers, place);
          vec3 n = vec3(h.xy, sqrt(max(0.0, 1.0 - dot(h.xy, h.xy))));
          vec3 tint = texture(ramp, vec2(h.z, 0.5)).rgb;
          c = mix(ground, tint * (0.25 + 0.85 * max(dot(n, light), 0.0)), smoothstep(0.4, 0.6, h.w));
        } else if (layer == 4) {
          float level = round(texture(numbers, place).r * 255.0);
          if (level < 254.5) c = texture(ramp, vec2(min(level / last, 0.998), 0.5)).rgb;
        } else if (layer == 5) {
          c = texture(colour, place).rgb;
        } else {
          vec3 n = texture(normals, place).rgb;
          float length = length(n);
          n /= max(length, 1e-6);
          vec3 found = layer == 0 ? lit(n, mode == 2 ? vec3(1.0) : texture(colour, place).rgb)
            : layer == 1 ? 0.5 * n + 0.5 : texture(colour, place).rgb;
          c = mix(ground, found, smoothstep(0.35, 0.65, length));
        }
        pixel = vec4(c, 1.0);
      }`,
    );
    this.square = gl.createVertexArray();
    gl.bindVertexArray(this.square);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array([0, 0, 1, 0, 0, 1, 1, 1]), gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 2, gl.FLOAT, false, 0, 0);
    this.ramp = textureOf(gl, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, ramp.length / 3, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, ramp);
  }

  // what: one of DRAWN; needs: names of the stored layers that it is drawn from, as normals, colour and numbers;
  // pane: box in device pixels from the lower left; part: the columns of it to draw; frame: where the picture lies in it.
  draw(index, about, what, needs, pane, part, frame, look) {
    const gl = this.gl;
    gl.viewport(pane.x, pane.y, pane.w, pane.h);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(pane.x + part[0], pane.y, Math.max(0, part[1] - part[0]), pane.h);
    gl.disable(gl.DEPTH_TEST);
    gl.bindVertexArray(this.square);
    this.program.use();
    this.program.set({
      ...shadingValues(look),
      ground: look.ground,
      last: look.limit * data.levels_per_degree,
      normals: { int: 0 },
      colour: { int: 1 },
      numbers: { int: 2 },
      ramp: { int: 3 },
      layer: { int: DRAWN.indexOf(what) },
    });
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.ramp);
    const units = ["normals", "colour", "numbers"].filter((unit) => needs[unit]); // of the textures, in order
    const names = units.map((unit) => needs[unit]);
    const last = about.sizes.length - 1;
    const first = what === "photograph" ? about.first_photograph : about.first;
    const level = Math.max(first, Math.min(last, Math.floor(Math.log2(1 / frame.scale) + 0.3)));
    for (let l = last; l >= level; l--) {
      const [w, h] = about.sizes[l],
        size = frame.scale * 2 ** l; // device pixels of one of the level's
      const span = (from, to, count) => [
        Math.max(0, Math.floor(from / SIDE)),
        Math.min(Math.ceil(count / SIDE) - 1, Math.floor(to / SIDE)),
      ];
      const [x0, x1] = span((part[0] - frame.x) / size, (part[1] - frame.x) / size, w);
      const [y0, y1] = span(-frame.y / size, (pane.h - frame.y) / size, h);
      for (let y = y0; y <= y1; y++)
        for (let x = x0; x <= x1; x++) {
          if (
            l !== level &&
            l !== last &&
            !names.every((n) => this.tiles.kept.has(`tile/${index}/${n}/${l}/${x}/${y}`))
          )
            continue;
          const found = names.map((n) => this.tiles.get(index, about, n, l, x, y));
          if (!found.every(Boolean)) continue;
          found.forEach((tile, k) => {
            gl.activeTexture(gl.TEXTURE0 + ["normals", "colour", "numbers"].indexOf(units[k]));
            gl.bindTexture(gl.TEXTURE_2D, tile.texture);
          });
          const tw = found[0].w - 2,
            th = found[0].h - 2;
          const left = frame.x + size * x * SIDE,
            top = frame.y + size * y * SIDE;
          const clip = (px, py) => [(2 * px) / pane.w - 1, 1 - (2 * py) / pane.h];
          this.program.set({ from: clip(left, top), to: clip(left + size * tw, top + size * th), size: [tw, th] });
          gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
        }
    }
    gl.disable(gl.SCISSOR_TEST);
  }
}
