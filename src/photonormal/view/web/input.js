// What people choose: buttons, sliders, layers, results. What they do on the picture itself is in pointer.js.
const names = {
  view: { picture: "Picture", surface: "Surface" },
  tool: { light: "Light", move: "Move", measure: "Measure" },
  mode: {
    lambert: "Matt",
    gloss: "Gloss",
    matt: "Shape only",
    specular: "Specular enhancement",
    raking: "Raking light",
  },
};
const explained = {
  lambert: "The albedo under a matt surface's shading.",
  gloss: "The albedo, and a highlight on top.",
  matt: "A white matt surface: the normals alone.",
  specular: "Little colour and strong highlights: wear, incisions and brush strokes stand out.",
  raking: "Light from low down. The hemisphere gives the direction, the slider the height.",
};
const touch = matchMedia("(pointer: coarse)").matches;
const follow = touch
  ? "Drag to move the light."
  : "The light follows the pointer. Click to hold it, click again to let go.";
const hints = {
  picture: {
    light: follow,
    move: touch ? "Drag to move, pinch to change the size." : "Drag to move, wheel to change the size.",
    measure: "Drag a line along which to see the heights.",
  },
  surface: {
    light: follow,
    move: touch
      ? "Drag to turn, pinch to change the size."
      : "Drag to turn, Shift and drag to move, wheel to change the size.",
    measure: "Click the two ends of a line.",
  },
};

const input = {
  fingers: new Map(),
  started: null,

  start() {
    for (const button of document.querySelectorAll("[data-set]"))
      button.addEventListener("click", () => this.set(button.dataset.set, button.dataset.value));
    const slide = (id, key, to, from, text) => {
      const element = at(id),
        said = element.parentElement.querySelector("output");
      element.value = from(page.look[key]);
      const take = () => {
        page.look[key] = to(Number(element.value));
        said.textContent = text(page.look[key]);
        page.photograph();
        page.draw();
      };
      element.addEventListener("input", take);
      take();
    };
    slide(
      "exposure",
      "exposure",
      (v) => 2 ** v,
      Math.log2,
      (v) => v.toFixed(1),
    );
    slide(
      "gloss",
      "gloss",
      (v) => v,
      (v) => v,
      (v) => v.toFixed(2),
    );
    slide(
      "sharpness",
      "sharpness",
      (v) => 2 ** v,
      Math.log2,
      (v) => v.toFixed(0),
    );
    slide(
      "raking",
      "raking",
      (v) => v,
      (v) => v,
      (v) => `${v}°`,
    );
    slide(
      "limit",
      "limit",
      (v) => v,
      (v) => v,
      (v) => `${v}°`,
    );
    for (const id of ["first", "second"])
      at(id).addEventListener("change", () => {
        page[id] = at(id).value;
        page.photograph();
        page.draw();
      });
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
    at("stage").addEventListener("keydown", (e) => {
      if (this.key(e)) e.preventDefault();
    });
    at("border").addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -0.02, ArrowDown: -0.02, ArrowRight: 0.02, ArrowUp: 0.02, Home: -1, End: 1 }[e.key];
      if (!step) return;
      e.preventDefault();
      e.stopPropagation();
      this.move(page.border + step * (e.shiftKey ? 5 : 1));
    });
    this.layers();
    this.pressed();
  },

  results() {
    if (data.results.length < 2) return;
    at("results").hidden = false;
    for (const k of [0, 1]) {
      at(`pane-${k}`).replaceChildren(
        ...data.results.map((r, i) => new Option(r.title, i)),
        ...(k ? [new Option("none", "")] : []),
      );
      at(`pane-${k}`).value = k;
      at(`pane-${k}`).addEventListener("change", () => {
        page.show(
          [at("pane-0").value, at("pane-1").value]
            .filter((v) => v !== "")
            .map(Number)
            .filter((v, i, all) => all.indexOf(v) === i),
        );
        this.layers();
        page.draw();
      });
    }
  },

  layers() {
    // choices of layers
    const there = page.available();
    if (!there.includes(page.first)) page.first = "relit";
    if (page.second && !there.includes(page.second)) page.second = "normals";
    at("first").replaceChildren(...there.map((l) => new Option(LAYERS[l], l)));
    at("second").replaceChildren(new Option("no border", ""), ...there.map((l) => new Option(LAYERS[l], l)));
    at("first").value = page.first;
    at("second").value = page.second;
  },

  set(what, value) {
    if (what === "mode") page.look.mode = value;
    else page[what] = value;
    if (what === "view" && page.gl) at("trouble").hidden = true;
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
    at("hint").textContent =
      page.held && page.tool === "light"
        ? "The light is held. Click to let it follow the pointer."
        : hints[page.view][page.tool];
    at("layers").hidden = page.view === "surface";
    const { mode } = page.look;
    at("mode-said").textContent = explained[mode];
    at("gloss-row").hidden = at("sharpness-row").hidden = mode !== "gloss" && mode !== "specular";
    at("raking-row").hidden = mode !== "raking";
  },
};
