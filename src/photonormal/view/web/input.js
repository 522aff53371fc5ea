// What people do: buttons, sliders, pointer, fingers and keys.
const names = {
  view: { picture: "Picture", surface: "Surface" },
  tool: { light: "Light", move: "Move", measure: "Measure" },
  mode: { lambert: "Matt", gloss: "Gloss", matt: "Shape only", specular: "Specular enhancement", raking: "Raking light" },
};
const explained = {
  lambert: "The albedo under a matt surface's shading.",
  gloss: "The albedo, and a highlight on top.",
  matt: "A white matt surface: the normals alone.",
  specular: "Little colour and strong highlights: wear, incisions and brush strokes stand out.",
  raking: "Light from low down. The hemisphere gives the direction, the slider the height.",
};
const touch = matchMedia("(pointer: coarse)").matches;
const follow = touch ? "Drag to move the light." : "The light follows the pointer. Click to hold it, click again to let go.";
const hints = {
  picture: { light: follow, move: touch ? "Drag to move, pinch to change the size." : "Drag to move, wheel to change the size.", measure: "Drag a line along which to see the heights." },
  surface: { light: follow, move: touch ? "Drag to turn, pinch to change the size." : "Drag to turn, Shift and drag to move, wheel to change the size.", measure: "Click the two ends of a line." },
};

const input = {
  fingers: new Map(), started: null,

  start() {
    for (const button of document.querySelectorAll("[data-set]")) button.addEventListener("click", () => this.set(button.dataset.set, button.dataset.value));
    const slide = (id, key, to, from, text) => {
      const element = at(id), said = element.parentElement.querySelector("output");
      element.value = from(page.look[key]);
      const take = () => { page.look[key] = to(Number(element.value)); said.textContent = text(page.look[key]); page.photograph(); page.draw(); };
      element.addEventListener("input", take);
      take();
    };
    slide("exposure", "exposure", (v) => 2 ** v, Math.log2, (v) => v.toFixed(1));
    slide("gloss", "gloss", (v) => v, (v) => v, (v) => v.toFixed(2));
    slide("sharpness", "sharpness", (v) => 2 ** v, Math.log2, (v) => v.toFixed(0));
    slide("raking", "raking", (v) => v, (v) => v, (v) => `${v}°`);
    slide("limit", "limit", (v) => v, (v) => v, (v) => `${v}°`);
    for (const id of ["first", "second"]) at(id).addEventListener("change", () => { page[id] = at(id).value; page.photograph(); page.draw(); });
    at("ground").addEventListener("click", () => {
      const light = document.documentElement.dataset.ground !== "light";
      document.documentElement.dataset.ground = light ? "light" : "dark";
      at("ground").textContent = light ? "Dark ground" : "Light ground";
      page.paint();
    });
    at("help-open").addEventListener("click", () => at("help").showModal());
    at("larger").addEventListener("click", () => this.zoom(1.25));
    at("smaller").addEventListener("click", () => this.zoom(0.8));
    at("fit").addEventListener("click", () => this.fit());
    at("clear").addEventListener("click", () => this.clear());
    this.results();
    this.pointers();
    at("stage").addEventListener("keydown", (e) => { if (this.key(e)) e.preventDefault(); });
    at("border").addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -0.02, ArrowDown: -0.02, ArrowRight: 0.02, ArrowUp: 0.02, Home: -1, End: 1 }[e.key];
      if (!step) return;
      e.preventDefault(); e.stopPropagation();
      this.move(page.border + step * (e.shiftKey ? 5 : 1));
    });
    this.layers();
    this.pressed();
  },

  results() {
    if (data.results.length < 2) return;
    at("results").hidden = false;
    for (const k of [0, 1]) {
      at(`pane-${k}`).replaceChildren(...data.results.map((r, i) => new Option(r.title, i)), ...(k ? [new Option("none", "")] : []));
      at(`pane-${k}`).value = k;
      at(`pane-${k}`).addEventListener("change", () => {
        page.show([at("pane-0").value, at("pane-1").value].filter((v) => v !== "").map(Number).filter((v, i, all) => all.indexOf(v) === i));
        this.layers();
        page.draw();
      });
    }
  },

  layers() { // choices of layers
    const there = page.available();
    if (!there.includes(page.first)) page.first = "relit";
    if (page.second && !there.includes(page.second)) page.second = "normals";
    at("first").replaceChildren(...there.map((l) => new Option(LAYERS[l], l)));
    at("second").replaceChildren(new Option("no border", ""), ...there.map((l) => new Option(LAYERS[l], l)));
    at("first").value = page.first;
    at("second").value = page.second;
  },

  set(what, value) {
    if (what === "mode") page.look.mode = value; else page[what] = value;
    if (what === "view") page.tool = value === "surface" ? "move" : "light";
    page.photograph();
    this.pressed();
    page.draw();
  },

  pressed() {
    for (const button of document.querySelectorAll("[data-set]")) {
      const now = button.dataset.set === "mode" ? page.look.mode : page[button.dataset.set];
      button.setAttribute("aria-pressed", String(now === button.dataset.value));
    }
    document.querySelector('[data-value="move"]').textContent = page.view === "surface" ? "Turn" : "Move";
    at("stage").dataset.tool = page.tool;
    at("hint").textContent = page.held && page.tool === "light" ? "The light is held. Click to let it follow the pointer." : hints[page.view][page.tool];
    at("layers").hidden = page.view === "surface";
    const { mode } = page.look;
    at("mode-said").textContent = explained[mode];
    at("gloss-row").hidden = at("sharpness-row").hidden = mode !== "gloss" && mode !== "specular";
    at("raking-row").hidden = mode !== "raking";
  },

  paneAt(e) { // the pane under an event, and where in it, in the stage's pixels
    const box = at("stage").getBoundingClientRect(), x = e.clientX - box.left, y = e.clientY - box.top;
    const k = Math.max(0, page.panes.findIndex(({ box: b }) => x >= b.x && y >= b.y && x < b.x + b.w && y < b.y + b.h));
    return { k, p: page.panes[k], x: x - page.panes[k].box.x, y: y - page.panes[k].box.y };
  },

  pixelAt(e) { // the result's pixel under an event; null where the surface is not met
    const { k, p, x, y } = this.paneAt(e);
    if (page.view === "picture") return { pane: k, x: (x * p.ratio - p.frame.x) / p.frame.scale, y: (y * p.ratio - p.frame.y) / p.frame.scale };
    const found = p.size && p.surface.pick(x / p.box.w, y / p.box.h, p.pane);
    return found && { pane: k, x: ((found[0] + 0.5) / p.surface.grid[0]) * p.about.width, y: ((found[1] + 0.5) / p.surface.grid[1]) * p.about.height };
  },

  pointers() {
    const stage = at("stage"), border = at("border");
    border.addEventListener("pointerdown", (e) => { e.stopPropagation(); border.setPointerCapture(e.pointerId); });
    border.addEventListener("pointermove", (e) => {
      e.stopPropagation();
      if (!border.hasPointerCapture(e.pointerId)) return;
      const { box } = page.panes[0];
      this.move((e.clientX - stage.getBoundingClientRect().left - box.x) / box.w);
    });
    at("size").addEventListener("pointerdown", (e) => e.stopPropagation());
    stage.addEventListener("pointerdown", (e) => {
      stage.setPointerCapture(e.pointerId);
      stage.focus({ preventScroll: true });
      this.fingers.set(e.pointerId, e);
      this.started = { x: e.clientX, y: e.clientY, moved: false, several: this.fingers.size > 1 || this.started?.several };
      if (page.tool === "measure" && this.fingers.size === 1) this.point(this.pixelAt(e), page.view === "picture");
      if (page.tool === "light" && e.pointerType !== "mouse") this.shine(e);
    });
    stage.addEventListener("pointermove", (e) => this.moved(e));
    const ended = (e) => {
      const tapped = this.started && !this.started.moved && !this.started.several;
      this.fingers.delete(e.pointerId);
      if (this.fingers.size) return;
      this.started = null;
      if (tapped && page.tool === "light" && e.pointerType === "mouse") { page.held = !page.held; this.pressed(); }
      if (page.drawing) { page.drawing = false; this.measured(); }
    };
    stage.addEventListener("pointerup", ended);
    stage.addEventListener("pointercancel", ended);
    stage.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(-e.deltaY / 500), e); }, { passive: false });
    stage.addEventListener("dblclick", () => { if (page.tool === "move") this.fit(); });
  },

  moved(e) {
    const before = this.fingers.get(e.pointerId);
    if (before && Math.hypot(e.clientX - this.started.x, e.clientY - this.started.y) > 4) this.started.moved = true;
    if (this.fingers.size === 2 && before) {
      const [a, b] = [...this.fingers.values()], other = a.pointerId === e.pointerId ? b : a;
      const size = (m) => Math.hypot(m.clientX - other.clientX, m.clientY - other.clientY);
      this.shift((e.clientX - before.clientX) / 2, (e.clientY - before.clientY) / 2);
      this.zoom(size(e) / Math.max(1, size(before)), { clientX: (e.clientX + other.clientX) / 2, clientY: (e.clientY + other.clientY) / 2 });
    } else if (page.tool === "light" && !page.held && (e.pointerType === "mouse" || before)) this.shine(e);
    else if (page.tool === "move" && before) this.drag(e.clientX - before.clientX, e.clientY - before.clientY, e.shiftKey);
    else if (page.tool === "measure" && page.drawing && page.line) {
      const pixel = this.pixelAt(e);
      if (pixel) { page.line.ends[1] = [pixel.x, pixel.y]; page.draw(); }
    }
    if (before) this.fingers.set(e.pointerId, e);
    const pixel = this.pixelAt(e);
    if (pixel) this.look(pixel);
  },

  look(pixel) { // the values there, once the pointer rests
    page.cursor = pixel;
    page.overlay();
    clearTimeout(this.resting);
    this.resting = setTimeout(async () => {
      const rows = await measure.values(page.panes[pixel.pane], pixel.x, pixel.y);
      if (page.cursor === pixel) fill(at("values"), rows);
    }, 60);
  },

  shine(e) {
    const { p, x, y } = this.paneAt(e), r = Math.min(p.box.w, p.box.h) / 2;
    dome.set([(x - p.box.w / 2) / r, (p.box.h / 2 - y) / r]);
  },

  drag(dx, dy, aside) { // the picture with the pointer; the surface turns, or moves
    if (page.view === "picture" || aside) return this.shift(dx, dy);
    for (const { surface } of page.panes) if (surface) {
      surface.turn += dx / 140;
      surface.tilt = Math.max(-1.5, Math.min(1.5, surface.tilt + dy / 140));
    }
    page.draw();
  },

  shift(dx, dy) {
    const p = page.panes[0];
    if (page.view === "picture") {
      page.camera.x -= (dx * p.ratio) / (p.frame.scale * p.about.width);
      page.camera.y -= (dy * p.ratio) / (p.frame.scale * p.about.height);
    } else for (const q of page.panes) if (q.surface) { q.surface.shift[0] += (2 * dx) / q.box.w; q.surface.shift[1] -= (2 * dy) / q.box.h; }
    page.draw();
  },

  zoom(factor, e = null) { // about a place, or the middle
    if (page.view === "surface") for (const { surface } of page.panes) if (surface) surface.zoom = Math.max(0.3, Math.min(12, surface.zoom * factor));
    if (page.view === "picture") {
      const c = page.camera, scale = Math.max(0.5, Math.min(64, c.scale * factor)), pixel = e && this.pixelAt(e);
      if (pixel) {
        const { about } = page.panes[pixel.pane], part = 1 - c.scale / scale;
        c.x += (pixel.x / about.width - c.x) * part;
        c.y += (pixel.y / about.height - c.y) * part;
      }
      c.scale = scale;
    }
    page.draw();
  },

  fit() {
    page.camera = { x: 0.5, y: 0.5, scale: 1 };
    for (const { surface } of page.panes) if (surface) Object.assign(surface, { turn: 0.45, tilt: 0.3, zoom: 1, shift: [0, 0] });
    page.draw();
  },

  move(border) { page.border = Math.max(0, Math.min(1, border)); page.draw(); },

  point(pixel, dragging) { // an end of the line: the first, or the second one after it
    if (!pixel) return;
    const place = [pixel.x, pixel.y];
    if (!dragging && page.line && page.line.open && page.line.pane === pixel.pane) {
      page.line.ends[1] = place;
      page.line.open = false;
      return this.measured();
    }
    page.line = { pane: pixel.pane, ends: [place, place], open: !dragging };
    page.drawing = dragging;
    page.draw();
  },

  measured() {
    const { pane, ends } = page.line, p = page.panes[pane];
    page.draw();
    if (Math.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]) < 1) return this.clear();
    if (p.about.relief) measure.show(p, ends).then(() => { document.body.dataset.profile = at("profile-said").textContent; });
  },

  clear() { page.line = null; at("profile").hidden = true; page.draw(); },

  key(e) { // on the stage; true if it meant something
    if (e.ctrlKey || e.metaKey || e.altKey) return false;
    const acts = { "+": () => this.zoom(1.25), "=": () => this.zoom(1.25), "-": () => this.zoom(0.8), 0: () => this.fit(), Escape: () => this.clear(),
      "[": () => this.move(page.border - 0.02), "]": () => this.move(page.border + 0.02), l: () => this.set("tool", "light"), m: () => this.set("tool", "move"),
      d: () => this.set("tool", "measure"), p: () => this.set("view", "picture"), s: () => this.set("view", "surface"), Enter: () => this.enter() };
    MODES.forEach((mode, k) => { acts[k + 1] = () => this.set("mode", mode); });
    if (acts[e.key]) { acts[e.key](); return true; }
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (!step) return false;
    if (page.tool === "light") return dome.key(e);
    if (page.tool === "move") this.drag(...step.map((v) => (page.view === "picture" ? -v : v) * (e.shiftKey ? 60 : 14)), false);
    else this.cross(step, e.shiftKey ? 10 : 1);
    return true;
  },

  cross(step, size) { // moves the cross by pixels of the screen, or of the result where these are larger
    const k = page.cursor?.pane ?? 0, p = page.panes[k], { width, height } = p.about, c = page.cursor ?? { x: width / 2, y: height / 2 };
    const unit = size * Math.max(1, Math.round((2 * p.ratio) / p.frame.scale)); // never less than a pixel
    const pixel = { pane: k, x: Math.max(0, Math.min(width - 1, c.x + step[0] * unit)), y: Math.max(0, Math.min(height - 1, c.y + step[1] * unit)) };
    if (page.line?.open) page.line.ends[1] = [pixel.x, pixel.y];
    this.look(pixel);
    page.draw();
  },

  enter() {
    if (page.tool === "light") { page.held = !page.held; return this.pressed(); }
    if (page.tool !== "measure") return;
    if (!page.cursor) this.cross([0, 0], 1);
    this.point(page.cursor, false);
  },
};
