// The page: what is shown, and the drawing of it. What people do to it is in input.js.
const page = {
  view: "picture",
  tool: "light",
  held: false,
  border: 0.5,
  first: "relit",
  second: "",
  panes: [],
  camera: { x: 0.5, y: 0.5, scale: 1 },
  line: null,
  cursor: null,
  look: {
    mode: "lambert",
    light: [0, 0, 1],
    exposure: 1,
    gloss: 0.5,
    sharpness: 40,
    raking: 12,
    limit: 30,
    ground: [0, 0, 0],
  },

  start() {
    this.gl = glOf(at("canvas"));
    this.tiles = new Tiles(this.gl, source, (failed) => {
      if (failed) this.trouble(failed);
      this.draw();
    });
    const ramp = bytesOfText(data.colours);
    if (this.gl) this.picture = new Picture(this.gl, this.tiles, ramp);
    at("canvas").addEventListener("webglcontextlost", () => {
      this.gl = null; // nothing more is drawn
      this.trouble("The browser has taken the graphics memory of this page away. Reload the page.");
    });
    at("bar")
      .getContext("2d")
      .putImageData(
        new ImageData(
          Uint8ClampedArray.from({ length: 1024 }, (_, i) => (i % 4 === 3 ? 255 : ramp[3 * (i >> 2) + (i % 4)])),
          256,
          1,
        ),
        0,
        0,
      );
    this.show([0, 1].filter((k) => k < data.results.length));
    this.second = this.available().includes("photograph") ? "photograph" : "normals";
    dome.start((light) => {
      this.look.light = light;
      this.photograph();
      this.draw();
    });
    input.start();
    this.paint();
    dome.set([-0.5, 0.5]);
    new ResizeObserver(() => this.draw()).observe(at("stage"));
    if (!this.gl) plain.show();
  },

  show(indices) {
    // these results, side by side
    this.panes = indices.map(
      (index) =>
        this.panes.find((p) => p.index === index) || {
          index,
          about: data.results[index],
          surface: null,
          photograph: null,
        },
    );
    const names = this.panes.map((p) => p.about.title);
    at("title").textContent = names.join(" | ");
    document.title = `${names.join(" | ")} - photonormal`;
    this.cursor = null;
    at("values").replaceChildren();
    input.clear();
    this.facts();
    this.photograph();
  },

  available() {
    // layers that every result shown has
    const has = (about, layer) =>
      layer === "photograph"
        ? about.photographs.length > 0
        : layer === "relit"
          ? about.layers.albedo || about.layers.normals
          : about.layers[layer];
    return Object.keys(LAYERS).filter((layer) => this.panes.every((p) => has(p.about, layer)));
  },

  draw: atNextFrame(() => page.drawNow()),

  drawNow() {
    this.tiles.frame = this.tiles.time;
    const stage = at("stage"),
      canvas = at("canvas"),
      ratio = Math.min(devicePixelRatio || 1, 2),
      wide = stage.clientWidth,
      high = stage.clientHeight;
    if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) {
      canvas.width = Math.round(wide * ratio);
      canvas.height = Math.round(high * ratio);
    }
    const beside = wide >= high,
      n = this.panes.length;
    this.panes.forEach((p, k) => {
      p.box = beside
        ? { x: (k * wide) / n, y: 0, w: wide / n, h: high }
        : { x: 0, y: (k * high) / n, w: wide, h: high / n };
      p.pane = {
        x: Math.round(p.box.x * ratio),
        y: Math.round((high - p.box.y - p.box.h) * ratio),
        w: Math.round(p.box.w * ratio),
        h: Math.round(p.box.h * ratio),
      };
      const { width, height } = p.about,
        scale = 0.92 * this.camera.scale * Math.min(p.pane.w / width, p.pane.h / height);
      p.frame = {
        scale,
        x: p.pane.w / 2 - this.camera.x * width * scale,
        y: p.pane.h / 2 - this.camera.y * height * scale,
      };
      p.ratio = ratio;
    });
    if (this.gl) {
      this.gl.clearColor(...this.look.ground, 1);
      this.gl.clear(this.gl.COLOR_BUFFER_BIT | this.gl.DEPTH_BUFFER_BIT);
      for (const p of this.panes) this.view === "picture" ? this.drawPicture(p) : this.drawSurface(p);
    }
    this.overlay();
    this.legend();
    document.body.dataset.waiting = String(this.tiles.loading);
  },

  drawPicture(p) {
    const cut = this.second ? Math.round(this.border * p.pane.w) : 0;
    const look = { ...this.look, mode: this.look.mode === "matt" || p.about.layers.albedo ? this.look.mode : "matt" };
    const needs = {
      relit: { normals: "normals", colour: look.mode === "matt" ? null : "albedo" },
      normals: { normals: "normals" },
      albedo: { normals: "normals", colour: "albedo" },
      photograph: { colour: `photograph-${p.photograph}` },
    };
    for (const [layer, part] of [
      [this.second, [0, cut]],
      [this.first, [cut, p.pane.w]],
    ]) {
      if (!layer || part[1] <= part[0] || (layer === "photograph" && p.photograph === null)) continue;
      const what = p.about.layers[layer] === "degrees" ? "degrees" : layer;
      this.picture.draw(p.index, p.about, what, needs[layer] || { numbers: layer }, p.pane, part, p.frame, look);
    }
  },

  drawSurface(p) {
    if (!p.about.relief) return this.trouble("This result has no depth: it was measured without a mesh.");
    if (!p.surface) {
      p.surface = new Surface(this.gl);
      p.built = built(p, this.tiles).then(
        (size) => {
          p.size = size;
          this.draw();
        },
        (error) => this.trouble(String(error.message || error)),
      );
    }
    if (p.size) p.surface.draw(p.pane, this.look, Boolean(p.about.layers.albedo), p.size);
  },

  photograph() {
    // the one under the real light nearest to the light; the one before stays until it is here
    for (const p of this.panes) {
      clearTimeout(p.resting);
      const shots = p.about.photographs;
      if (!shots.length) continue;
      const nearest = shots[0].light
        ? nearestLight(
            shots.map((s) => s.light),
            lightOf(this.look),
          )
        : 0;
      p.nearest = nearest;
      if (shots[nearest].index === p.photograph) continue;
      p.resting = setTimeout(
        async () => {
          const level = p.about.sizes.length - 1;
          if (![this.first, this.second].includes("photograph")) return;
          await this.tiles.whole(p.index, p.about, `photograph-${shots[nearest].index}`, level, 0, 0);
          if (p.nearest === nearest) {
            p.photograph = shots[nearest].index;
            p.shot = shots[nearest];
            this.draw();
          }
        },
        p.photograph === null ? 0 : 90,
      );
    }
    const p = this.panes[0];
    if (p)
      dome.lamps(
        p.about.photographs.filter((s) => s.light).map((s) => s.light),
        p.nearest,
      );
  },

  paint() {
    // the ground's colour
    const rgb = getComputedStyle(document.body)
      .backgroundColor.match(/[\d.]+/g)
      .map(Number);
    this.look.ground = rgb.slice(0, 3).map((v) => v / 255);
    this.draw();
  },

  trouble(text) {
    at("trouble").hidden = false;
    at("trouble").textContent = text;
  },
};

// The surface's grid from the smallest size of the heights, its textures from a larger one; returns their size.
async function built(p, tiles) {
  const { about, index, surface } = p,
    gl = tiles.gl,
    last = about.sizes.length - 1;
  const tile = await tiles.whole(index, about, "height", last, 0, 0),
    w = Math.max(tile.w - 2, 2), // of a single row or column the rim is the other side
    h = Math.max(tile.h - 2, 2),
    heights = new Float32Array(w * h);
  if (tile.failed) throw new Error(tile.failed);
  for (let y = 0; y < h; y++)
    for (let x = 0; x < w; x++)
      heights[y * w + x] = measure.height(about, tile.values[(y + 1) * tile.w + x + 1]) / 2 ** last;
  surface.shape(w, h, heights);
  let level = last;
  while (level > about.first && Math.max(...about.sizes[level - 1]) <= 2048) level--;
  const [wide, high] = about.sizes[level],
    pairs = [
      ["normals", "normals"],
      ["albedo", "colour"],
    ].filter(([layer]) => about.layers[layer]);
  for (const [layer, name] of pairs) {
    const parts = [];
    for (let y = 0; y * SIDE < high; y++)
      for (let x = 0; x * SIDE < wide; x++) parts.push([x, y, await tiles.whole(index, about, layer, level, x, y)]);
    if (name === "normals") surface.normals(wide, high, null);
    gl.bindTexture(gl.TEXTURE_2D, surface.textures[name]);
    if (name === "colour")
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, wide + 2, high + 2, 0, gl.RGB, gl.UNSIGNED_BYTE, null);
    for (const [x, y, part] of parts) {
      if (part.failed) throw new Error(part.failed);
      if (name === "normals")
        gl.texSubImage2D(
          gl.TEXTURE_2D,
          0,
          x * SIDE,
          y * SIDE,
          part.w,
          part.h,
          gl.RGB,
          gl.FLOAT,
          Float32Array.from(part.values, (v) => v / data.unit),
        );
      else gl.texSubImage2D(gl.TEXTURE_2D, 0, x * SIDE, y * SIDE, gl.RGB, gl.UNSIGNED_BYTE, part.picture);
    }
  }
  return [wide, high];
}
