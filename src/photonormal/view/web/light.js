// The light on its hemisphere, seen from the camera: the middle is the camera's side, the rim the object's plane.
const dome = {
  start(changed) {
    this.changed = changed;
    const dragged = (e) => {
      const box = at("dome").getBoundingClientRect();
      this.set([((e.clientX - box.left) / box.width - 0.5) * 2.2, (0.5 - (e.clientY - box.top) / box.height) * 2.2]);
    };
    at("dome").addEventListener("pointerdown", (e) => {
      at("dome").setPointerCapture(e.pointerId);
      dragged(e);
    });
    at("dome").addEventListener("pointermove", (e) => {
      if (e.buttons) dragged(e);
    });
    at("dome").addEventListener("keydown", (e) => {
      if (this.key(e)) e.preventDefault();
    });
    for (const id of ["azimuth", "elevation"])
      at(id).addEventListener("input", () => {
        const a = (Number(at("azimuth").value) * Math.PI) / 180,
          e = (Math.max(5, Math.min(90, Number(at("elevation").value))) * Math.PI) / 180;
        this.set([Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e)], id);
      });
  },

  key(e) {
    // moves the light by an arrow key; true if it was one
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (!step) return false;
    const size = e.shiftKey ? 0.2 : 0.05;
    this.set([this.light[0] + step[0] * size, this.light[1] + step[1] * size]);
    return true;
  },

  set([x, y], typed = null) {
    // the height is what is missing to length one; never quite in the object's plane
    const r = Math.hypot(x, y),
      most = Math.cos((5 * Math.PI) / 180);
    if (r > most) {
      x *= most / r;
      y *= most / r;
    }
    this.light = [x, y, Math.sqrt(1 - x * x - y * y)];
    at("sun").setAttribute("cx", 100 * x);
    at("sun").setAttribute("cy", -100 * y);
    const azimuth = Math.round((Math.atan2(y, x) * 180) / Math.PI + 360) % 360,
      elevation = Math.round((Math.asin(this.light[2]) * 180) / Math.PI);
    if (typed !== "azimuth" && Math.hypot(x, y) > 0.01) at("azimuth").value = azimuth;
    if (typed !== "elevation") at("elevation").value = elevation;
    this.changed(this.light);
  },

  lamps(lights, nearest) {
    // the real ones, null where one is not known
    at("lamps").replaceChildren(
      ...lights.flatMap((l, j) =>
        l
          ? [
              svg("circle", {
                cx: 100 * l[0],
                cy: -100 * l[1],
                r: j === nearest ? 6 : 2.2,
                class: j === nearest ? "near" : "",
              }),
            ]
          : [],
      ),
    );
  },
};

function svg(kind, attributes, text = "") {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.textContent = text;
  return element;
}

const nearestLight = (lights, light) => {
  let best = -2,
    found = -1;
  lights.forEach((l, j) => {
    const c = l[0] * light[0] + l[1] * light[1] + l[2] * light[2];
    if (c > best) {
      best = c;
      found = j;
    }
  });
  return found;
};
