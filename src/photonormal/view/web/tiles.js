// Tiles as textures and as numbers. A tile has one pixel more on every side than the part of the picture that it shows.
const SIDE = 512;
const KEPT = 220;

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Rows of differences, low bytes before high ones -> whole numbers, channel by channel as they were stored.
function summed(bytes, Kind, w, h, c) {
  const values = new Kind(w * h * c),
    n = w * h,
    wide = Kind.BYTES_PER_ELEMENT === 2;
  for (let k = 0; k < c; k++) {
    for (let y = 0, i = 0; y < h; y++) {
      let sum = 0;
      for (let x = 0; x < w; x++, i++) {
        sum += bytes[k * n + i] + (wide ? bytes[(c + k) * n + i] << 8 : 0);
        values[i * c + k] = sum; // wraps around as it did where it was stored
      }
    }
  }
  return values;
}

// What the level of an angle says; the last one but that of unknown ones is of all larger angles.
const angle = (level) =>
  `${(level / data.levels_per_degree).toFixed(1)}°${level === data.unknown - 1 ? " or more" : ""}`;

class Tiles {
  constructor(gl, source, changed) {
    this.gl = gl; // null: numbers only
    this.source = source; // path -> bytes
    this.changed = changed;
    this.kept = new Map();
    this.time = 0;
    this.frame = Infinity; // the time at which the last frame began, where frames are told: what it shows is kept
    this.loading = 0;
  }

  // The tile if it is here; else null, and it is asked for. Needs: index of the result, what is known of it, layer, level, column, row.
  get(index, about, layer, level, x, y) {
    const path = `tile/${index}/${layer}/${level}/${x}/${y}`;
    let tile = this.kept.get(path);
    if (!tile) {
      tile = { ready: false, promise: null };
      this.kept.set(path, tile);
      tile.promise = this.load(tile, path, about, layer, level, x, y);
    }
    tile.time = ++this.time;
    return tile.ready ? tile : null;
  }

  async whole(index, about, layer, level, x, y) {
    // the same, waited for
    const tile = this.get(index, about, layer, level, x, y);
    if (tile) return tile;
    const asked = this.kept.get(`tile/${index}/${layer}/${level}/${x}/${y}`);
    await asked.promise;
    return asked;
  }

  async load(tile, path, about, layer, level, x, y) {
    this.loading++;
    try {
      const [w, h] = about.sizes[level];
      tile.w = Math.min(SIDE, w - x * SIDE) + 2;
      tile.h = Math.min(SIDE, h - y * SIDE) + 2;
      tile.kind = layer.startsWith("photograph") ? "colour" : about.layers[layer];
      const bytes = await this.source(path);
      if (tile.kind === "colour") tile.picture = await createImageBitmap(new Blob([bytes], { type: "image/webp" }));
      else {
        const [Kind, c] = { normals: [Int16Array, 3], height: [Uint16Array, 1], degrees: [Uint8Array, 1] }[tile.kind];
        tile.values = summed(await inflated(bytes), Kind, tile.w, tile.h, c);
      }
      if (this.gl) tile.texture = this.upload(tile, about, level);
      tile.ready = true;
      this.forget();
    } catch (error) {
      tile.failed = String(error.message || error);
    }
    this.loading--;
    this.changed(tile.failed);
  }

  upload(tile, about, level) {
    const gl = this.gl,
      { w, h, kind } = tile;
    const texture = textureOf(gl, kind !== "degrees"); // angles belong to their pixels
    if (kind === "colour") gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, tile.picture);
    if (kind === "degrees") gl.texImage2D(gl.TEXTURE_2D, 0, gl.R8, w, h, 0, gl.RED, gl.UNSIGNED_BYTE, tile.values);
    if (kind === "normals") {
      const unit = Float32Array.from(tile.values, (v) => v / data.unit);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, w, h, 0, gl.RGB, gl.FLOAT, unit);
    }
    if (kind === "height")
      gl.texImage2D(
        gl.TEXTURE_2D,
        0,
        gl.RGBA16F,
        w,
        h,
        0,
        gl.RGBA,
        gl.FLOAT,
        this.slopes(tile, about.relief.step / 2 ** level),
      );
    return texture;
  }

  // Of every pixel the normal of the heights around it (x, y), the height between 0 and 1, and whether there is one.
  slopes({ values, w, h }, step) {
    const found = new Float32Array(4 * w * h);
    const slope = (i, back, on) => {
      const a = back >= 0 && values[back] ? back : i,
        b = on >= 0 && values[on] ? on : i;
      return a === b ? 0 : (step * (values[b] - values[a])) / (a !== i && b !== i ? 2 : 1);
    };
    for (let y = 0, i = 0; y < h; y++)
      for (let x = 0; x < w; x++, i++) {
        if (!values[i]) continue;
        const p = slope(i, x ? i - 1 : -1, x + 1 < w ? i + 1 : -1),
          q = slope(i, y + 1 < h ? i + w : -1, y ? i - w : -1);
        const length = Math.hypot(p, q, 1);
        found.set([-p / length, -q / length, (values[i] - 1) / 65534, 1], 4 * i);
      }
    return found;
  }

  forget() {
    // the tiles that were not drawn for longest
    if (this.kept.size <= KEPT) return;
    const old = [...this.kept]
      .filter(([, t]) => t.ready && t.time <= this.frame)
      .sort((a, b) => a[1].time - b[1].time)
      .slice(0, this.kept.size - KEPT);
    for (const [path, tile] of old) {
      if (tile.texture) this.gl.deleteTexture(tile.texture);
      this.kept.delete(path);
    }
  }
}
