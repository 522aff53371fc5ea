"""Scenes: drawn from a recipe, brought into view, cut into windows, and lit by all their lights at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from photonormal.shading import cosines, fall_off, shade, towards
from photonormal.synth import bounce
from photonormal.synth.bust import busts, glazes
from photonormal.synth.library import Library
from photonormal.synth.lights import draw_lights
from photonormal.synth.materials import Coats, draw_coats, dress, radiance, skins_albedo
from photonormal.synth.meshes import draw_views
from photonormal.synth.params import log_uniform, tensor
from photonormal.synth.recipes import Recipe
from photonormal.synth.sculptor import draw_solids
from photonormal.synth.shadows import horizon, reached
from photonormal.synth.trace import Geometry, Solid, View, approach, survey

EMPTY = -1000.0  # height, in pixels, of where there is nothing
PATCH, RECEIVER = 2, 4  # pixels between the samples that send and that receive bounced light


@dataclass(frozen=True)
class Scenes:
    """`b` drawn scenes."""

    solids: Solid
    coats: Coats
    lights: Float[Tensor, "b n 3"]
    zoom: Float[Tensor, " b"]  # width of the window over the object's
    focus: Float[Tensor, " b"]  # which visible spot a zoomed window is centred on, [0, 1]
    bounce: Bool[Tensor, " b"]
    ambient: Float[Tensor, " b"]


def draw_scenes(recipe: Recipe, g: np.random.Generator, b: int, n: int, shelf: Library | None) -> Scenes:
    """`b` random scenes with `n` lights each."""
    near = g.random(b) < recipe.zoom
    if recipe.solid == "bust":
        solids = busts(g, b)
        coats = glazes(solids)
    else:
        solids = draw_views(g, b, recipe.meshes) if recipe.meshes else draw_solids(g, b, recipe.shapes, recipe.detail)
        coats = draw_coats(g, b, recipe.materials, recipe.varying, shelf)
    return Scenes(
        solids,
        coats,
        tensor(draw_lights(g, b, n, recipe.narrow, recipe.rig)),
        tensor(np.where(near, log_uniform(g, 0.35, 0.8, b), g.uniform(1.03, 1.2, b))),
        tensor(g.random(b)),
        torch.from_numpy(g.random(b) < recipe.bounce),
        tensor(recipe.ambient * g.random(b) ** 2),
    )


def frame(scenes: Scenes, size: int) -> tuple[View, Float[Tensor, "b p"]]:
    """A window around each object, or around a spot of it; and the depth at which its pixels' rays may begin."""
    wide, z = survey(scenes.solids, len(scenes.zoom), scenes.zoom.device)
    seen = z > -torch.inf  # (b, c)
    x, y = wide.rays(wide.size)

    def middle(v: Tensor) -> tuple[Tensor, Tensor]:
        low = torch.where(seen, v, torch.inf).amin(1)
        high = torch.where(seen, v, -torch.inf).amax(1)
        return (low + high) / 2, (high - low) / 2 + wide.pixel / 2

    (cx, rx), (cy, ry) = middle(x), middle(y)
    half = torch.nan_to_num(torch.maximum(rx, ry), 1, 1, 1).clamp(0.2, 1.3) * scenes.zoom
    count = seen.cumsum(1)
    spot = (count > (scenes.focus * count[:, -1])[:, None]).to(torch.int8).argmax(1)[:, None]
    close = scenes.zoom < 1
    cx = torch.where(close, x.gather(1, spot)[:, 0], cx)
    cy = torch.where(close, y.gather(1, spot)[:, 0], cy)
    view = View(torch.nan_to_num(torch.stack([cx, cy], -1), 0, 0, 0), half, size)
    return view, approach(scenes.solids, view, z)


def windows(
    geometry: Geometry, recipe: Recipe, generator: torch.Generator
) -> tuple[Int[Tensor, "b k"], Bool[Tensor, " b"]]:
    """First pixels (row * size + column) of `crops` windows on curved parts, and which scenes have that many.

    One half is drawn evenly, the other half prefers parts that lie below what is near them: there the shadows fall.
    """
    mask, k, c = geometry.mask, recipe.crops, recipe.crop
    b, s, _ = mask.shape
    side = s - c + 1
    below = _highest_near(torch.where(mask, geometry.height, EMPTY), c | 1) - geometry.height
    maps = torch.cat([mask[:, None], geometry.normals, (below * mask)[:, None] / c], 1)
    total = F.pad(maps.double().cumsum(-1).cumsum(-2), (1, 0, 1, 0))  # (b, 5, s + 1, s + 1)
    total = total[..., c:, c:] - total[..., :-c, c:] - total[..., c:, :-c] + total[..., :-c, :-c]
    mean = (total / c**2).float().flatten(2)  # (b, 5, side side)
    coverage = mean[:, 0]
    spread = 1 - mean[:, 1:4].square().sum(1) / coverage.square().clamp(min=1e-6)
    least = recipe.coverage if side > 1 else min(recipe.coverage, 0.1)  # a whole object needn't fill its frame
    good = (coverage >= least) & (spread > 0.01)
    if side == 1:
        return torch.zeros(b, k, dtype=torch.long, device=mask.device), good[:, 0]
    score = torch.rand((b, side**2), generator=generator).to(mask.device) + good
    even = k - k // 2
    first = score.topk(even, 1).indices
    if k > even:
        score = score + recipe.hollows * mean[:, 4].clamp(max=1)
        first = torch.cat([first, score.scatter(1, first, -1).where(good, -1).topk(k - even, 1).indices], 1)
    return first // side * s + first % side, good.sum(1) >= k


def _highest_near(height: Float[Tensor, "b s s"], width: int) -> Float[Tensor, "b s s"]:
    """Largest height in the square of `width` pixels around each pixel."""
    h = F.max_pool2d(height[:, None], (1, width), 1, (0, width // 2))
    return F.max_pool2d(h, (width, 1), 1, (width // 2, 0))[:, 0]


def render(
    scenes: Scenes, geometry: Geometry, pixels: Int[Tensor, "b p"], recipe: Recipe, shelf: Library | None, seed: int
) -> Float[Tensor, "b n 3 p"]:
    """Radiance over irradiance of a white surface (1 at its brightest) at some pixels, for each light."""
    b, s, _ = geometry.mask.shape
    p, L = pixels.shape[1], scenes.lights
    pixels = pixels.to(torch.int32)
    grid = torch.arange(0, s, PATCH, device=pixels.device, dtype=torch.int32)
    patches = (grid[:, None] * s + grid).flatten().expand(b, -1)  # (b, q)
    reflecting = bool(scenes.bounce.any())
    every = torch.cat([pixels, patches], 1) if reflecting else pixels

    def at(values: Tensor) -> Tensor:
        return values.flatten(2).gather(2, every.long()[:, None].expand(-1, values.shape[1], -1))

    N, on = at(geometry.normals), at(geometry.mask[:, None])[:, 0]  # (b, 3, p + q)
    z = at(geometry.height[:, None])[:, 0]
    lz, visible = L[..., 2:], 1.0
    field = torch.where(geometry.mask, geometry.height, EMPTY)
    if recipe.distance is None:
        cos_l = cosines(N.transpose(1, 2), L).transpose(1, 2)  # (b, n, p + q)
        if recipe.shadows:
            visible = horizon(field, L).visibility(every, z, N)
    else:  # lamps at distance * L from the middle of the surface, in half widths of the window
        X = torch.stack([every % s - (s - 1) / 2, (s - 1) / 2 - every // s, z - _middle(geometry)], -1)  # pixels
        S = recipe.distance * s / 2 * L
        if recipe.shadows:
            visible = reached(field, X, _middle(geometry), S)
        L, r = towards(X, S)  # (b, p + q, n, 3)
        cos_l = cosines(N.transpose(1, 2), L).transpose(1, 2)
        lz = L[..., 2].transpose(1, 2)[..., :p]
        visible = visible * (recipe.distance * s / 2) ** 2 * fall_off(L, r).transpose(1, 2)
    lit = shade(visible, cos_l) * on[:, None]
    points = at(geometry.points)  # (b, 3, p + q)
    skins = dress(scenes.coats, points[..., :p], shelf)
    albedo = skins_albedo(skins, b)  # (b, 3, p)
    lv = (2 + 2 * lz).sqrt()  # |l + v|, (b, n, 1 or p)
    cos_v = N[:, None, 2, :p]
    cos_h = ((cos_l[..., :p] + cos_v) / lv).clamp(max=1)
    out = radiance(skins, cos_l[..., :p], cos_v, cos_h, lv / 2) * lit[:, :, None, :p]
    if reflecting:
        sender = skins_albedo(dress(scenes.coats, points[..., p:], shelf), b)  # (b, 3, q)
        arriving = _bounced(scenes, geometry, pixels, N[..., :p], lit[..., p:], sender, seed)
        out += albedo[:, None] * arriving
    out += (scenes.ambient.view(b, 1, 1, 1) * albedo[:, None]) * on[:, None, None, :p]
    return out


def _middle(geometry: Geometry) -> Float[Tensor, "b 1"]:
    """Mean height of the surface."""
    return (geometry.height.flatten(1).sum(1) / geometry.mask.flatten(1).sum(1).clamp(min=1))[:, None]


def _bounced(
    scenes: Scenes, geometry: Geometry, pixels: Tensor, N: Tensor, lit: Tensor, albedo: Tensor, seed: int
) -> Float[Tensor, "b n 3 p"]:
    """Light that reaches pixels from what they see of the surface: patches lit by (b, n, q), of albedo (b, 3, q)."""
    b, s, _ = geometry.mask.shape
    n = lit.shape[1]
    grid = torch.arange(RECEIVER // 2, s, RECEIVER, device=pixels.device)
    receivers = (grid[:, None] * s + grid).flatten()
    found = bounce.hits(geometry.height, geometry.mask, geometry.normals, receivers, seed)
    sent = (lit[:, :, None] * albedo[:, None]).permute(0, 3, 1, 2).flatten(2)  # (b, q, n 3)
    sent = sent * scenes.bounce.view(b, 1, 1)
    arriving = bounce.gather(found, sent, PATCH, s)  # (b, r, n 3)
    on = geometry.mask.flatten(1)[:, receivers]
    M = geometry.normals.flatten(2)[:, :, receivers].transpose(1, 2)
    out = bounce.spread(arriving, on, M, pixels, N.transpose(1, 2), s)  # (b, p, n 3)
    return out.view(b, -1, n, 3).permute(0, 2, 3, 1)
