"""Finding mirror spheres: rendered frames whose lights are known, through `photonormal calibrate`, rates for each kind.

    python benchmarks/sphere.py [--frames 10] [--seed 1] [--kinds coin,two] [--keep FOLDER] [--results FILE]

A frame is a scene under 6 to 48 lamps, in files as a camera writes them: one or two mirror balls, chrome, black or
red, 0.015 to 0.4 of the short side in radius, on a table that they mirror and shade; lamps of finite size and unequal
strength on a hemisphere or in rings, far away or near; noise, blur, 8 bits, JPEG or PNG. The camera is far away.

`right`: the mean angle to the true directions is at most 2 degrees. `told`: it is more, and a warning says so.
`silent`: it is more than 5 without a warning, `2 to 5`: less. `doubts` counts the right ones that come with a warning.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from photonormal.capture.lights import read_lights
from photonormal.geometry import angle_deg, normalised
from photonormal.rig.spheres import calibrate
from photonormal.types import InputError

SAMPLES = 5  # across the reflection of a lamp, at least
LENS = 0.4  # blur in pixels before there are pixels: without it a small lamp's place within its pixel leaves no trace
KINDS = ("alone", "coin", "bead", "plate", "table", "border", "two")
OUTCOMES = ("right", "refused", "told", "2 to 5", "silent")


@dataclass
class Ball:
    """Centre (3,) and radius in pixels; colour of its body; reflectance at right angles; width of its highlight."""

    C: np.ndarray
    r: float
    body: np.ndarray
    f0: float
    rough_deg: float = 0.0


@dataclass
class Scene:
    """A frame: x right, y up, z to the camera, in pixels from the frame's middle; the table passes through it."""

    shape: tuple[int, int]
    T: np.ndarray  # (3,) normal of the table
    albedo: np.ndarray  # (h, w, 3) of the table, seen by the camera
    around: np.ndarray  # (3,) of the table outside the frame
    extent: float  # of the table, from the middle
    slopes: np.ndarray  # (h, w, 2) of what lies on it
    gloss: float  # of the table
    lamps: np.ndarray  # (n, 3) positions
    size_deg: float  # radius of the lamps as the balls see them
    strength: np.ndarray  # (n,)
    bright: float  # of a lamp's surface, in terms of white
    room: float  # ambient light
    windows: list[tuple[np.ndarray, float, float]]  # direction, radius in degrees, brightness
    balls: list[Ball] = field(default_factory=list)

    def light(self, P: np.ndarray, j: int) -> tuple[np.ndarray, np.ndarray]:
        """Unit directions (..., 3) from points to lamp j, and its irradiance there (..., 1)."""
        if np.linalg.norm(self.lamps[j]) > 100 * max(self.shape):
            return normalised(self.lamps[j]).astype(np.float32), np.array([self.strength[j]], np.float32)
        away = self.lamps[j].astype(np.float32) - P
        d = np.linalg.norm(away, axis=-1, keepdims=True)
        return away / d, self.strength[j] * (np.linalg.norm(self.lamps[j]) / d) ** 2

    def shaded(self, P: np.ndarray, L: np.ndarray) -> np.ndarray:
        """True where a ball is between points and the lamp."""
        dark = np.zeros(P.shape[:-1], bool)
        for ball in self.balls:
            V = ball.C.astype(np.float32) - P
            along = (V * L).sum(-1)
            dark |= (along > 0) & ((V**2).sum(-1) - along**2 < ball.r**2)
        return dark

    def table(self, P: np.ndarray, albedo: np.ndarray, N: np.ndarray, j: int) -> np.ndarray:
        """Radiance (..., 3) of the table's points."""
        L, e = self.light(P, j)
        lit = e[..., 0] * (N * L).sum(-1).clip(0) * ~self.shaded(P, L)
        return albedo * (lit + self.room)[..., None]

    def beyond(self, P: np.ndarray, R: np.ndarray, j: int) -> np.ndarray:
        """Radiance (..., 3) that comes to P from the direction R (..., 3): the table, or the room with its lamps."""
        h, w = self.shape
        down = R @ self.T
        Q = P + (-(P @ self.T) / np.where(down < -1e-3, down, -1e-3))[..., None] * R
        column, row = np.rint(Q[..., 0] + (w - 1) / 2).astype(int), np.rint((h - 1) / 2 - Q[..., 1]).astype(int)
        seen = (column >= 0) & (column < w) & (row >= 0) & (row < h)
        albedo = np.where(seen[..., None], self.albedo[row.clip(0, h - 1), column.clip(0, w - 1)], self.around)
        on_table = (down < -1e-3) & ((Q**2).sum(-1) < self.extent**2)
        room = self.room * (0.2 + 0.6 * down.clip(0))[..., None] * np.ones(3)
        for direction, radius, level in self.windows:
            room = np.where((angle_deg(R, direction) < radius)[..., None], level, room)
        return np.where(on_table[..., None], self.table(Q, albedo, self.T, j), room)

    def ball(self, ball: Ball, N: np.ndarray, V: np.ndarray, j: int) -> np.ndarray:
        """Radiance (..., 3) of a ball's points with normals N, seen from V."""
        P = ball.C + ball.r * N
        facing = (N * V).sum(-1, keepdims=True)
        R = 2 * facing * N - V
        L, e = self.light(P, j)
        width = self.size_deg + ball.rough_deg
        soft = 0.15 * self.size_deg + ball.rough_deg
        shine = ((width - angle_deg(R, L)) / soft + 0.5).clip(0, 1)[..., None]
        shine = self.bright * self.strength[j] * (self.size_deg / width) ** 2 * shine
        fresnel = ball.f0 + (1 - ball.f0) * (1 - facing.clip(0, 1)) ** 5
        return ball.body * (e * (N * L).sum(-1, keepdims=True).clip(0) + self.room) + fresnel * (
            self.beyond(P, R, j) + shine
        )


def onto(scene: Scene, picture: np.ndarray, ball: Ball, j: int) -> None:
    """Draws a ball over a picture, each pixel the mean of finer ones that the lens has blurred."""
    h, w = scene.shape
    lamp = ball.r * np.radians(scene.size_deg + ball.rough_deg)  # width of its reflection
    fine = max(6 if ball.r < 30 else 3 if ball.r < 150 else 2, int(np.ceil(SAMPLES / lamp)))
    x, y = ball.C[0] + (w - 1) / 2, (h - 1) / 2 - ball.C[1]
    x0, x1 = max(0, int(x - ball.r) - 1), min(w, int(x + ball.r) + 3)
    y0, y1 = max(0, int(y - ball.r) - 1), min(h, int(y + ball.r) + 3)
    if x0 >= x1 or y0 >= y1:
        return
    offset = (np.arange(fine) + 0.5) / fine - 0.5
    u = ((np.arange(x0, x1)[:, None] + offset).ravel() - x) / ball.r
    v = (y - (np.arange(y0, y1)[:, None] + offset).ravel()) / ball.r
    u, v = np.meshgrid(u, v)
    r2 = u**2 + v**2
    on = r2 < 1
    N = np.stack([u, v, np.sqrt((1 - r2).clip(0))], axis=-1)[on]
    colour = np.zeros((*u.shape, 4))
    colour[on, :3] = scene.ball(ball, N, np.array([0.0, 0, 1]), j).clip(0, 4)
    colour[on, 3] = 1
    colour = cv2.GaussianBlur(colour, (0, 0), LENS * fine)
    mean = colour.reshape(y1 - y0, fine, x1 - x0, fine, 4).mean((1, 3))
    picture[y0:y1, x0:x1] = picture[y0:y1, x0:x1] * (1 - mean[..., 3:]) + mean[..., :3]


def photograph(scene: Scene, j: int) -> np.ndarray:
    """Linear radiance (h, w, 3) under lamp j, without noise."""
    h, w = scene.shape
    x, y = np.meshgrid(np.arange(w, dtype=np.float32) - (w - 1) / 2, (h - 1) / 2 - np.arange(h, dtype=np.float32))
    P = np.stack([x, y, -(scene.T[0] * x + scene.T[1] * y) / scene.T[2]], axis=-1).astype(np.float32)
    N = np.concatenate([scene.T[:2] - scene.slopes, np.full((h, w, 1), scene.T[2])], axis=-1).astype(np.float32)
    if scene.slopes.any():
        N = normalised(N)
    picture = scene.table(P, scene.albedo, N, j)
    if scene.gloss:  # the camera's ray goes on from the table, to a ball or the room
        R = 2 * scene.T[2] * scene.T - np.array([0.0, 0, 1])
        mirrored = np.full(3, 0.2 * scene.room) * np.ones((h, w, 1))
        for ball in scene.balls:
            V = P - ball.C
            b = V @ R
            hit = b**2 - (V**2).sum(-1) + ball.r**2
            meets = (hit > 0) & (b < 0)
            t = -b[meets] - np.sqrt(hit[meets])
            mirrored[meets] = scene.ball(ball, (V[meets] + t[:, None] * R) / ball.r, -R, j).clip(0, 4)
        picture += scene.gloss * mirrored
    for ball in sorted(scene.balls, key=lambda b: b.C[2]):
        onto(scene, picture, ball, j)
    return picture


def lamps(rng: np.random.Generator, n: int) -> np.ndarray:
    """Unit directions (n, 3) about the z axis: a hemisphere, or rings."""
    widest = np.radians(rng.uniform(55, 86))
    if rng.random() < 0.5:
        k = np.arange(n) + 0.5
        theta, phi = np.arccos(1 - (1 - np.cos(widest)) * k / n), k * np.pi * (1 + 5**0.5)
        theta = theta + np.radians(rng.normal(0, 2, n))
    else:
        rings = int(rng.integers(1, max(2, n // 6) + 1))
        k = np.arange(n)
        theta = widest * (1 + k % rings) / rings
        phi = 2 * np.pi * k / n * (rings if rings > 1 else 1) + rng.uniform(0, 6)
    theta = theta.clip(0.03, np.radians(88))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def smooth(rng: np.random.Generator, shape: tuple[int, int], pixels: float) -> np.ndarray:
    """Even noise of standard deviation 1 and that width."""
    small = rng.standard_normal((max(4, int(shape[0] / pixels)), max(4, int(shape[1] / pixels)))).astype(np.float32)
    return cv2.resize(small, shape[::-1], interpolation=cv2.INTER_CUBIC)


def scene_of(kind: str, rng: np.random.Generator, megapixels: float) -> Scene:
    """A random scene of a kind."""
    n = int(np.exp(rng.uniform(np.log(6), np.log(48))))
    long = min(np.exp(rng.uniform(np.log(600), np.log(3000))), max(600, 1e3 * np.sqrt(1.5 * megapixels / n)))
    long = int(long)
    h, w = shape = (int(long / rng.choice([1.0, 1.33, 1.5])), long)
    short = min(shape)
    r = short * np.exp(rng.uniform(np.log(0.015), np.log(0.4 if kind in ("alone", "table", "border") else 0.15)))
    r = max(r, 9.0)
    tilt = np.radians(rng.uniform(5, 35)) if kind == "table" and rng.random() < 0.5 else 0.0
    T = np.array([0, np.sin(tilt), np.cos(tilt)])
    across = np.cross([1.0, 0, 0], T)
    directions = lamps(rng, n) @ np.stack([[1.0, 0, 0], -across, T])
    distance = long * (rng.uniform(1.0, 3.0) if rng.random() < 0.4 else 1e3)
    tone = rng.uniform(0.05, 0.8) * (1 - rng.uniform(0, 0.2, 3))
    texture = 1 + rng.uniform(0, 0.1) * smooth(rng, shape, rng.uniform(3, 40))[..., None]
    scene = Scene(
        shape, T, (tone * texture).clip(0.01, 1).astype(np.float32), tone, long * rng.choice([0.6, 1.5, 1e3]),
        np.zeros((h, w, 2), np.float32), 0.0, distance * directions, rng.uniform(1, 5),
        1 + rng.uniform(0, 0.2) * rng.uniform(-1, 1, n), np.exp(rng.uniform(np.log(15), np.log(200))),
        rng.uniform(0, 0.1), [],
    )  # fmt: skip
    for _ in range(rng.integers(0, 3)):
        scene.windows.append(
            (normalised(rng.normal(size=3) + np.array([0, 0, 1.5])), rng.uniform(2, 9), rng.uniform(0.2, 3))
        )
    margin = 1.15 * r
    spread = np.array([w / 2 - margin, h / 2 - margin]).clip(0)
    middle = rng.uniform(-1, 1, 2) * spread
    if kind in ("coin", "plate", "bead", "two"):
        middle = np.array([rng.uniform(0.55, 1.0), rng.uniform(-1, 1)]) * spread
    if kind == "border":
        side = rng.integers(2)
        middle[side] = np.sign(rng.normal()) * ((w, h)[side] / 2 - r * rng.uniform(-0.5, 0.9))
    scene.balls.append(mirror(rng, scene, middle, r))
    x = np.arange(w)[None, :] - (w - 1) / 2
    y = (h - 1) / 2 - np.arange(h)[:, None]
    aside = np.array([-rng.uniform(0.25, 0.5) * w / 2, rng.uniform(-0.2, 0.2) * h])
    bumps = smooth(rng, shape, short * rng.uniform(0.01, 0.05)) * rng.uniform(2, 8)
    if kind == "coin":
        away = np.hypot(x - aside[0], y - aside[1])
        R = min(short * rng.uniform(0.08, 0.3), 0.45 * abs(middle[0] - aside[0]) + 20)
        rim = np.exp(-(((away - 0.93 * R) / (0.02 * R + 1)) ** 2)) * 4
        place(scene, away < R, rng.uniform(0.15, 0.8) * np.array([1, 0.9, 0.7]), bumps + rim)
    if kind == "plate":
        half = short * rng.uniform(0.1, 0.3)
        away = np.maximum(abs(x - aside[0]), abs(y - aside[1]))
        if rng.random() < 0.3:
            away = np.hypot(x - aside[0], y - aside[1])
        place(scene, away < half, rng.uniform(0.3, 0.9) * np.ones(3), bumps)
    if kind == "bead":
        size = max(r * rng.uniform(0.3, 0.8), 6.0)
        bead = mirror(rng, scene, aside, size)
        bead.body, bead.f0, bead.rough_deg = rng.uniform(0.05, 0.6, 3), 0.05, rng.uniform(2, 15)
        scene.balls.append(bead)
    if kind == "two":
        scene.balls.append(mirror(rng, scene, aside, max(9.0, r * rng.uniform(0.5, 1.1))))
    if kind == "table":
        scene.gloss = rng.uniform(0.03, 0.3)
        if rng.random() < 0.4:  # the ball stands on a round base
            foot = scene.balls[0].C - r * T
            away = np.hypot(x - foot[0], (y - foot[1]) / T[2])
            place(scene, away < r * rng.uniform(1.05, 2.0), rng.uniform(0.05, 0.9) * np.ones(3), 0 * bumps)
    return scene


def mirror(rng: np.random.Generator, scene: Scene, middle: np.ndarray, r: float) -> Ball:
    """A chrome, black or red ball that touches the table."""
    z = (r - scene.T[:2] @ middle) / scene.T[2]
    f0, body = [(rng.uniform(0.5, 0.9), 0.0), (0.045, 0.02), (0.045, 0.4)][rng.integers(3)]
    colour = body * (np.array([1, 0.08, 0.08]) if body > 0.1 else np.ones(3))
    return Ball(np.array([*middle, z]), r, colour, f0)


def place(scene: Scene, where: np.ndarray, albedo: np.ndarray, height: np.ndarray) -> None:
    """Lays something flat with a relief onto the table."""
    dy, dx = np.gradient(cv2.GaussianBlur(height.astype(np.float32), (0, 0), 1.5))
    scene.albedo[where] = albedo
    scene.slopes[where] = np.stack([dx, -dy], axis=-1)[where]


def written(scene: Scene, rng: np.random.Generator, folder: Path) -> None:
    """The photographs as files."""
    n, jpeg = len(scene.lamps), rng.random() < 0.7
    sigma, blur, quality = rng.uniform(0.002, 0.012), rng.uniform(0.4, 1.2), int(rng.integers(82, 97))
    exposure = rng.uniform(0.5, 1.2) / np.quantile(photograph(scene, 0)[::7, ::7], 0.95).clip(0.15)
    for j in range(n):
        picture = cv2.GaussianBlur(exposure * photograph(scene, j), (0, 0), blur)
        noisy = picture.clip(0, 1) + sigma * rng.standard_normal(picture.shape, dtype=np.float32)
        values = np.rint(255 * noisy.clip(0, 1) ** (1 / 2.2)).astype(np.uint8)[..., ::-1]
        how = (".jpg", [cv2.IMWRITE_JPEG_QUALITY, quality]) if jpeg else (".png", [cv2.IMWRITE_PNG_COMPRESSION, 1])
        cv2.imwrite(str(folder / f"IMG_{j + 1:03d}{how[0]}"), values, how[1])


def truth(scene: Scene) -> list[np.ndarray]:
    """Directions (n, 3) to the lamps from where each mirror ball reflects them to the camera."""
    found = []
    for ball in scene.balls:
        if not ball.rough_deg:
            L = normalised(scene.lamps - ball.C)
            for _ in range(30):
                L = normalised(scene.lamps - ball.C - ball.r * normalised(L + np.array([0.0, 0, 1])))
            found.append(L)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--megapixels", type=float, default=12, help="of all pictures of a frame, at most about")
    parser.add_argument("--only", type=int, default=None, help="one frame's number")
    parser.add_argument("--keep", type=Path, default=None, help="folder for the frames that are not right")
    parser.add_argument("--results", type=Path, help="lines of JSON, one a frame; those that are there are not redone")
    given = parser.parse_args()
    lines = given.results.read_text().splitlines() if given.results and given.results.exists() else []
    there = {tuple(row["of"]): row for row in map(json.loads, lines)}
    print("| kind | frames | " + " | ".join(OUTCOMES) + " | doubts |\n|" + "---|" * 8)
    rows = {kind: [] for kind in given.kinds.split(",")}
    for k in range(given.frames) if given.only is None else [given.only]:
        for kind, judged in rows.items():
            of = (given.seed, given.megapixels, kind, k)
            if of not in there:
                rng = np.random.default_rng([given.seed, KINDS.index(kind), k])
                row = {"of": of, **outcome(f"{kind}-{k}", scene_of(kind, rng, given.megapixels), rng, given.keep)}
                there[of] = row
                if given.results:
                    with given.results.open("a") as file:
                        file.write(json.dumps(row) + "\n")
            judged.append(there[of])
    for kind, judged in rows.items():
        print(line_of(kind, judged))
    print(line_of("all", [row for judged in rows.values() for row in judged]))


def line_of(kind: str, rows: list[dict[str, Any]]) -> str:
    """Counts of one kind."""
    counts = [sum(row["outcome"] == name for row in rows) for name in OUTCOMES]
    doubts = sum(row["outcome"] == "right" and bool(row["said"]) for row in rows)
    return f"| {kind} | {len(rows)} | {' | '.join(map(str, counts))} | {doubts} |"


def outcome(name: str, scene: Scene, rng: np.random.Generator, keep: Path | None) -> dict[str, Any]:
    """What became of a frame, and what is shown in it."""
    with tempfile.TemporaryDirectory() as place:
        folder = (keep or Path(place)) / name
        folder.mkdir(parents=True, exist_ok=True)
        written(scene, rng, folder)
        try:
            report = calibrate(folder, out=folder / "out" / "lights.lp", overwrite=True)
            listed = read_lights(folder / "out" / "lights.lp")
            used = [int(picture[4:7]) - 1 for picture in listed.names]
            off = min(float(angle_deg(listed.vectors, t[used]).mean()) for t in truth(scene))
            said = " ".join(report["warnings"])
            at = "right" if off <= 2 else "told" if said else "2 to 5" if off <= 5 else "silent"
        except InputError as error:
            off, said, at = None, str(error), "refused"
        if keep is not None and at == "right":
            shutil.rmtree(folder)
    h, w = scene.shape
    balls = [[b.C[0] + (w - 1) / 2, (h - 1) / 2 - b.C[1], b.r, b.f0, b.body.max(), b.rough_deg] for b in scene.balls]
    return {"outcome": at, "off": off, "said": said, "size": [w, h], "lamps": len(scene.lamps), "balls": balls}


if __name__ == "__main__":
    main()
