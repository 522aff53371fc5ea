"""Maps of materials on rendered objects whose roughness and metalness are known.

    python benchmarks/materials.py [--scenes 20] [--seed 100] [--normals both|true|estimated]

Objects of recipe `objects`, 128 x 128, principled materials that vary over half of them, without clear coats and cloth,
wholly metal or not at all; cast shadows, light between parts, noise, saturation. Half have 40 lights over the
hemisphere, half 96 lights like DiLiGenT's.

A pixel shows a highlight if some light, not in shadow, shows a tenth of the lobe's peak on it, the true highlight
adds a tenth of what the matt part shows where that is brightest, and the roughness is below 0.8: broader lobes look
like matt surfaces. With `--broad` those count, too. `told`: of those pixels. `0.1`, `0.2`: how many of them are told
and within that; in brackets, of those that are told. `unknown`: of the others, how many are not told. `right`: of all
pixels that are told, with such a highlight or without, how many are within 0.2. `metalness`: of the pixels where it is
told, how many are right, and how many of those with a highlight are told. At the end the same of all pixels together,
and the mean of the scenes that show highlights on a hundredth of the object.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

import photonormal as pn
from photonormal.materials import materials_of
from photonormal.shading import cosines, half_vectors
from photonormal.synth.brdf.principled import PARAMETERS, Principled
from photonormal.synth.materials import at_points, dress
from photonormal.synth.params import rng
from photonormal.synth.recipes import recipe
from photonormal.synth.scene import draw_scenes, frame, heights, shaded
from photonormal.synth.sensor import sensed
from photonormal.synth.shadows import distant
from photonormal.synth.trace import visible_surface
from photonormal.types import Capture, Materials, Normals

SIZE = 128
LEAST = 0.2  # of the frame that an object covers
STEEP, FLANK, ADDS = 0.1, 0.1, 0.1  # n.l, share of the lobe's peak, share of the matt part: a highlight is seen
BROAD = 0.8  # roughness from which it is not
SHOWN = 0.01  # of a scene's pixels with a highlight: it counts in the mean of scenes


@dataclass(frozen=True)
class Scene:
    """A capture, and the truth on its mask's pixels."""

    capture: Capture
    roughness: np.ndarray
    metal: np.ndarray
    shown: np.ndarray


def rendered(seed: int) -> Scene:
    """An object of some materials."""
    n, narrow = (96, 1.0) if seed % 2 else (40, 0.0)
    made = recipe("objects", size=SIZE, crop=SIZE, materials=(1, 0, 0, 0, 0, 0), lights=(n, n), narrow=narrow, scenes=1)
    g = rng(seed, 7)
    while True:
        scenes = draw_scenes(made, g, 1, n, None)
        palette = scenes.coats.palette  # (1, 4, 11)
        palette[..., PARAMETERS.index("metallic")].round_()
        for name in ("sheen", "coat"):
            palette[..., PARAMETERS.index(name)] = 0
        geometry = visible_surface(scenes.solids, *frame(scenes, SIZE))
        if geometry.mask.float().mean() > LEAST:
            break
    pixels = torch.arange(SIZE**2, dtype=torch.int32)[None]
    I = shaded(scenes, geometry, pixels, made, None, seed).view(1, n, 3, SIZE, SIZE) * geometry.mask[:, None, None]
    N = at_points(geometry.normals, pixels)
    visible = distant(heights(geometry), scenes.lights, pixels, N, 16)[0]  # (n, p)
    skin = dress(scenes.coats, at_points(geometry.points, pixels), None)[0].f
    assert isinstance(skin, Principled)
    mask = geometry.mask[0]
    on = mask.flatten()
    truth = replace(skin, values=skin.values[0, 0][:, on])
    shown = shows_a_highlight(truth, N[0].T[on], scenes.lights[0], visible.T[on] > 0.5)
    generator = torch.Generator().manual_seed(seed)
    I, L = sensed(I, scenes.lights, geometry.height, geometry.mask, made, g, generator)
    images = (I * geometry.mask[:, None, None])[0].permute(0, 2, 3, 1).numpy()
    normals = Normals(geometry.normals[0].permute(1, 2, 0).numpy(), mask.numpy())
    capture = Capture(images, mask.numpy(), L[0].numpy(), normals, np.ones((n, 3)), name=f"scene {seed}")
    metallic, roughness = (truth.values[PARAMETERS.index(name)].numpy() for name in ("metallic", "roughness"))
    return Scene(capture, roughness, metallic > 0.5, shown.numpy())


def shows_a_highlight(skin: Principled, N: Tensor, L: Tensor, visible: Tensor) -> Tensor:
    """Which pixels do, by the truth alone: (p,) bool."""
    H = half_vectors(L)
    cos_l, cos_h = cosines(N, L), cosines(N, H)  # (p, n)
    cos_d = (L * H).sum(-1)[:, None]  # (n, 1)
    lit = visible & (cos_l > STEEP)
    each = replace(skin, values=skin.values[None])  # (1, 11, p)
    lobe = each.specular(cos_l.T.clamp(min=STEEP), N[:, 2].clamp(min=0.05)[None], cos_h.T, cos_d)
    shine = torch.pi * lobe.mean(1).T * cos_l  # (p, n)
    metallic, roughness = skin.values[3], skin.values[4]
    matt = (skin.base().mean(0) * (1 - metallic))[:, None] * cos_l * lit
    a2 = roughness[:, None] ** 4
    near = (a2 / ((a2 - 1) * cos_h.square() + 1)).square() > FLANK
    return (lit & near & (shine > ADDS * matt.amax(1, keepdim=True))).any(1)


def pixels_of(scene: Scene, found: Materials) -> dict[str, np.ndarray]:
    """Of each pixel: how far the roughness is off, whether it shows a highlight, metalness, and the true one."""
    mask = scene.capture.mask
    off = np.abs(found.roughness[mask] - scene.roughness)
    return {"off": off, "shown": scene.shown, "metalness": found.metalness[mask], "metal": scene.metal}


def scored(off: np.ndarray, shown: np.ndarray, metalness: np.ndarray, metal: np.ndarray) -> dict[str, float]:
    """Shares of pixels; NaN where there are none."""
    told, sure = np.isfinite(off), np.isfinite(metalness)

    def share(of: np.ndarray, where: np.ndarray) -> float:
        return float(of[where].mean()) if where.any() else np.nan

    return {
        "shown": shown.mean(),
        "told": share(told, shown),
        "0.1": share(off < 0.1, shown),
        "0.2": share(off < 0.2, shown),
        "(0.1)": share(off < 0.1, shown & told),
        "(0.2)": share(off < 0.2, shown & told),
        "unknown": share(~told, ~shown),
        "right": share(off < 0.2, told),
        "metalness": share(metalness == metal, sure),
        "metal told": share(sure, shown),
    }


def main() -> None:
    words = argparse.ArgumentParser()
    words.add_argument("--scenes", type=int, default=20)
    words.add_argument("--seed", type=int, default=100)
    words.add_argument("--broad", action="store_true", help="highlights of roughness 0.8 and more count")
    words.add_argument("--normals", default="both", choices=["both", "true", "estimated"])
    asked = words.parse_args()
    kinds = ["true", "estimated"] if asked.normals == "both" else [asked.normals]
    rows: dict[str, list[dict[str, np.ndarray]]] = {kind: [] for kind in kinds}
    for seed in range(asked.seed, asked.seed + asked.scenes):
        scene = rendered(seed)
        if not asked.broad:
            scene = replace(scene, shown=scene.shown & (scene.roughness < BROAD))
        for kind in kinds:
            normals = scene.capture.truth if kind == "true" else pn.solve(scene.capture)
            assert normals is not None
            rows[kind].append(pixels_of(scene, materials_of(scene.capture, normals)))
            print(f"{seed} {kind:9}", *(f"{k} {v:.2f}" for k, v in scored(**rows[kind][-1]).items()), flush=True)
    print("\nall pixels")
    for kind, found in rows.items():
        together = {name: np.concatenate([row[name] for row in found]) for name in found[0]}
        print(f"{kind:9}", *(f"{k} {100 * v:.1f} %" for k, v in scored(**together).items()))
    print("\nmean of the scenes that show highlights")
    for kind, found in rows.items():
        each = [scored(**row) for row in found if row["shown"].mean() > SHOWN]
        print(f"{kind:9}", *(f"{k} {100 * np.nanmean([row[k] for row in each]):.1f} %" for k in each[0]), len(each))


if __name__ == "__main__":
    main()
