// What people do on the picture itself: pointer, fingers and keys.
Object.assign(input, {
  paneAt(e) {
    // the pane under an event, and where in it, in the stage's pixels
    const box = at("stage").getBoundingClientRect(),
      x = e.clientX - box.left,
      y = e.clientY - box.top;
    const k = Math.max(
      0,
      page.panes.findIndex(({ box: b }) => x >= b.x && y >= b.y && x < b.x + b.w && y < b.y + b.h),
    );
    return { k, p: page.panes[k], x: x - page.panes[k].box.x, y: y - page.panes[k].box.y };
  },

  pixelAt(e) {
    // the result's pixel under an event; null where the surface is not met
    const { k, p, x, y } = this.paneAt(e);
    if (page.view === "picture")
      return { pane: k, x: (x * p.ratio - p.frame.x) / p.frame.scale, y: (y * p.ratio - p.frame.y) / p.frame.scale };
    const found = p.size && p.surface.pick(x / p.box.w, y / p.box.h, p.pane);
    return (
      found && {
        pane: k,
        x: ((found[0] + 0.5) / p.surface.grid[0]) * p.about.width,
        y: ((found[1] + 0.5) / p.surface.grid[1]) * p.about.height,
      }
    );
  },

  pointers() {
    const stage = at("stage"),
      border = at("border");
    border.addEventListener("pointerdown", (e) => {
      e.stopPropagation();
      border.setPointerCapture(e.pointerId);
    });
    border.addEventListener("pointermove", (e) => {
      e.stopPropagation();
      if (!border.hasPointerCapture(e.pointerId)) return;
      const { box } = page.panes[0];
      this.move((e.clientX - stage.getBoundingClientRect().left - box.x) / box.w);
    });
    at("size").addEventListener("pointerdown", (e) => e.stopPropagation());
    stage.addEventListener("pointerdown", (e) => {
      if (e.button) return; // its menu may keep the end of it to itself
      stage.setPointerCapture(e.pointerId);
      stage.focus({ preventScroll: true });
      this.fingers.set(e.pointerId, e);
      this.started = {
        x: e.clientX,
        y: e.clientY,
        moved: false,
        several: this.fingers.size > 1 || this.started?.several,
      };
      if (page.tool === "measure" && this.fingers.size === 1) this.point(this.pixelAt(e), page.view === "picture");
      if (page.tool === "light" && e.pointerType !== "mouse") this.shine(e);
    });
    stage.addEventListener("pointermove", (e) => this.moved(e));
    const ended = (e) => {
      const tapped = this.started && !this.started.moved && !this.started.several;
      this.fingers.delete(e.pointerId);
      if (this.fingers.size) return;
      this.started = null;
      if (tapped && page.tool === "light" && e.pointerType === "mouse") {
        page.held = !page.held;
        this.pressed();
      }
      if (page.drawing) {
        page.drawing = false;
        this.measured();
      }
    };
    stage.addEventListener("pointerup", ended);
    stage.addEventListener("pointercancel", ended);
    stage.addEventListener(
      "wheel",
      (e) => {
        e.preventDefault();
        this.zoom(Math.exp(-e.deltaY / 500), e);
      },
      { passive: false },
    );
    stage.addEventListener("dblclick", () => {
      if (page.tool === "move") this.fit();
    });
  },

  moved(e) {
    const before = this.fingers.get(e.pointerId);
    if (before && Math.hypot(e.clientX - this.started.x, e.clientY - this.started.y) > 4) this.started.moved = true;
    if (this.fingers.size === 2 && before) {
      const [a, b] = [...this.fingers.values()],
        other = a.pointerId === e.pointerId ? b : a;
      const size = (m) => Math.hypot(m.clientX - other.clientX, m.clientY - other.clientY);
      this.shift((e.clientX - before.clientX) / 2, (e.clientY - before.clientY) / 2);
      this.zoom(size(e) / Math.max(1, size(before)), {
        clientX: (e.clientX + other.clientX) / 2,
        clientY: (e.clientY + other.clientY) / 2,
      });
    } else if (page.tool === "light" && !page.held && (e.pointerType === "mouse" || before)) this.shine(e);
    else if (page.tool === "move" && before)
      this.drag(e.clientX - before.clientX, e.clientY - before.clientY, e.shiftKey);
    else if (page.tool === "measure" && page.drawing && page.line) {
      const pixel = this.pixelAt(e);
      if (pixel) {
        page.line.ends[1] = [pixel.x, pixel.y];
        page.draw();
      }
    }
    if (before) this.fingers.set(e.pointerId, e);
    const pixel = this.pixelAt(e);
    if (pixel) this.look(pixel);
  },

  look(pixel) {
    // the values there, once the pointer rests
    page.cursor = pixel;
    page.overlay();
    clearTimeout(this.resting);
    this.resting = setTimeout(async () => {
      const rows = await measure.values(page.panes[pixel.pane], pixel.x, pixel.y);
      if (page.cursor === pixel) fill(at("values"), rows);
    }, 60);
  },

  shine(e) {
    const { p, x, y } = this.paneAt(e),
      r = Math.min(p.box.w, p.box.h) / 2;
    dome.set([(x - p.box.w / 2) / r, (p.box.h / 2 - y) / r]);
  },

  drag(dx, dy, aside) {
    // the picture with the pointer; the surface turns, or moves
    if (page.view === "picture" || aside) return this.shift(dx, dy);
    for (const { surface } of page.panes)
      if (surface) {
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
    } else
      for (const q of page.panes)
        if (q.surface) {
          q.surface.shift[0] += (2 * dx) / q.box.w;
          q.surface.shift[1] -= (2 * dy) / q.box.h;
        }
    page.draw();
  },

  zoom(factor, e = null) {
    // about a place, or the middle
    if (page.view === "surface")
      for (const { surface } of page.panes)
        if (surface) surface.zoom = Math.max(0.3, Math.min(12, surface.zoom * factor));
    if (page.view === "picture") {
      const c = page.camera,
        scale = Math.max(0.5, Math.min(64, c.scale * factor)),
        pixel = e && this.pixelAt(e);
      if (pixel) {
        const { about } = page.panes[pixel.pane],
          part = 1 - c.scale / scale;
        c.x += (pixel.x / about.width - c.x) * part;
        c.y += (pixel.y / about.height - c.y) * part;
      }
      c.scale = scale;
    }
    page.draw();
  },

  fit() {
    page.camera = { x: 0.5, y: 0.5, scale: 1 };
    for (const { surface } of page.panes)
      if (surface) Object.assign(surface, { turn: 0.45, tilt: 0.3, zoom: 1, shift: [0, 0] });
    page.draw();
  },

  move(border) {
    page.border = Math.max(0, Math.min(1, border));
    page.draw();
  },

  point(pixel, dragging) {
    // an end of the line: the first, or the second one after it
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
    const { pane, ends } = page.line,
      p = page.panes[pane];
    page.draw();
    if (Math.hypot(ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]) < 1) return this.clear();
    measure.show(p, ends).then(() => {
      document.body.dataset.profile = at("profile-said").textContent;
    });
  },

  clear() {
    page.line = null;
    page.drawing = false;
    at("profile").hidden = true;
    page.draw();
  },

  key(e) {
    // on the stage; true if it meant something
    if (e.ctrlKey || e.metaKey || e.altKey || pressing(e)) return false;
    const acts = {
      "+": () => this.zoom(1.25),
      "=": () => this.zoom(1.25),
      "-": () => this.zoom(0.8),
      0: () => this.fit(),
      Escape: () => this.clear(),
      "[": () => this.move(page.border - 0.02),
      "]": () => this.move(page.border + 0.02),
      l: () => this.set("tool", "light"),
      m: () => this.set("tool", "move"),
      d: () => this.set("tool", "measure"),
      p: () => this.set("view", "picture"),
      s: () => this.set("view", "surface"),
      Enter: () => this.enter(),
    };
    MODES.forEach((mode, k) => {
      acts[k + 1] = () => this.set("mode", mode);
    });
    if (acts[e.key]) {
      acts[e.key]();
      return true;
    }
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[e.key];
    if (!step) return false;
    if (page.tool === "light") return dome.key(e);
    if (page.tool === "move")
      this.drag(...step.map((v) => (page.view === "picture" ? -v : v) * (e.shiftKey ? 60 : 14)), false);
    else this.cross(step, e.shiftKey ? 10 : 1);
    return true;
  },

  cross(step, size) {
    // moves the cross by pixels of the screen, or of the result where these are larger
    const k = page.cursor?.pane ?? 0,
      p = page.panes[k],
      { width, height } = p.about,
      c = page.cursor ?? { x: width / 2, y: height / 2 };
    const unit = size * Math.max(1, Math.round((2 * p.ratio) / p.frame.scale)); // never less than a pixel
    const pixel = {
      pane: k,
      x: Math.max(0, Math.min(width - 1, c.x + step[0] * unit)),
      y: Math.max(0, Math.min(height - 1, c.y + step[1] * unit)),
    };
    if (page.line?.open) page.line.ends[1] = [pixel.x, pixel.y];
    this.look(pixel);
    page.draw();
  },

  enter() {
    if (page.tool === "light") {
      page.held = !page.held;
      return this.pressed();
    }
    if (page.tool !== "measure") return;
    if (!page.cursor) this.cross([0, 0], 1);
    this.point(page.cursor, false);
  },
});
