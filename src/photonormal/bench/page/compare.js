// Two of an object's layers side by side, with a border that moves; drawn as the page of a result draws them.
const ramp = bytesOfText(data.colours); // 256 colours of error maps
const LIGHT = [-0.45, 0.5, 0.74];

const compare = {
  object: null,
  index: 0,
  sides: { left: null, right: null }, // { name, what, needs, label }

  start() {
    const gl = glOf(at("pictures"));
    if (!gl)
      at("said").textContent = "The pictures need WebGL 2, which this browser does not offer. The tables are below.";
    this.gl = gl;
    this.tiles = new Tiles(
      gl,
      async (path) => {
        const [, index, ...rest] = path.split("/"); // tile, object, layer, level, column, row; a layer may hold slashes
        return bytesOfText(data.objects[index].tiles[rest.slice(0, -3).join("/")]);
      },
      () => this.draw(),
    );
    this.picture = gl && new Picture(gl, this.tiles, ramp);
    const about = ({ width, height, layers }) => ({
      width,
      height,
      layers,
      sizes: [[width, height]],
      first: 0,
      first_photograph: 0,
    });
    this.abouts = data.objects.map(about);
  },

  layers(object) {
    const labels = Object.keys(object.scores),
      found = [{ name: "photograph", what: "photograph", needs: { colour: "photograph" } }];
    const add = (name, what, needs, label) => found.push({ name, what, needs, label });
    if (object.layers.truth) add("true normals", "normals", { normals: "truth" });
    for (const label of labels) add(`normals: ${label}`, "normals", { normals: `normals:${label}` }, label);
    for (const label of labels) add(`relit: ${label}`, "relit", { normals: `normals:${label}` }, label);
    for (const label of labels)
      if (object.layers[`error:${label}`]) add(`error: ${label}`, "degrees", { numbers: `error:${label}` }, label);
    return found;
  },

  async choose(index) {
    this.index = index;
    this.object = data.objects[index];
    const names = this.layers(this.object).map((l) => l.name);
    const errors = names.filter((n) => n.startsWith("error: "));
    const first = { left: errors[0] || names[0], right: errors[1] || names[names.length - 1] };
    for (const side of ["left", "right"]) {
      const before = at(side).value;
      at(side).replaceChildren(...names.map((n) => new Option(n, n)));
      at(side).value = names.includes(before) ? before : first[side];
    }
    const scale = Math.min(520 / this.object.width, 480 / this.object.height);
    at("stage").parentElement.style.width = `${Math.round(scale * this.object.width)}px`;
    await this.pick();
    const s = this.object.surface;
    await relief.show(s, s && (await this.tile(`normals:${s.method}`)));
  },

  tile(name) {
    return this.tiles.whole(this.index, this.abouts[this.index], name, 0, 0, 0);
  },

  async pick() {
    // the layers chosen, once they are here
    for (const side of ["left", "right"]) {
      this.sides[side] = this.layers(this.object).find((l) => l.name === at(side).value);
      for (const name of Object.values(this.sides[side].needs)) await this.tile(name);
    }
    this.draw();
  },

  draw() {
    const { object, sides } = this,
      canvas = at("pictures");
    if (!sides.left || !sides.right) return;
    const pane = {
      x: 0,
      y: 0,
      w: Math.max(object.width, 520),
      h: Math.round((object.height / object.width) * Math.max(object.width, 520)),
    };
    if (canvas.width !== pane.w || canvas.height !== pane.h) Object.assign(canvas, { width: pane.w, height: pane.h });
    const frame = { scale: pane.w / object.width, x: 0, y: 0 },
      cut = Math.round((pane.w * at("wipe").value) / 100);
    const look = {
      mode: "matt",
      light: LIGHT,
      exposure: 1,
      gloss: 0,
      sharpness: 40,
      raking: 12,
      ground: [1, 1, 1],
      limit: Number(at("limit").value),
    };
    if (this.gl) {
      this.gl.clearColor(1, 1, 1, 1);
      this.gl.clear(this.gl.COLOR_BUFFER_BIT);
      for (const [side, part] of [
        ["left", [0, cut]],
        ["right", [cut, pane.w]],
      ])
        this.picture.draw(
          this.index,
          this.abouts[this.index],
          sides[side].what,
          sides[side].needs,
          pane,
          part,
          frame,
          look,
        );
      this.say();
    }
    at("line").style.left = `calc(${at("wipe").value}% - 1px)`;
    this.bar();
    document.body.dataset.drawn = `${object.name}|${sides.left.name}|${sides.right.name}`;
  },

  errors() {
    return Object.values(this.sides).some((s) => s.what === "degrees");
  },

  bar() {
    at("limit-said").value = `${at("limit").value}°`;
    const pen = at("bar").getContext("2d");
    at("bar").style.visibility = this.errors() ? "visible" : "hidden";
    for (let i = 0; i < 256; i++) {
      pen.fillStyle = `rgb(${ramp[3 * i]},${ramp[3 * i + 1]},${ramp[3 * i + 2]})`;
      pen.fillRect(i, 0, 1, 10);
    }
  },

  async say(x = null, y = null) {
    const parts = [];
    for (const side of ["left", "right"]) {
      const s = this.sides[side],
        score = this.object.scores[s.label];
      let text = `${side}: ${s.name}`;
      if (score) text += `, mean ${score.mean_deg.toFixed(2)}°, median ${score.median_deg.toFixed(2)}°`;
      if (x !== null && s.what === "degrees") {
        const tile = await this.tile(s.needs.numbers),
          level = tile.values[(y + 1) * tile.w + x + 1];
        if (level !== data.unknown) text += `, here ${angle(level)}`;
      }
      parts.push(text);
    }
    at("said").textContent =
      parts.join("; ") + (this.errors() ? `. Colours: 0 to ${at("limit").value}° and more.` : ".");
  },
};

if (data.objects.length) {
  at("compare").hidden = false;
  compare.start();
  const several = new Set(data.objects.map((o) => o.dataset)).size > 1;
  at("object").append(...data.objects.map((o, i) => new Option(several ? `${o.dataset}: ${o.name}` : o.name, i)));
  at("object").addEventListener("change", () => compare.choose(Number(at("object").value)));
  for (const id of ["left", "right"]) at(id).addEventListener("change", () => compare.pick());
  for (const id of ["limit", "wipe"]) at(id).addEventListener("input", () => compare.draw());
  const place = (e) => {
    const box = at("stage").getBoundingClientRect();
    return [(e.clientX - box.left) / box.width, (e.clientY - box.top) / box.height];
  };
  const border = (x) => {
    at("wipe").value = 100 * x;
    compare.draw();
  };
  at("stage").addEventListener("pointerdown", (e) => border(place(e)[0]));
  at("stage").addEventListener("pointermove", (e) => {
    const [x, y] = place(e),
      o = compare.object;
    if (x < 0 || y < 0 || x >= 1 || y >= 1) return;
    if (e.buttons) border(x);
    compare.say(Math.floor(x * o.width), Math.floor(y * o.height));
  });
  at("stage").addEventListener("pointerleave", () => compare.say());
  compare.choose(0);
}
