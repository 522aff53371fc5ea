// What people do on the marking page: pointer, fingers, keys, fields.
Object.assign(mark, {
  wire() {
    for (const b of document.querySelectorAll("button[data-tool]"))
      b.addEventListener("click", () => this.choose(b.dataset.tool));
    const click = (id, act) => at(id).addEventListener("click", act);
    click("save", () => this.save());
    at("asked").addEventListener("close", () => {
      if (at("asked").returnValue === "yes") this.save(true);
    });
    click("help-open", () => at("help").showModal());
    click("ground", () => {
      const light = document.documentElement.dataset.ground !== "light";
      document.documentElement.dataset.ground = light ? "light" : "dark";
      at("ground").textContent = light ? "Dark ground" : "Light ground";
    });
    click("larger", () => this.zoom(1.25));
    click("smaller", () => this.zoom(0.8));
    click("fit", () => this.fit());
    click("before", () => this.show(this.shown - 1));
    click("after", () => this.show(this.shown + 1));
    at("shown").addEventListener("change", () => this.show(Number(at("shown").value)));
    at("used").addEventListener("change", () => this.use(at("used").checked));
    const fill = (inside) => {
      brush.fill(inside);
      this.draw();
    };
    click("undo", () => {
      brush.undo();
      this.draw();
    });
    click("suggested", () => fill((i) => brush.first[i]));
    click("all", () => fill(() => 1));
    click("none", () => fill(() => 0));
    const wide = () => {
      at("brush-said").textContent = `${Math.round(this.width() * data.step)} px`;
      this.draw();
    };
    at("brush").addEventListener("input", wide);
    at("brush-said").textContent = `${Math.round(this.width() * data.step)} px`;
    click("find", () => this.find());
    click("unsphere", () => {
      this.sphere = null;
      this.look();
    });
    click("uncrop", () => {
      this.crop = null;
      this.numbers();
      this.draw();
    });
    for (const id of ["sphere-x", "sphere-y", "sphere-r"])
      at(id).addEventListener("change", () => {
        const [x, y, r] = ["x", "y", "r"].map((k) => parseFloat(at(`sphere-${k}`).value));
        if ([x, y, r].every(Number.isFinite) && r > 2) {
          this.sphere = { x: reduced(x), y: reduced(y), r: r / data.step };
          this.look(0);
        }
      });
    for (const k of [0, 1, 2, 3])
      at(`crop-${k}`).addEventListener("change", () => {
        const found = [0, 1, 2, 3].map(
          (i) => parseFloat(at(`crop-${i}`).value || [0, 0, data.width, data.height][i]) / data.step,
        );
        if (found[2] > found[0] && found[3] > found[1]) this.crop = found;
        this.numbers();
        this.draw();
      });
    this.pointers();
    at("stage").addEventListener("keydown", (e) => {
      if (this.key(e)) e.preventDefault();
    });
  },

  use(yes) {
    if (yes) this.left_out.delete(this.shown);
    else this.left_out.add(this.shown);
    this.pictures();
    this.draw();
  },

  spot(e) {
    // of the photograph under an event
    const box = at("stage").getBoundingClientRect();
    return [
      (e.clientX - box.left - this.frame.x) / this.frame.scale - 0.5,
      (e.clientY - box.top - this.frame.y) / this.frame.scale - 0.5,
    ];
  },

  pointers() {
    const stage = at("stage");
    at("size").addEventListener("pointerdown", (e) => e.stopPropagation());
    stage.addEventListener("pointerdown", (e) => {
      if (e.button) return; // its menu may keep the end of it to itself
      stage.setPointerCapture(e.pointerId);
      stage.focus({ preventScroll: true });
      this.fingers.set(e.pointerId, e);
      if (this.fingers.size > 1) {
        if (this.held === "brush") brush.undo();
        this.held = null;
        return;
      }
      this.begin(this.spot(e));
    });
    stage.addEventListener("pointermove", (e) => this.moved(e));
    const ended = (e) => {
      this.fingers.delete(e.pointerId);
      if (this.held === "sphere" || this.held === "edge") this.look(0);
      this.held = null;
    };
    stage.addEventListener("pointerup", ended);
    stage.addEventListener("pointercancel", ended);
    stage.addEventListener(
      "wheel",
      (e) => {
        e.preventDefault();
        this.zoom(Math.exp(-e.deltaY / 500), this.spot(e));
      },
      { passive: false },
    );
  },

  begin(p) {
    this.last = p;
    const near = 14 / this.frame.scale,
      s = this.sphere;
    if (this.tool === "paint" || this.tool === "erase") {
      brush.keep();
      this.held = "brush";
      brush.stroke(p, p, this.width(), this.tool === "paint");
    } else if (this.tool === "sphere") {
      const d = s ? Math.hypot(p[0] - s.x, p[1] - s.y) : Infinity;
      this.held = Math.abs(d - s?.r) < near ? "edge" : d < s?.r ? "sphere" : "edge";
      if (d - (s?.r ?? 0) >= near) this.sphere = { x: p[0], y: p[1], r: 3 };
    } else if (this.tool === "crop") {
      this.held = "crop";
      this.crop = [...p, ...p].map((v) => v + 0.5);
    } else this.held = "move";
    this.draw();
  },

  moved(e) {
    const before = this.fingers.get(e.pointerId),
      p = this.spot(e);
    if (this.fingers.size === 2 && before) {
      const [a, b] = [...this.fingers.values()],
        other = a.pointerId === e.pointerId ? b : a;
      const size = (m) => Math.hypot(m.clientX - other.clientX, m.clientY - other.clientY);
      this.pan((e.clientX - before.clientX) / 2, (e.clientY - before.clientY) / 2);
      this.zoom(size(e) / Math.max(1, size(before)), this.spot(other));
    } else if (this.held === "brush") brush.stroke(this.last, p, this.width(), this.tool === "paint");
    else if (this.held === "sphere") {
      this.sphere.x += p[0] - this.last[0];
      this.sphere.y += p[1] - this.last[1];
      this.look();
    } else if (this.held === "edge") {
      this.sphere.r = Math.max(3, Math.hypot(p[0] - this.sphere.x, p[1] - this.sphere.y));
      this.look();
    } else if (this.held === "crop") {
      this.crop.splice(2, 2, p[0] + 0.5, p[1] + 0.5);
      this.numbers();
    } else if (this.held === "move" && before) this.pan(e.clientX - before.clientX, e.clientY - before.clientY);
    if (before) this.fingers.set(e.pointerId, e);
    this.cursor = this.last = p;
    this.draw();
  },

  pan(dx, dy) {
    this.camera.x -= dx / (this.frame.scale * data.shown[0]);
    this.camera.y -= dy / (this.frame.scale * data.shown[1]);
    this.draw();
  },

  zoom(factor, p = null) {
    const c = this.camera,
      scale = Math.max(0.5, Math.min(40, c.scale * factor)),
      part = 1 - c.scale / scale;
    if (p) {
      c.x += ((p[0] + 0.5) / data.shown[0] - c.x) * part;
      c.y += ((p[1] + 0.5) / data.shown[1] - c.y) * part;
    }
    c.scale = scale;
    this.draw();
  },

  fit() {
    this.camera = { x: 0.5, y: 0.5, scale: 1 };
    this.draw();
  },

  key(e) {
    if (e.ctrlKey || e.metaKey || e.altKey || pressing(e)) return false;
    const acts = {
      "+": () => this.zoom(1.25),
      "=": () => this.zoom(1.25),
      "-": () => this.zoom(0.8),
      0: () => this.fit(),
      "[": () => this.grow(-1),
      "]": () => this.grow(1),
      ",": () => this.show(this.shown - 1),
      ".": () => this.show(this.shown + 1),
      x: () => this.use(this.left_out.has(this.shown)),
      z: () => {
        brush.undo();
        this.draw();
      },
      " ": () => this.stamp(),
      Enter: () => this.enter(),
    };
    for (const [key, tool] of Object.entries(tools)) acts[key] = () => this.choose(tool);
    if (acts[e.key]) {
      acts[e.key]();
      return true;
    }
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (!step) return false;
    const by = (size) => step.map((v) => v * size * (e.shiftKey ? 8 : 1));
    if (this.tool === "move") this.pan(...by(-14));
    else if (this.tool === "sphere") {
      this.sphere ||= { x: data.shown[0] / 2, y: data.shown[1] / 2, r: Math.min(...data.shown) / 6 };
      const [dx, dy] = by(1 / data.step);
      this.sphere.x += dx;
      this.sphere.y += dy;
      this.look();
    } else this.carry(by(this.tool === "crop" ? 1 : Math.max(1, this.width() / 4)));
    return true;
  },

  carry([dx, dy]) {
    // the brush or the corner
    const before = this.cursor;
    this.cursor = [
      Math.max(0, Math.min(data.shown[0] - 1, before[0] + dx)),
      Math.max(0, Math.min(data.shown[1] - 1, before[1] + dy)),
    ];
    if (this.down && this.tool === "crop") {
      this.crop.splice(2, 2, ...this.cursor.map((v) => v + 0.5));
      this.numbers();
    } else if (this.down) brush.stroke(before, this.cursor, this.width(), this.tool === "paint");
    this.draw();
  },

  stamp() {
    if (this.tool !== "paint" && this.tool !== "erase") return;
    brush.keep();
    brush.stroke(this.cursor, this.cursor, this.width(), this.tool === "paint");
    this.draw();
  },

  enter() {
    if (this.tool === "move" || this.tool === "sphere") return;
    this.down = !this.down;
    if (this.down && this.tool === "crop") this.crop = [...this.cursor, ...this.cursor].map((v) => v + 0.5);
    else if (this.down) this.stamp();
    this.draw();
  },

  grow(sign) {
    if (this.tool === "sphere" && this.sphere) {
      this.sphere.r = Math.max(3, this.sphere.r + sign / data.step);
      return this.look();
    }
    at("brush").value = Number(at("brush").value) + 4 * sign;
    at("brush").dispatchEvent(new Event("input"));
  },
});

mark.start();
