// Marking photographs by hand: the mask, a sphere, a crop, pictures to leave out. Places are pixels of the page's reduced photographs.
const full = (v) => Math.round(10 * (data.step * (v + 0.5) - 0.5)) / 10; // of the photographs themselves
const reduced = (v) => (v + 0.5) / data.step - 0.5;
const said = {
  paint: "Paint what is on the object.",
  erase: "Erase what is not on the object.",
  sphere: "Drag from the sphere's middle to its edge; drag the circle to move it.",
  crop: "Drag from one corner to the other.",
  move: "Drag to move, wheel or pinch to change the size.",
};
const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const tools = { b: "paint", e: "erase", o: "sphere", c: "crop", m: "move" };

const mark = {
  tool: "paint",
  shown: 0,
  left_out: new Set(data.left_out),
  sphere: null,
  found: null,
  asks: 0,
  crop: data.crop && data.crop.map((v) => v / data.step),
  cursor: null,
  down: false,
  camera: { x: 0.5, y: 0.5, scale: 1 },
  fingers: new Map(),
  photograph: null,

  async start() {
    at("title").textContent = data.title;
    at("shown").replaceChildren(...data.names.map((name, j) => new Option(name, j)));
    at("mask-said").textContent =
      {
        found: "Suggested from the shading. What is tinted is not on the object.",
        whole: "Nothing stood out; the whole frame is on the object until you erase.",
      }[data.mask] || `From ${data.mask}. What is tinted is not on the object.`;
    await brush.start(data.shown);
    this.cursor = data.shown.map((v) => v / 2);
    this.wire();
    new ResizeObserver(() => this.draw()).observe(at("stage"));
    this.choose("paint");
    await this.show(0);
    this.numbers();
    document.body.dataset.ready = "yes";
  },

  async show(j) {
    const now = (j + data.names.length) % data.names.length;
    this.shown = now;
    at("shown").value = now;
    this.pictures();
    const bytes = await source(`picture/${now}`).catch((error) => this.trouble(error.message));
    const photograph = bytes && (await createImageBitmap(new Blob([bytes], { type: "image/webp" })));
    if (this.shown !== now) return; // another one was chosen meanwhile
    this.photograph = photograph;
    this.draw();
  },

  pictures() {
    at("used").checked = !this.left_out.has(this.shown);
    const n = this.left_out.size;
    at("used-said").textContent = n
      ? `${n} of ${data.names.length} left out: ${[...this.left_out]
          .sort((a, b) => a - b)
          .map((j) => data.names[j])
          .join(", ")}.`
      : `All ${data.names.length} are used.`;
    [...at("shown").options].forEach((option, k) => {
      option.textContent = data.names[k] + (this.left_out.has(k) ? " (left out)" : "");
    });
  },

  choose(tool) {
    this.tool = tool;
    for (const b of document.querySelectorAll("[data-tool]"))
      if (b.tagName === "BUTTON") b.setAttribute("aria-pressed", String(b.dataset.tool === tool));
    at("stage").dataset.tool = tool;
    at("hint").textContent = said[tool];
    this.down = false;
    this.draw();
  },

  width: () => Math.max(2, (Number(at("brush").value) / 500) * Math.max(...data.shown)), // finer ones miss pixels

  draw: atNextFrame(() => mark.drawNow()),

  drawNow() {
    const stage = at("stage"),
      canvas = at("canvas"),
      ratio = Math.min(devicePixelRatio || 1, 2),
      [w, h] = data.shown;
    if (
      canvas.width !== Math.round(stage.clientWidth * ratio) ||
      canvas.height !== Math.round(stage.clientHeight * ratio)
    )
      Object.assign(canvas, {
        width: Math.round(stage.clientWidth * ratio),
        height: Math.round(stage.clientHeight * ratio),
      });
    const scale = 0.94 * this.camera.scale * Math.min(stage.clientWidth / w, stage.clientHeight / h);
    this.frame = {
      scale,
      x: stage.clientWidth / 2 - this.camera.x * w * scale,
      y: stage.clientHeight / 2 - this.camera.y * h * scale,
    };
    const pen = canvas.getContext("2d");
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.setTransform(scale * ratio, 0, 0, scale * ratio, this.frame.x * ratio, this.frame.y * ratio);
    pen.imageSmoothingEnabled = scale * ratio < 3;
    if (this.photograph) pen.drawImage(this.photograph, 0, 0, w, h);
    if (this.left_out.has(this.shown)) {
      pen.fillStyle = "rgba(0, 0, 0, 0.6)";
      pen.fillRect(0, 0, w, h);
    }
    pen.globalAlpha = 0.6;
    pen.drawImage(brush.canvas, 0, 0);
    pen.globalAlpha = 1;
    this.overlay();
  },

  place: ([x, y]) => [mark.frame.x + (x + 0.5) * mark.frame.scale, mark.frame.y + (y + 0.5) * mark.frame.scale],

  overlay() {
    const shapes = [],
      { scale } = this.frame;
    if (this.crop) {
      const [a, b] = [this.crop.slice(0, 2), this.crop.slice(2)].map((p) => this.place(p.map((v) => v - 0.5)));
      shapes.push(
        svg("path", {
          d: `M${Math.min(a[0], b[0])} ${Math.min(a[1], b[1])}h${Math.abs(b[0] - a[0])}v${Math.abs(b[1] - a[1])}h${-Math.abs(b[0] - a[0])}z`,
          class: "crop",
        }),
      );
    }
    if (this.sphere) {
      const [x, y] = this.place([this.sphere.x, this.sphere.y]);
      shapes.push(
        svg("circle", { cx: x, cy: y, r: this.sphere.r * scale, class: "sphere" }),
        svg("path", { d: `M${x - 6} ${y}h12M${x} ${y - 6}v12`, class: "sphere" }),
      );
      (this.found?.highlights || []).forEach((p, j) => {
        if (!p) return;
        const [a, b] = this.place(p.map(reduced)),
          s = j === this.shown ? 7 : 4;
        shapes.push(
          svg("path", {
            d: `M${a - s} ${b - s}l${2 * s} ${2 * s}M${a - s} ${b + s}l${2 * s} ${-2 * s}`,
            class: j === this.shown ? "spot now" : "spot",
          }),
        );
      });
    }
    if (this.cursor && (this.tool === "paint" || this.tool === "erase")) {
      const [x, y] = this.place(this.cursor),
        r = Math.max(2, (this.width() * scale) / 2);
      for (const name of ["brush halo", "brush"]) shapes.push(svg("circle", { cx: x, cy: y, r, class: name }));
    }
    if (this.cursor && this.tool === "crop") {
      const [x, y] = this.place(this.cursor);
      for (const name of ["cross halo", "cross"])
        shapes.push(svg("path", { d: `M${x - 9} ${y}h18M${x} ${y - 9}v18`, class: name }));
    }
    at("overlay").replaceChildren(...shapes);
    dome.lamps(this.found?.lights || [], this.shown);
  },

  numbers() {
    // into the fields
    const s = this.sphere,
      c = this.cropped();
    [
      ["sphere-x", s && full(s.x)],
      ["sphere-y", s && full(s.y)],
      ["sphere-r", s && Math.round(10 * s.r * data.step) / 10],
    ].forEach(([id, v]) => {
      at(id).value = v ?? "";
    });
    [0, 1, 2, 3].forEach((k) => {
      at(`crop-${k}`).value = c ? c[k] : "";
    });
  },

  cropped() {
    // in the photographs' pixels
    if (!this.crop) return null;
    const [a, b, c, d] = this.crop,
      most = [data.width, data.height],
      fit = (v, k) => Math.max(0, Math.min(most[k], Math.round(v * data.step)));
    return [fit(Math.min(a, c), 0), fit(Math.min(b, d), 1), fit(Math.max(a, c), 0), fit(Math.max(b, d), 1)];
  },

  outline() {
    return this.sphere && { x: full(this.sphere.x), y: full(this.sphere.y), r: this.sphere.r * data.step };
  },

  async ask(path, what) {
    try {
      const answer = await fetch(path, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify(what),
      });
      if (!answer.ok) throw new Error(`The program answered ${answer.status}.`);
      return await answer.json();
    } catch (error) {
      return { problem: error instanceof TypeError ? ENDED : error.message };
    }
  },

  look(soon = 120) {
    // at the sphere's highlights, once it rests
    this.numbers();
    this.draw();
    clearTimeout(this.resting);
    const outline = this.outline(),
      asked = ++this.asks;
    if (!outline) {
      this.found = null;
      at("sphere-said").textContent = said.sphere;
      return;
    }
    this.resting = setTimeout(async () => this.told(await this.ask("sphere", outline), asked), soon);
  },

  told(answer, asked) {
    if (asked !== this.asks) return; // about a sphere that has moved on since
    this.found = answer.problem ? null : answer;
    at("sphere-said").textContent =
      sentence(answer.problem || "") ||
      [
        `${answer.lights.filter(Boolean).length} highlights found; the dots below are the lights.`,
        ...answer.doubts,
      ].join(" ");
    document.body.dataset.lights = JSON.stringify(this.found?.lights || null);
    this.draw();
  },

  async find() {
    at("sphere-said").textContent = "Looking for it ...";
    const asked = ++this.asks,
      answer = await this.ask("sphere/found", {});
    if (!answer.problem && asked === this.asks) {
      const c = answer.circle;
      this.sphere = { x: reduced(c.x), y: reduced(c.y), r: c.r / data.step };
      this.numbers();
    }
    this.told(answer, asked);
  },

  async save(overwrite = false) {
    const mask = brush.changed || data.mask === "found" ? await brush.text() : null;
    const answer = await this.ask("save", {
      mask,
      crop: this.cropped(),
      left_out: [...this.left_out],
      sphere: this.outline(),
      overwrite,
    });
    if (answer.problem) return this.trouble(answer.problem);
    at("trouble").hidden = true;
    if (answer.exist) {
      at("asked-said").textContent = `${answer.exist.join(" and ")} in ${data.title} will be replaced.`;
      at("asked").returnValue = "";
      return at("asked").showModal();
    }
    at("done-said").textContent = `${answer.saved.join(", ")} in ${data.title}. What comes next:`;
    at("done-next").textContent = answer.next;
    at("done").showModal();
    document.body.dataset.saved = answer.saved.join(" ");
  },

  trouble(text) {
    at("trouble").hidden = false;
    at("trouble").textContent = sentence(text);
  },
};
