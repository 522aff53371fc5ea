// The mask as a canvas that is opaque where the object is not.
const brush = {
  undone: [],
  changed: false,

  async start([w, h]) {
    this.canvas = Object.assign(document.createElement("canvas"), { width: w, height: h });
    this.pen = this.canvas.getContext("2d", { willReadFrequently: true });
    const answer = await fetch("mask");
    this.first = summed(await inflated(new Uint8Array(await answer.arrayBuffer())), Uint8Array, w, h, 1);
    this.fill((i) => this.first[i]);
    this.undone = [];
    this.changed = false;
  },

  fill(inside) {
    this.keep();
    const { width: w, height: h } = this.canvas,
      image = new ImageData(w, h);
    for (let i = 0; i < w * h; i++) if (!inside(i)) image.data.set([20, 40, 130, 255], 4 * i);
    this.pen.putImageData(image, 0, 0);
  },

  keep() {
    // for undoing
    this.changed = true;
    this.undone.push(this.pen.getImageData(0, 0, this.canvas.width, this.canvas.height));
    if (this.undone.length > 12) this.undone.shift();
  },

  undo() {
    const before = this.undone.pop();
    if (before) this.pen.putImageData(before, 0, 0);
  },

  stroke([x0, y0], [x1, y1], width, paint) {
    // on the object, or off it; pixel centres are whole numbers
    const { pen } = this;
    pen.globalCompositeOperation = paint ? "destination-out" : "source-over";
    pen.strokeStyle = "rgb(20, 40, 130)";
    pen.lineWidth = width;
    pen.lineCap = "round";
    pen.beginPath();
    pen.moveTo(x0 + 0.5, y0 + 0.5);
    pen.lineTo(x1 + 0.5 + 1e-3, y1 + 0.5);
    pen.stroke();
    pen.globalCompositeOperation = "source-over";
  },

  inside() {
    // 1 on the object
    const { width: w, height: h } = this.canvas,
      { data: pixels } = this.pen.getImageData(0, 0, w, h);
    return Uint8Array.from({ length: w * h }, (_, i) => (pixels[4 * i + 3] < 128 ? 1 : 0));
  },

  async text() {
    // as the program reads it
    const stream = new Blob([this.inside()]).stream().pipeThrough(new CompressionStream("deflate"));
    const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
    let text = "";
    for (let i = 0; i < bytes.length; i += 4096) text += String.fromCharCode(...bytes.subarray(i, i + 4096));
    return btoa(text);
  },
};
