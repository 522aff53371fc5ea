// What lies over the drawing, and beside it: lines, crosses, names, scales, facts.
Object.assign(page, {
  place(p, x, y) {
    // of a result's pixel, in the stage's own pixels; null where the surface has none
    if (this.view === "picture")
      return [p.box.x + (p.frame.x + x * p.frame.scale) / p.ratio, p.box.y + (p.frame.y + y * p.frame.scale) / p.ratio];
    if (!p.size) return null;
    const [w, h] = p.surface.grid,
      clamp = (v, n) => Math.max(0, Math.min(n - 1, v));
    const found = p.surface.project(
      clamp((x / p.about.width) * w - 0.5, w),
      clamp((y / p.about.height) * h - 0.5, h),
      p.pane,
    );
    return found && [p.box.x + found[0] * p.box.w, p.box.y + found[1] * p.box.h];
  },

  overlay() {
    // lines, crosses, labels, the border
    const shapes = [];
    if (this.line)
      for (const p of this.panes) {
        const [a, b] = this.line.ends,
          steps = this.view === "picture" ? 1 : 120,
          points = [];
        for (let k = 0; k <= steps; k++)
          points.push(this.place(p, a[0] + ((b[0] - a[0]) * k) / steps, a[1] + ((b[1] - a[1]) * k) / steps));
        const seen = points.filter(Boolean);
        if (!seen.length) continue;
        const d = seen.map(([x, y], k) => `${k ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`).join("");
        shapes.push(svg("path", { d, class: "halo" }), svg("path", { d }));
        for (const [x, y] of [seen[0], seen[seen.length - 1]]) shapes.push(svg("circle", { cx: x, cy: y, r: 5 }));
      }
    const c = this.cursor,
      spot = c && this.panes[c.pane] && this.place(this.panes[c.pane], c.x, c.y);
    if (spot && (this.tool === "measure" || this.line)) {
      const d = `M${spot[0] - 9} ${spot[1]}h18M${spot[0]} ${spot[1] - 9}v18`;
      shapes.push(svg("path", { d, class: "cross halo" }), svg("path", { d, class: "cross" }));
    }
    const two = this.view === "picture" && Boolean(this.second),
      b = at("border"),
      labels = [];
    this.panes.forEach((p, k) => {
      const x = p.box.x + this.border * p.box.w;
      if (two && k)
        shapes.push(
          svg("path", { d: `M${x} ${p.box.y}v${p.box.h}`, class: "cross halo" }),
          svg("path", { d: `M${x} ${p.box.y}v${p.box.h}`, class: "cross" }),
        );
      if (two && !k) {
        b.style.left = `${x}px`;
        b.style.top = `${p.box.y}px`;
        b.style.bottom = "auto";
        b.style.height = `${p.box.h}px`;
      }
      const tag = (text, style, name = "") => {
        const span = document.createElement("span");
        span.textContent = text;
        span.className = name;
        Object.assign(span.style, style);
        labels.push(span);
      };
      if (two && this.border > 0.08)
        tag(this.said(this.second, p), {
          left: `${p.box.x + 10}px`,
          top: `${p.box.y + 10}px`,
          maxWidth: `${Math.max(0, this.border * p.box.w - 24)}px`,
        });
      if (this.view === "picture" && (!two || this.border < 0.92))
        tag(this.said(this.first, p), {
          right: `${at("stage").clientWidth - p.box.x - p.box.w + 10}px`,
          top: `${p.box.y + 10}px`,
          maxWidth: `${Math.max(0, (1 - (two ? this.border : 0)) * p.box.w - 24)}px`,
        });
      if (this.panes.length > 1)
        tag(p.about.title, { left: `${p.box.x + 10}px`, top: `${p.box.y + p.box.h - 68}px`, bottom: "auto" });
    });
    b.hidden = !two;
    b.setAttribute("aria-valuenow", Math.round(100 * this.border));
    at("labels").replaceChildren(...labels);
    at("overlay").replaceChildren(...shapes);
  },

  said(layer, p) {
    // a layer's name, and what there is to say of it where there is room
    if (p.box.w < 360) return LAYERS[layer];
    if (layer === "photograph" && p.shot) return `Photograph ${p.shot.name}`;
    if (layer === "relit") return `Relit: ${names.mode[this.look.mode].toLowerCase()}`;
    return LAYERS[layer];
  },

  legend() {
    const shown = this.view === "picture" ? [this.first, this.second] : [];
    const degrees = shown.some((l) => l === "expected" || l === "error"),
      height = shown.includes("height");
    at("legend").hidden = !(degrees || height);
    at("limit-row").hidden = !degrees;
    at("legend-low").textContent = degrees ? "0°" : "lowest";
    const about = this.panes[0].about;
    at("legend-high").textContent = degrees
      ? `${this.look.limit}° and more`
      : about.relief
        ? `highest, ${measure.length(about, 65534 * about.relief.step)} above`
        : "";
    if (degrees && height) at("legend-low").textContent = "0°, lowest";
  },

  facts() {
    // about the results
    const rows = [],
      several = this.panes.length > 1;
    for (const { about } of this.panes) {
      if (several) rows.push([about.title, ""]);
      rows.push(["Method", about.method], ["Size", `${about.size.join(" x ")} px`]);
      if (about.mm_per_px) rows.push(["Scale", `${Number((about.mm_per_px / about.every).toPrecision(4))} mm a pixel`]);
      if (about.photographs.length) rows.push(["Photographs", String(about.lamps)]);
      if (about.expected_error_deg != null)
        rows.push(["Expected error", `${about.expected_error_deg.toFixed(1)}° on average`]);
      if (about.mean_error_deg != null) rows.push(["True error", `${about.mean_error_deg.toFixed(2)}° on average`]);
    }
    fill(at("facts"), rows);
    at("notes").replaceChildren(
      ...[...new Set(this.panes.flatMap((p) => p.about.notes))].map((note) =>
        Object.assign(document.createElement("li"), { textContent: note }),
      ),
    );
  },
});

const fill = (list, rows) =>
  list.replaceChildren(
    ...rows.flatMap(([name, text]) =>
      [
        ["dt", name],
        ["dd", text],
      ].map(([kind, content]) => Object.assign(document.createElement(kind), { textContent: content })),
    ),
  );
