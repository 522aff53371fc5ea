"""Folders for the web in a browser: a shader written from the description of info.json shows what `--relit` does."""

import http.server
import threading
from functools import partial

import numpy as np
import pytest

from photonormal.relighting import FORMATS
from photonormal.relighting.pictures import direction, relit_by_fit
from tests.browser import CHROMIUM, DRIVER, MISSING, Browser
from tests.relighting.test_files import dome, glossy, written

PAGE = """<!doctype html>
<link rel="icon" href="data:,">
<body style="margin: 0"><canvas></canvas><script>
const TERMS = {
  ptm: ([x, y]) => [1, x, y, x * x, x * y, y * y],
  hsh: ([x, y, c]) => {
    const phi = Math.atan2(y, x), pi = Math.PI, s = Math.sqrt(c - c * c), t = 2 * c - 1;
    return [Math.sqrt(1 / (2 * pi)), Math.sqrt(6 / pi) * Math.cos(phi) * s, Math.sqrt(3 / (2 * pi)) * t,
      Math.sqrt(6 / pi) * Math.sin(phi) * s, Math.sqrt(30 / pi) * Math.cos(2 * phi) * (c * c - c),
      Math.sqrt(30 / pi) * Math.cos(phi) * t * s, Math.sqrt(5 / (2 * pi)) * (1 - 6 * c + 6 * c * c),
      Math.sqrt(30 / pi) * Math.sin(phi) * t * s, Math.sqrt(30 / pi) * Math.sin(2 * phi) * (c * c - c)];
  },
};
const shader = (k) => `#version 300 es
precision highp float;
uniform vec3 scale[${k}], bias[${k}];
uniform float term[${k}];
${[...Array(k).keys()].map((j) => `uniform sampler2D plane${j};`).join("\\n")}
out vec4 colour;
void main() {
  ivec2 at = ivec2(gl_FragCoord.x, float(textureSize(plane0, 0).y) - gl_FragCoord.y);
  vec3 sum = vec3(0);
  ${[...Array(k).keys()].map((j) => `
  sum += (texelFetch(plane${j}, at, 0).rgb - bias[${j}]) * scale[${j}] * term[${j}];`).join("")}
  colour = vec4(sum, 1);
}`;
async function shown(folder, light) {
  const told = await (await fetch(`${folder}/info.json`)).json(), k = told.nplanes / 3;
  const canvas = document.querySelector("canvas");
  [canvas.width, canvas.height] = [told.width, told.height];
  const gl = canvas.getContext("webgl2", {preserveDrawingBuffer: true}), program = gl.createProgram();
  const corners = `#version 300 es
void main() { gl_Position = vec4(ivec2(gl_VertexID & 1, gl_VertexID >> 1) * 4 - 1, 0, 1); }`;
  for (const [kind, text] of [[gl.VERTEX_SHADER, corners], [gl.FRAGMENT_SHADER, shader(k)]]) {
    const part = gl.createShader(kind);
    gl.shaderSource(part, text); gl.compileShader(part); gl.attachShader(program, part);
  }
  gl.linkProgram(program); gl.useProgram(program);
  const place = (name) => gl.getUniformLocation(program, name), {scale, bias} = told.materials[0];
  gl.uniform3fv(place("scale"), scale); gl.uniform3fv(place("bias"), bias);
  gl.uniform1fv(place("term"), TERMS[told.type](light));
  for (let j = 0; j < k; j++) {
    const picture = new Image();
    picture.src = `${folder}/plane_${j}.jpg`;
    await picture.decode();
    gl.activeTexture(gl.TEXTURE0 + j); gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, picture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.uniform1i(place(`plane${j}`), j);
  }
  gl.viewport(0, 0, told.width, told.height); gl.drawArrays(gl.TRIANGLES, 0, 3);
  const found = new Uint8Array(4 * told.width * told.height);
  gl.readPixels(0, 0, told.width, told.height, gl.RGBA, gl.UNSIGNED_BYTE, found);
  return [told.height, told.width, ...found];
}
const run = (folder, light) => shown(folder, light).then((found) => { window.found = found; });
document.body.dataset.ready = "yes";
</script></body>
"""


@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason=MISSING)
def test_a_shader_shows_what_relit_shows(tmp_path):
    capture, light = glossy(dome(40)), direction(45, 40)
    (tmp_path / "page.html").write_text(PAGE)
    handler = partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, Browser(tmp_path / "profile") as browser:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser.open(f"http://127.0.0.1:{server.server_port}/page.html")
        for kind in ("openlime", "openlime-hsh"):
            folder = written(capture, kind, tmp_path / kind)
            browser.run("window.found = null; run(arguments[0], arguments[1])", f"{kind}/{folder.name}", light.tolist())
            h, w, *samples = browser.wait("return window.found")
            seen = np.array(samples, float).reshape(h, w, 4)[::-1, :, :3] / 255
            with relit_by_fit(capture, FORMATS[kind].basis) as relit:
                off = np.abs(seen - relit(light) / 255)
            assert off.mean() < 0.015 and np.quantile(off, 0.99) < 0.06, (kind, off.mean(), np.quantile(off, 0.99))
        assert not browser.errors()
        browser.call("POST", "/url", {"url": (folder / "index.html").as_uri()})
        assert "from a web server" in browser.text("#view")
        server.shutdown()
