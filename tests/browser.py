"""A headless Chromium, driven by its own WebDriver: real pointers, fingers and keys, and pictures of what they did."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import time
import urllib.error
import urllib.request

import cv2
import numpy as np

CHROMIUM = next((p for p in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if p), None)
DRIVER = shutil.which("chromedriver")
MISSING = "no Chromium with its driver here"
KEYS = {
    "Tab": "\ue004",
    "Enter": "\ue007",
    "Escape": "\ue00c",
    "Left": "\ue012",
    "Up": "\ue013",
    "Right": "\ue014",
    "Down": "\ue015",
    "Shift": "\ue008",
}
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"


class Browser:
    """One window of a size in pixels; a context."""

    def __init__(self, profile, size=(1440, 900), phone=False, arguments=()):
        self.profile, self.size, self.phone, self.arguments = profile, size, phone, arguments

    def __enter__(self):
        self.process = subprocess.Popen(
            ["nice", "-n", "10", DRIVER, "--port=0"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        port = next(
            re.search(r"successfully on port (\d+)", line)[1] for line in self.process.stdout if "successfully" in line
        )
        self.base = f"http://127.0.0.1:{port}/session"
        w, h = self.size
        options = {
            "binary": CHROMIUM,
            "args": [
                "--headless=new",
                "--no-sandbox",
                f"--user-data-dir={self.profile}",
                f"--window-size={w},{h}",
                "--hide-scrollbars",
                "--enable-unsafe-swiftshader",
                *self.arguments,
            ],
        }
        if self.phone:
            options["mobileEmulation"] = {"deviceMetrics": {"width": w, "height": h, "pixelRatio": 2, "touch": True}}
        capabilities = {"alwaysMatch": {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}}
        self.session = ""
        self.session = "/" + self.call("POST", "", {"capabilities": capabilities})["sessionId"]
        if not self.phone:  # the page itself gets this size
            inner = self.run("return [innerWidth, innerHeight]")
            self.call("POST", "/window/rect", {"width": 2 * w - inner[0], "height": 2 * h - inner[1]})
        return self

    def __exit__(self, *_):
        try:
            self.call("DELETE", "")
        finally:
            self.process.terminate()
            self.process.wait()
            self.process.stdout.close()

    def call(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            self.base + self.session + path, data, {"Content-Type": "application/json"}, method=method
        )
        try:
            with urllib.request.urlopen(request, timeout=180) as answer:
                return json.loads(answer.read())["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.loads(error.read())["value"]["message"].splitlines()[0]) from None

    def open(self, address):
        self.call("POST", "/url", {"url": address})
        self.wait("return document.body.dataset.ready === 'yes'")
        self.settle()

    def run(self, script, *arguments):
        return self.call("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def wait(self, script, *arguments, seconds=60):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            found = self.run(script, *arguments)
            if found:
                return found
            time.sleep(0.05)
        raise AssertionError(f"never true: {script}")

    def settle(self):
        """Until no tile is on its way and the frame is drawn."""
        still = 0
        while still < 3:
            time.sleep(0.15)
            still = still + 1 if self.run("return (document.body.dataset.waiting || '0') === '0'") else 0

    def find(self, selector):
        return self.call("POST", "/element", {"using": "css selector", "value": selector})[ELEMENT]

    def click(self, selector):
        self.call("POST", f"/element/{self.find(selector)}/click", {})

    def choose(self, selector, value):
        self.click(f'{selector} option[value="{value}"]')

    def text(self, selector):
        return self.call("GET", f"/element/{self.find(selector)}/text")

    def box(self, selector):
        return self.run(
            "const b = document.querySelector(arguments[0]).getBoundingClientRect();"
            "return [b.x, b.y, b.width, b.height]",
            selector,
        )

    def keys(self, *keys, shift=False):
        actions = [{"type": kind, "value": KEYS.get(k, k)} for k in keys for kind in ("keyDown", "keyUp")]
        if shift:
            actions = [{"type": "keyDown", "value": KEYS["Shift"]}, *actions, {"type": "keyUp", "value": KEYS["Shift"]}]
        self.call("POST", "/actions", {"actions": [{"type": "key", "id": "keys", "actions": actions}]})

    def drag(self, *places, kind="mouse", press=True, button=0):
        """Through places (x, y) of the window, pressed or not."""

        def to(x, y, duration=40):
            return {"type": "pointerMove", "x": round(x), "y": round(y), "duration": duration, "origin": "viewport"}

        acts = [to(*places[0], 0)] + [{"type": "pointerDown", "button": button}] * press
        acts += [to(*p) for p in places[1:]] + [{"type": "pointerUp", "button": button}] * press
        self.call(
            "POST",
            "/actions",
            {"actions": [{"type": "pointer", "id": kind, "parameters": {"pointerType": kind}, "actions": acts}]},
        )

    def pinch(self, centre, near, far):
        """Two fingers, `near` and then `far` pixels from the centre."""
        fingers = []
        for k, side in enumerate((-1, 1)):
            at = [
                {
                    "type": "pointerMove",
                    "x": round(centre[0] + side * d),
                    "y": round(centre[1]),
                    "duration": 60,
                    "origin": "viewport",
                }
                for d in (near, (near + far) / 2, far)
            ]
            acts = [at[0], {"type": "pointerDown", "button": 0}, *at[1:], {"type": "pointerUp", "button": 0}]
            fingers.append(
                {"type": "pointer", "id": f"finger{k}", "parameters": {"pointerType": "touch"}, "actions": acts}
            )
        self.call("POST", "/actions", {"actions": fingers})

    def picture(self, file=None):
        """What the window shows, (h, w, 3) RGB."""
        data = base64.b64decode(self.call("GET", "/screenshot"))
        if file:
            file.write_bytes(data)
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]

    def errors(self):
        """What the console complained of."""
        return [e["message"] for e in self.call("POST", "/se/log", {"type": "browser"}) if e["level"] == "SEVERE"]
