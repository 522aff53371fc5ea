"""Scenes: drawn from a recipe, brought into view, cut into windows, and lit by all their lights at once."""

from __future__ import annotations

from collections.abc import Callable
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
from photonormal.synth.materials import (
    METAL,
    PRINCIPLED,
    Coats,
    Skin,
    at_points,
    draw_coats,
    dress,
    radiance,
    skins_albedo,
)
from photonormal.synth.meshes import draw_views, mesh_folder
from photonormal.synth.params import indices, log_uniform, tensor
from photonormal.synth.recipes import Rendering
from photonormal.synth.sculptor import draw_solids
from photonormal.synth.sensor import misaligned
from photonormal.synth.shadows import distant, nearby
from photonormal.synth.trace import Geometry, Solid, WindowView, approach, survey

EMPTY = -1000.0  # height, in pixels, of where there is nothing
ELEMENTS = {"cpu": 2**18, "cuda": 2**27}  # samples (pixel, light) rendered at a time: what a cache or a GPU holds
PATCH = 2  # pixels between the samples that send bounced light


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


def draw_scenes(recipe: Rendering, g: np.random.Generator, b: int, n: int, shelf: Library | None) -> Scenes:
    """`b` random scenes with `n` lights each."""
    near = g.random(b) < recipe.zoom
    if recipe.solid == "bust":
        solids = busts(g, b)
        coats = glazes(solids)
    else:
        folder = mesh_folder(recipe.meshes)
        if folder and (recipe.mesh_share == 1 or g.random() < recipe.mesh_share):
            solids = draw_views(g, b, folder)
        else:
            solids = draw_solids(g, b, recipe.shapes, recipe.detail)
        kinds = METAL if recipe.metal else PRINCIPLED
        coats = draw_coats(g, b, recipe.materials, recipe.varying, shelf, kinds)
    return Scenes(
        solids,
        coats,
        tensor(lights_of_scenes(recipe, g, b, n)),
        tensor(np.where(near, log_uniform(g, 0.35, 0.8, b), g.uniform(1.03, 1.2, b))),
        tensor(g.random(b)),
        torch.from_numpy(g.random(b) < recipe.bounce),
        tensor(recipe.ambient * g.random(b) ** 2),
    )


def lights_of_scenes(recipe: Rendering, g: np.random.Generator, b: int, n: int) -> np.ndarray:
    """True directions (b, n, 3): drawn ones, or those around the recipe's by as much as measurements err."""
    if not recipe.directions:
        return draw_lights(g, b, n, recipe.narrow, recipe.rig)
    return misaligned(np.tile(recipe.directions, (b, 1, 1)), g, recipe.light_error_deg * g.random(b))


def frame(scenes: Scenes, size: int) -> tuple[WindowView, Float[Tensor, "b p"]]:
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
    view = WindowView(torch.nan_to_num(torch.stack([cx, cy], -1), 0, 0, 0), half, size)
    return view, approach(scenes.solids, view, z)


def windows(
    geometry: Geometry, recipe: Rendering, generator: torch.Generator
) -> tuple[Int[Tensor, "b k"], Bool[Tensor, " b"]]:
    """First pixels (row * size + column) of `crops` windows on curved parts, and which scenes have that many.

    One half is drawn evenly, the other half prefers parts that lie below what is near them: there the shadows fall.
    """
    mask, k, c = geometry.mask, recipe.crops, recipe.crop
    b, s, _ = mask.shape
    side = s - c + 1
    below = bounce.highest_near(torch.where(mask, geometry.height, EMPTY), c | 1) - geometry.height
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


def shaded(
    scenes: Scenes, geometry: Geometry, pixels: Int[Tensor, "b p"], recipe: Rendering, shelf: Library | None, seed: int
) -> Float[Tensor, "b n 3 p"]:
    """Radiance over irradiance of a white surface (1 at its brightest) at some pixels, for each light."""
    b, s, _ = geometry.mask.shape
    p = pixels.shape[1]
    pixels = pixels.to(torch.int32)
    grid = torch.arange(0, s, PATCH, device=pixels.device, dtype=torch.int32)
    patches = (grid[:, None] * s + grid).flatten().expand(b, -1)  # (b, q)
    reflecting = bool(scenes.bounce.any())
    every = torch.cat([pixels, patches], 1) if reflecting else pixels
    N, on = at_points(geometry.normals, every), at_points(geometry.mask[:, None], every)  # (b, 3 or 1, p + q)
    skins = dress(scenes.coats, at_points(geometry.points, pixels), shelf)
    albedo = skins_albedo(skins, b)[:, None]  # (b, 1, 3, p)
    ambient = scenes.ambient.view(b, 1, 1, 1) * albedo * on[:, None, :, :p]
    cos_v = N[:, None, 2, :p]
    bounced = _bounced(scenes, geometry, pixels, recipe, shelf, seed) if reflecting else None

    few = max(1, ELEMENTS.get(pixels.device.type, 2**27) // every.numel())  # lights at a time
    visible = on.expand(-1, scenes.lights.shape[1], -1)
    if recipe.shadows and recipe.distance is None:
        visible = on * distant(heights(geometry), scenes.lights, every, N, few)
    elif recipe.shadows:
        visible = on * nearby(heights(geometry), lamps(recipe, geometry, scenes.lights), every, few)

    def under(L: Tensor, visible: Tensor) -> Float[Tensor, "b m 3 p"]:
        """Images under some of the lights, of what each sees."""
        D, arriving = lights_at(recipe, geometry, L, every)
        cos_l = cosines(N.transpose(1, 2), D).transpose(1, 2)  # (b, m, p + q)
        arriving = visible * arriving
        lz = L[..., 2:] if D is L else D[:, :p, :, 2].transpose(1, 2)  # (b, m, 1 or p)
        lv = (2 + 2 * lz).sqrt()  # |l + v|
        cos_l = cos_l[..., :p]
        out = radiance(skins, cos_l, cos_v, ((cos_l + cos_v) / lv).clamp(max=1), lv / 2)
        out *= shade(arriving[..., :p], cos_l)[:, :, None]
        if bounced is not None:
            out += albedo * bounced(L, arriving[..., p:])
        return out + ambient

    parts = zip(scenes.lights.split(few, 1), visible.split(few, 1), strict=True)
    return torch.cat([under(*part) for part in parts], 1)


def heights(geometry: Geometry) -> Float[Tensor, "b 3 s s"]:
    """The solid as shadows see it: of the visible surface, and of where rays leave and enter it behind that."""
    return torch.cat([torch.where(geometry.mask, geometry.height, EMPTY)[:, None], geometry.behind], 1)


def lamps(recipe: Rendering, geometry: Geometry, L: Float[Tensor, "b n 3"]) -> Float[Tensor, "b n 3"]:
    """(Column, row, height) of lamps in the directions `L` from the middle of the surface, at the recipe's distance."""
    assert recipe.distance is not None
    s = geometry.mask.shape[-1]
    height = geometry.height.flatten(1).sum(1) / geometry.mask.flatten(1).sum(1).clamp(min=1)
    middle = torch.stack([torch.full_like(height, (s - 1) / 2)] * 2 + [height], -1)
    return middle[:, None] + recipe.distance * s / 2 * L * L.new_tensor([1, -1, 1])


def lights_at(
    recipe: Rendering, geometry: Geometry, L: Float[Tensor, "b n 3"], pixel: Int[Tensor, "b p"]
) -> tuple[Float[Tensor, "b n 3"] | Float[Tensor, "b p n 3"], Float[Tensor, "b n p"] | float]:
    """Lights as pixels see them, and what arrives through empty space, over what arrives in the middle."""
    if recipe.distance is None:
        return L, 1.0
    s = geometry.mask.shape[-1]
    X = torch.stack([pixel % s, pixel // s, at_points(geometry.height[:, None], pixel)[:, 0]], -1)
    D, r = towards(X, lamps(recipe, geometry, L))  # (b, p, n, 3), (b, p, n)
    return D * L.new_tensor([1, -1, 1]), (recipe.distance * s / 2) ** 2 * fall_off(D, r).transpose(1, 2)


def _bounced(
    scenes: Scenes,
    geometry: Geometry,
    pixels: Int[Tensor, "b p"],
    recipe: Rendering,
    shelf: Library | None,
    seed: int,
) -> Callable[[Tensor, Tensor], Tensor]:
    """From lights (b, n, 3) and what arrives at patches (b, n, q) to what pixels reflect (b, n, 3, p), over albedo.

    Ways from the camera by pixels to what they see are found once, with how much of the light along each a pixel
    sends to the camera; what is seen reflects each light into them by its own material.
    """
    b, s, _ = geometry.mask.shape
    asked = torch.zeros(b, s * s, dtype=torch.bool, device=pixels.device).scatter(1, pixels.long(), True)
    on = geometry.mask.flatten(1) & (asked | (recipe.bounces > 1))
    M = geometry.normals.flatten(2).transpose(1, 2)  # (b, s s, 3)
    near = bounce.around(on, M, pixels)
    pixel = indices(on)  # (b, r), filled up with others that send no rays
    directions, density = bounce.rays(M.gather(1, pixel[..., None].expand(-1, -1, 3)), seed)
    found = bounce.hits(heights(geometry), geometry.normals, pixel, directions)  # (b, r, m)
    met = ((found >= 0) & on.gather(1, pixel)[..., None]).flatten(1)
    way = indices(met)  # (b, k)
    row = torch.where(met, met.cumsum(1) - 1, -1).view_as(found)  # number of each ray among the ways
    row = row.new_full((b, s * s, bounce.RAYS), -1).scatter(1, pixel[..., None].expand_as(row), row)

    def along(values: Tensor) -> Tensor:
        return values.flatten(1, 2).gather(1, way)

    d = torch.stack([along(x) for x in directions.unbind(-1)], 1)  # (b, 3, k) from a pixel
    here, there = pixel.gather(1, way // bounce.RAYS), along(found).clamp(min=0)

    def skins(pixel: Tensor) -> tuple[list[Skin], Tensor]:
        return dress(scenes.coats, at_points(geometry.points, pixel), shelf), at_points(geometry.normals, pixel)

    coat, n = skins(here)
    cos_l, lv = (n * d).sum(1, keepdim=True), (2 + 2 * d[:, 2:]).clamp(min=1e-6).sqrt()
    share = radiance(coat, cos_l, n[:, 2:], ((cos_l + n[:, 2:]) / lv).clamp(max=1), lv / 2)[:, 0]  # (b, 3, k)
    share = share * (cos_l / along(density)[:, None] / bounce.RAYS) * scenes.bounce.view(b, 1, 1)
    share = share / skins_albedo(coat, b).clamp(min=0.01)
    coat, n = skins(there)
    passed_on = share * skins_albedo(coat, b)
    every = torch.arange(s * s, device=on.device).expand(b, -1)
    everywhere = bounce.around(on, M, every) if recipe.bounces > 1 else near
    patch = (there // s // PATCH) * (s // PATCH) + there % s // PATCH
    cos_o = -(n * d).sum(1, keepdim=True)

    def reflected(L: Tensor, arriving: Tensor) -> Tensor:
        D = lights_at(recipe, geometry, L, there)[0]
        lo = (2 - 2 * cosines(d.transpose(1, 2), D).transpose(1, 2)).clamp(min=1e-6).sqrt()  # |l + o|, (b, n, k)
        cos_l = cosines(n.transpose(1, 2), D).transpose(1, 2)
        sent = radiance(coat, cos_l, cos_o, ((cos_l + cos_o) / lo).clamp(max=1), lo / 2)  # (b, n, 3, k)
        lit = shade(arriving.gather(2, patch[:, None].expand(-1, L.shape[1], -1)), cos_l)
        sent *= lit[:, :, None] * share[:, None]
        values = last = bounce.gather(sent.flatten(1, 2).transpose(1, 2), row)  # (b, s s, n 3)
        for _ in range(recipe.bounces - 1):  # what has arrived at a point leaves it as if it were matt
            arrived = bounce.spread(last, *everywhere).transpose(1, 2)  # (b, n 3, s s)
            sent = arrived.gather(2, there[:, None].expand(-1, arrived.shape[1], -1)).view_as(sent) * passed_on[:, None]
            last = bounce.gather(sent.flatten(1, 2).transpose(1, 2), row)
            values = values + last
        return bounce.spread(values, *near).view(b, -1, lit.shape[1], 3).permute(0, 2, 3, 1)

    return reflected
