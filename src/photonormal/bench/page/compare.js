// Two of an object's pictures, one over the other, with a border that moves.
const ramp = bytesOfText(data.colours); // 256 colours of error maps

const compare = {
  object: null,
  sides: { left: null, right: null }, // { name, levels or null, score }
  pictures: new Map(),
  asked: 0,

  layers(object) {
    const found = [["photograph", object.photograph, null, null]];
    if (object.truth) found.push(["true normals", object.truth, null, null]);
    for (const [name, m] of Object.entries(object.methods)) found.push([`normals: ${name}`, m.normals, null, m.score]);
    for (const [name, m] of Object.entries(object.methods))
      if (m.error) found.push([`error: ${name}`, m.error, true, m.score]);
    return found;
  },

  async picture(address) {
    if (!this.pictures.has(address)) {
      const image = new Image();
      image.src = address;
      await image.decode();
      this.pictures.set(address, image);
    }
    return this.pictures.get(address);
  },

  async choose(index) {
    this.object = data.objects[index];
    const names = this.layers(this.object).map((l) => l[0]);
    const errors = names.filter((n) => n.startsWith("error: "));
    const first = { left: errors[0] || names[0], right: errors[1] || names[names.length - 1] };
    for (const side of ["left", "right"]) {
      const before = at(side).value;
      at(side).replaceChildren(...names.map((n) => new Option(n, n)));
      at(side).value = names.includes(before) ? before : first[side];
    }
    const scale = Math.min(520 / this.object.width, 480 / this.object.height);
    at("stage").parentElement.style.width = `${Math.round(scale * this.object.width)}px`;
    await this.draw();
    const s = this.object.surface;
    await relief.show(s, s && this.picture(this.object.methods[s.method].normals));
  },

  async draw() {
    const object = this.object,
      asked = ++this.asked;
    for (const [side, canvas] of [
      ["left", at("under")],
      ["right", at("over")],
    ]) {
      const [name, address, error, score] = this.layers(object).find((l) => l[0] === at(side).value);
      const image = await this.picture(address);
      if (asked !== this.asked) return; // something else was chosen meanwhile
      canvas.width = object.width;
      canvas.height = object.height;
      const pen = canvas.getContext("2d", { willReadFrequently: true });
      pen.drawImage(image, 0, 0, object.width, object.height);
      let levels = null;
      if (error) {
        const pixels = pen.getImageData(0, 0, canvas.width, canvas.height),
          limit = Number(at("limit").value);
        levels = new Uint8Array(pixels.data.length / 4);
        for (let i = 0; i < levels.length; i++) {
          levels[i] = pixels.data[4 * i];
          const colour = 3 * Math.min(255, Math.round((255 * levels[i]) / (limit * data.levels_per_degree)));
          const known = levels[i] !== data.unknown;
          for (let c = 0; c < 3; c++) pixels.data[4 * i + c] = known ? ramp[colour + c] : 255;
        }
        pen.putImageData(pixels, 0, 0);
      }
      this.sides[side] = { name, levels, score };
    }
    this.wipe();
    this.say();
    this.bar();
    document.body.dataset.drawn = `${object.name}|${this.sides.left.name}|${this.sides.right.name}`;
  },

  wipe() {
    const x = at("wipe").value;
    at("over").style.clipPath = `inset(0 0 0 ${x}%)`;
    at("line").style.left = `calc(${x}% - 1px)`;
  },

  bar() {
    at("limit-said").value = `${at("limit").value}°`;
    const pen = at("bar").getContext("2d"),
      shown = Object.values(this.sides).some((s) => s.levels);
    at("bar").style.visibility = shown ? "visible" : "hidden";
    for (let i = 0; i < 256; i++) {
      pen.fillStyle = `rgb(${ramp[3 * i]},${ramp[3 * i + 1]},${ramp[3 * i + 2]})`;
      pen.fillRect(i, 0, 1, 10);
    }
  },

  say(place = null) {
    const parts = ["left", "right"].map((side) => {
      const s = this.sides[side];
      let text = `${side}: ${s.name}`;
      if (s.score) text += `, mean ${s.score.mean_deg.toFixed(2)}°, median ${s.score.median_deg.toFixed(2)}°`;
      if (place !== null && s.levels && s.levels[place] !== data.unknown)
        text += `, here ${(s.levels[place] / data.levels_per_degree).toFixed(1)}°`;
      return text;
    });
    const errors = Object.values(this.sides).some((s) => s.levels);
    at("said").textContent = parts.join("; ") + (errors ? `. Colours: 0 to ${at("limit").value}° and more.` : ".");
  },
};

if (data.objects.length) {
  at("compare").hidden = false;
  const several = new Set(data.objects.map((o) => o.dataset)).size > 1;
  at("object").append(...data.objects.map((o, i) => new Option(several ? `${o.dataset}: ${o.name}` : o.name, i)));
  at("object").addEventListener("change", () => compare.choose(Number(at("object").value)));
  for (const id of ["left", "right", "limit"]) at(id).addEventListener("input", () => compare.draw());
  at("wipe").addEventListener("input", () => compare.wipe());
  at("stage").addEventListener("pointermove", (e) => {
    const box = at("stage").getBoundingClientRect();
    const x = (e.clientX - box.left) / box.width,
      y = (e.clientY - box.top) / box.height,
      o = compare.object;
    if (x < 0 || y < 0 || x >= 1 || y >= 1) return;
    if (e.buttons) {
      at("wipe").value = 100 * x;
      compare.wipe();
    }
    compare.say(Math.floor(y * o.height) * o.width + Math.floor(x * o.width));
  });
  at("stage").addEventListener("pointerdown", (e) => {
    const box = at("stage").getBoundingClientRect();
    at("wipe").value = (100 * (e.clientX - box.left)) / box.width;
    compare.wipe();
  });
  at("stage").addEventListener("pointerleave", () => compare.say());
  compare.choose(0);
}
