// Numbers: what lies under the pointer, and heights along a line.
const measure = {
  // The stored numbers of a layer at a pixel of the result, from its largest size here; null where there are none.
  async stored(pane, layer, x, y, level = pane.about.first) {
    const px = Math.floor((x + 0.5) / 2 ** level),
      py = Math.floor((y + 0.5) / 2 ** level),
      [w, h] = pane.about.sizes[level];
    if (px < 0 || py < 0 || px >= w || py >= h) return null;
    const tx = Math.floor(px / SIDE),
      ty = Math.floor(py / SIDE);
    const tile = await page.tiles.whole(pane.index, pane.about, layer, level, tx, ty);
    if (!tile.values) return null;
    const c = tile.values.length / (tile.w * tile.h),
      i = c * ((py - ty * SIDE + 1) * tile.w + px - tx * SIDE + 1);
    return Array.from(tile.values.subarray(i, i + c));
  },

  height: (about, level) => (level ? about.relief.low + (level - 1) * about.relief.step : NaN), // in pixels

  // A length in millimetres, where a pixel's width is known, else in pixels of the photographs; to three figures.
  number(about, px) {
    const v = px * (about.mm_per_px || about.every),
      digits = 2 - Math.floor(Math.log10(Math.abs(v) || 1));
    return v.toFixed(Math.max(0, Math.min(about.mm_per_px ? 4 : 2, digits))).replace(/^-(?=[0.]+$)/, ""); // no -0.00
  },

  unit: (about) => (about.mm_per_px ? "mm" : "px"),

  length(about, px) {
    return `${this.number(about, px)} ${this.unit(about)}`;
  },

  // The colour of the albedo at a pixel, 0 to 255 as it is shown.
  async colour(pane, x, y) {
    const level = pane.about.first,
      [px, py] = [x, y].map((v) => Math.floor((v + 0.5) / 2 ** level)),
      [tx, ty] = [px, py].map((v) => Math.floor(v / SIDE));
    const tile = await page.tiles.whole(pane.index, pane.about, "albedo", level, tx, ty);
    if (!tile.picture) return null;
    const pen = new OffscreenCanvas(1, 1).getContext("2d");
    pen.drawImage(tile.picture, -(px - tx * SIDE + 1), -(py - ty * SIDE + 1));
    return [...pen.getImageData(0, 0, 1, 1).data].slice(0, 3);
  },

  async values(pane, x, y) {
    // rows of names and texts
    const { about } = pane,
      place = [x, y].map((v, k) => Math.floor(v) * about.every + about.origin[k]),
      rows = [["Pixel", place.join(", ")]];
    const normal = await this.stored(pane, "normals", Math.floor(x), Math.floor(y));
    if (!normal || !normal.some(Boolean)) return [...rows, ["", "outside the object"]];
    const size = Math.hypot(...normal),
      n = normal.map((v) => v / size);
    rows.push(["Normal", n.map((v) => v.toFixed(3)).join(", ")]);
    rows.push(["Slope", `${((Math.acos(Math.min(1, n[2])) * 180) / Math.PI).toFixed(1)}°`]);
    if (about.relief) {
      const [level] = await this.stored(pane, "height", Math.floor(x), Math.floor(y));
      rows.push(["Height", level ? this.length(about, this.height(about, level)) : "not known"]);
    }
    const colour = about.layers.albedo && (await this.colour(pane, Math.floor(x), Math.floor(y)));
    if (colour) rows.push(["Albedo", `about ${colour.join(", ")} of 255`]); // colours are WebP
    for (const layer of ["expected", "error"])
      if (about.layers[layer]) {
        const [level] = await this.stored(pane, layer, Math.floor(x), Math.floor(y));
        rows.push([LAYERS[layer], level === data.unknown ? "not known" : angle(level)]);
      }
    return rows;
  },

  // Places and heights along a line, in pixels; heights are NaN where one of the four pixels around has none.
  async profile(pane, [x0, y0], [x1, y1]) {
    const { about } = pane,
      length = Math.hypot(x1 - x0, y1 - y0);
    const level = Math.max(
      about.first,
      Math.min(about.sizes.length - 1, Math.ceil(Math.log2(Math.max(1, length / 1024)))),
    );
    const count = Math.max(2, Math.min(1025, Math.ceil(length / 2 ** level) + 1)),
      found = [];
    for (let k = 0; k < count; k++) {
      const t = k / (count - 1),
        x = (x0 + t * (x1 - x0)) / 2 ** level - 0.5,
        y = (y0 + t * (y1 - y0)) / 2 ** level - 0.5;
      const a = Math.floor(x),
        b = Math.floor(y),
        u = x - a,
        v = y - b;
      let height = 0;
      for (const [dx, dy, part] of [
        [0, 0, (1 - u) * (1 - v)],
        [1, 0, u * (1 - v)],
        [0, 1, (1 - u) * v],
        [1, 1, u * v],
      ]) {
        if (part < 1e-9) continue;
        const one = await this.stored(pane, "height", (a + dx) * 2 ** level, (b + dy) * 2 ** level, level);
        height += part * (one ? this.height(about, one[0]) : NaN);
      }
      found.push([t * length, height]);
    }
    return found;
  },

  async show(pane, line) {
    // draws the chart
    const { about } = pane,
      rows = about.relief ? await this.profile(pane, ...line) : [],
      known = rows.filter(([, z]) => z === z),
      length = Math.hypot(line[1][0] - line[0][0], line[1][1] - line[0][1]);
    if (page.line?.ends !== line) return; // it was removed meanwhile, or another one drawn
    at("profile").hidden = false;
    if (known.length < 2) {
      at("chart").replaceChildren();
      at("chart").onpointermove = at("chart").onpointerleave = null;
      at("profile-said").textContent =
        `Length ${this.length(about, length)}. ${about.relief ? "No heights are known along it" : "This result has no depth"}.`;
      return;
    }
    const low = Math.min(...known.map((r) => r[1])),
      high = Math.max(...known.map((r) => r[1])),
      range = Math.max(high - low, 1e-6);
    const px = (d) => 46 + (264 * d) / Math.max(length, 1e-6),
      py = (z) => 138 - (124 * (z - low)) / range;
    let path = "",
      pen = "M";
    for (const [d, z] of rows) {
      if (z === z) {
        path += `${pen}${px(d).toFixed(1)} ${py(z).toFixed(1)}`;
        pen = "L";
      } else pen = "M";
    }
    const texts = [
      svg("text", { x: 42, y: 18, "text-anchor": "end" }, this.number(about, range)),
      svg("text", { x: 42, y: 142, "text-anchor": "end" }, "0"),
      svg("text", { x: 46, y: 158 }, "0"),
      svg("text", { x: 310, y: 158, "text-anchor": "end" }, this.length(about, length)),
      svg("text", { x: 4, y: 80 }, this.unit(about)),
    ];
    const here = svg("line", { class: "here", y1: 14, y2: 138, x1: -9, x2: -9 });
    at("chart").replaceChildren(
      svg("path", { class: "axis", d: "M46 10V138H310", fill: "none" }),
      svg("path", { class: "curve", d: path }),
      here,
      ...texts,
    );
    const said = `Length ${this.length(about, length)}, heights differ by ${this.length(about, range)}, the ends by ${this.length(about, known[known.length - 1][1] - known[0][1])}.`;
    at("profile-said").textContent = said;
    at("chart").onpointermove = (e) => {
      const box = at("chart").getBoundingClientRect(),
        d = (((e.clientX - box.left) / box.width) * 320 - 46) / 264;
      const row = rows[Math.max(0, Math.min(rows.length - 1, Math.round(d * (rows.length - 1))))];
      here.setAttribute("x1", px(row[0]));
      here.setAttribute("x2", px(row[0]));
      at("profile-said").textContent =
        `At ${this.length(about, row[0])}: ${row[1] === row[1] ? this.length(about, row[1] - low) : "no height"}.`;
      const t = length ? row[0] / length : 0;
      page.cursor = {
        pane: page.line.pane,
        x: line[0][0] + t * (line[1][0] - line[0][0]),
        y: line[0][1] + t * (line[1][1] - line[0][1]),
      };
      page.overlay();
    };
    at("chart").onpointerleave = () => {
      at("profile-said").textContent = said;
    };
  },
};
