// Without WebGL 2: the layers as small pictures, lit from the upper left.
const plain = {
  async show() {
    page.trouble(
      "This browser offers no WebGL 2, which the page needs to move the light. Here are its pictures. Another browser, or a newer one, shows all.",
    );
    const box = document.createElement("div");
    box.id = "plain";
    at("stage").append(box);
    for (const kind of ["wheel", "pointerdown", "pointermove"]) box.addEventListener(kind, (e) => e.stopPropagation());
    for (const [index, about] of data.results.entries())
      for (const layer of ["relit", "normals", "albedo", "expected"]) {
        const level = about.sizes.length - 1,
          stored = layer === "relit" ? "normals" : layer;
        if (!about.layers[stored]) continue;
        const tile = await page.tiles.whole(index, about, stored, level, 0, 0);
        if (tile.failed) return page.trouble(tile.failed);
        const figure = document.createElement("figure"),
          canvas = document.createElement("canvas"),
          said = document.createElement("figcaption");
        said.textContent = `${about.title}: ${LAYERS[layer].toLowerCase()}`;
        canvas.width = tile.w;
        canvas.height = tile.h;
        const pen = canvas.getContext("2d");
        if (tile.picture) pen.drawImage(tile.picture, 0, 0);
        else pen.putImageData(this.coloured(tile, layer), 0, 0);
        figure.append(canvas, said);
        box.append(figure);
      }
    document.body.dataset.plain = "yes";
  },

  coloured({ values, w, h }, layer) {
    const image = new ImageData(w, h),
      ramp = bytesOfText(data.colours);
    for (let i = 0; i < w * h; i++) {
      let rgb = null;
      const n = [0, 1, 2].map((c) => values[3 * i + c] / data.unit);
      if (layer === "normals" && n.some(Boolean)) rgb = n.map((v) => 127.5 * (v + 1));
      if (layer === "relit" && n.some(Boolean))
        rgb = Array(3).fill(255 * Math.max(0, -0.5 * n[0] + 0.5 * n[1] + 0.707 * n[2]) ** (1 / 2.2));
      if (layer === "expected" && values[i] !== data.unknown) {
        const colour = 3 * Math.min(255, Math.round((255 * values[i]) / (30 * data.levels_per_degree)));
        rgb = [0, 1, 2].map((c) => ramp[colour + c]);
      }
      if (rgb) image.data.set([...rgb, 255], 4 * i);
    }
    return image;
  },
};

page.start();
document.body.dataset.ready = "yes";
