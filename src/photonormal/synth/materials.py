"""What scenes are made of: measured or principled reflectance, plain or varying over the surface."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from photonormal.synth.brdf.abc import ABC
from photonormal.synth.brdf.merl import Merl, read_merl
from photonormal.synth.brdf.neural import Neural
from photonormal.synth.brdf.principled import Principled
from photonormal.synth.brdf.sgd import SGD
from photonormal.synth.library import FAMILIES, Library
from photonormal.synth.params import log_uniform, take, tensor
from photonormal.synth.waves import Waves, draw_waves

PALETTE, SEEDS = 4, 24
LAMBERT = FAMILIES.index("lambert")
PRINCIPLED = {"matt": 0.19, "plastic": 0.23, "metal": 0.25, "cloth": 0.07, "coated": 0.12, "glazed": 0.14}
METAL = {"metal": 1.0}
PATTERNS = ("plain", "patches", "cells", "gradient", "veins")
BRIGHTEST = 60.0  # bound of pi f at mirror geometry, in times a white matt surface

Reflectance = Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]  # four cosines (b, n, p) -> f (b, n, 3, p)


@dataclass(frozen=True)
class Coats:
    """Surface properties of `b` scenes."""

    family: Int[Tensor, "b 2"]  # of each layer, into FAMILIES
    material: Int[Tensor, "b 2"]  # of each measured layer, into its table
    channels: Int[Tensor, "b 3"]  # permutation of the measured colours
    blend: Float[Tensor, " b"]  # share of layer 2 everywhere; -1: where the pattern says
    log_space: Float[Tensor, " b"]  # 1: blended as logarithms
    palette: Float[Tensor, "b 4 11"]  # principled parameters
    pattern: Int[Tensor, " b"]
    fields: Waves  # one for each palette entry
    seeds: Float[Tensor, "b 24 3"]
    seed_colours: Float[Tensor, "b 24 3"]
    seed_entry: Int[Tensor, "b 24"]
    texture: Waves  # three fields: light and dark, hue, stains
    contrast: Float[Tensor, "b 3"]
    hue: Float[Tensor, "b 3"]


@dataclass(frozen=True)
class Skin:
    """Reflectance of some of the scenes at given points, ready for any light."""

    scenes: Tensor  # indices
    albedo: Float[Tensor, "c 3 p"]  # for the bounce
    f: Reflectance


def dress(coats: Coats, p: Float[Tensor, "b 3 p"], shelf: Library | None) -> list[Skin]:
    """Evaluate patterns and textures at points of the surface: skins whose values add up in each scene."""
    weights = _weights(coats, p)  # (b, 4, p)
    tint, stain = _texture(coats, p)  # (b, 3, p), (b, p)
    skins = []
    principled = (coats.family[:, 0] == 0).nonzero()[:, 0]
    if principled.numel():
        values = coats.palette[principled].transpose(1, 2) @ weights[principled]  # (c, 11, p)
        base = (values[:, :3] * tint[principled]).clamp(0.01, 0.97)
        rough = (values[:, 4] + 0.35 * stain[principled]).clamp(0.12, 1)
        values = torch.cat([base, values[:, 3:4], rough[:, None], values[:, 5:]], 1)
        metal = values[:, 3:4]
        matt = base * torch.lerp(torch.ones_like(metal), 0.85 * metal, metal)
        skins.append(Skin(principled, matt, Principled(values[:, None])))
    matt = (coats.family[:, 0] == LAMBERT).nonzero()[:, 0]
    if matt.numel():
        base = coats.palette[matt, :, :3].transpose(1, 2) @ weights[matt]
        skins.append(_lambert(matt, (base * tint[matt]).clamp(0.01, 0.97)))
    for scenes in ((coats.family[:, 0] > 0) & (coats.family[:, 0] < LAMBERT)).nonzero():  # measured: one at a time
        skins.append(_measured(take(coats, scenes), scenes, weights[scenes], tint[scenes], shelf))
    return skins


def radiance(skins: list[Skin], cos_l: Tensor, cos_v: Tensor, cos_h: Tensor, cos_d: Tensor) -> Tensor:
    """pi f(l, v) for each scene, light and point, (b, n, 3, p): 1 for a white matt surface, bounded near mirrors."""
    b, n, p = cos_l.shape
    out = cos_l.new_empty(b, n, 3, p)
    whole = len(skins) == 1 and len(skins[0].scenes) == b
    for skin in skins:
        i = slice(None) if whole else skin.scenes
        f = skin.f(cos_l[i].clamp(min=1e-3), cos_v[i].clamp(min=0.05), cos_h[i], cos_d[i])
        out[i] = f.mul(math.pi).clamp_(0, BRIGHTEST)
    return out


def _lambert(scenes: Tensor, albedo: Tensor) -> Skin:
    return Skin(
        scenes, albedo, lambda cos_l, *_: (albedo / math.pi)[:, None].expand(-1, cos_l.shape[1], -1, -1).clone()
    )


def _measured(coat: Coats, scenes: Tensor, weights: Tensor, tint: Tensor, shelf: Library | None) -> Skin:
    """A measured material, or a mixture of two: of their values or of their logarithms."""
    assert shelf is not None
    share = coat.blend.clamp(min=0) + (coat.blend < 0) * weights[:, 1]  # (1, p)
    layers = [_layer(coat, k, tint, shelf) for k in (0, 1)]
    if not bool((share > 0).any()):
        return Skin(scenes, *layers[0])
    log_space = bool(coat.log_space[0] > 0)
    (albedo_1, f1), (albedo_2, f2) = layers
    w = share[:, None]  # (1, 1, p)

    def f(*cosines: Tensor) -> Tensor:
        a, b = f1(*cosines), f2(*cosines)
        if log_space:
            return torch.exp(torch.lerp(torch.log(a.clamp(min=1e-4)), torch.log(b.clamp(min=1e-4)), w[:, None]))
        return torch.lerp(a, b, w[:, None])

    return Skin(scenes, torch.lerp(albedo_1, albedo_2, w), f)


def _layer(coat: Coats, k: int, tint: Tensor, shelf: Library) -> tuple[Tensor, Reflectance]:
    """Albedo (1, 3, p) and reflectance of one measured layer; the texture colours its matt part."""
    family, i, channels = FAMILIES[int(coat.family[0, k])], int(coat.material[0, k]), coat.channels[0]
    colour = tint[:, None]  # (1, 1, 3, p)
    device = tint.device
    if family in ("neural", "merl"):
        if family == "neural":
            w1, w2, w3, b1, b2, b3 = (w[i : i + 1].to(device) for w in shelf.neural)
            model: Reflectance = Neural(w1, w2, w3[..., channels], b1, b2, b3[..., channels])
            mean = shelf.neural_albedo[i].to(device)[channels]
        else:
            table = read_merl(shelf.merl[i])[None].to(device)
            model, mean = Merl(table[..., channels]), table.clamp(max=1).mean((0, 1, 2, 3))[channels] * math.pi
        return (mean[None, :, None] * tint).clamp(0, 0.95), lambda *cosines: model(*cosines) * colour
    if family == "sgd":
        values = shelf.sgd[i].to(device)[:, channels]
        gloss = shelf.sgd_gloss[i].to(device)[channels]
        # one lobe for the three channels, which were fitted apart, at the albedo of each: no coloured peaks
        lobe = SGD(values[None, None, :, :1, None])
        ratio = (gloss / gloss[0].clamp(min=1e-4)).clamp(0.05, 20)[:, None]  # (3, 1)
        matt = values[0].clamp(min=0)[:, None]

        def f(*cosines: Tensor) -> Tensor:
            return lobe.specular(*cosines) * ratio + matt * colour / math.pi

    else:
        order = torch.cat([channels, 3 + channels, channels.new_tensor([6, 7, 8])])
        values = shelf.abc[i].to(device)[order]
        gloss = shelf.abc_gloss[i].to(device)[channels]
        model = ABC(values[None, None, :, None])
        matt = values[:3].clamp(min=0)[:, None]

        def f(*cosines: Tensor) -> Tensor:
            return model.specular(*cosines) + matt * colour / math.pi

    return (matt * tint + 0.8 * gloss[:, None]).clamp(0, 0.95), f


def _weights(coats: Coats, p: Float[Tensor, "b 3 p"]) -> Float[Tensor, "b 4 p"]:
    """Share of each palette entry at each point."""
    pattern = coats.pattern[:, None, None]
    weights = p.new_tensor([1.0, 0, 0, 0])[:, None].expand(len(p), PALETTE, p.shape[2])
    if not bool((pattern > 0).any()):
        return weights
    fields = coats.fields(p)  # (b, 4, p)
    fields = torch.where(pattern == PATTERNS.index("veins"), _veins(fields), fields)
    sharp = torch.where(pattern == PATTERNS.index("gradient"), 2.5, 60.0)
    weights = torch.where(pattern > 0, torch.softmax(fields * sharp, 1), weights)
    cells = pattern == PATTERNS.index("cells")
    if bool(cells.any()):
        entry = coats.seed_entry.gather(1, _cell(coats, p))[:, None]
        weights = torch.where(cells, (entry == torch.arange(PALETTE, device=p.device)[:, None]).float(), weights)
    return weights


def _veins(fields: Tensor) -> Tensor:
    """Entry 1 along thin lines through entry 0: scratches, veins, writing."""
    line = 0.12 - fields[:, :1].abs()
    return torch.cat([torch.zeros_like(line), line * 2, torch.full_like(fields[:, 2:], -9.0)], 1)


def _cell(coats: Coats, p: Tensor) -> Tensor:
    """Index of the nearest seed, (b, p)."""
    return torch.baddbmm(coats.seeds.square().sum(-1, keepdim=True), coats.seeds, p, alpha=-2).argmin(1)


def _texture(coats: Coats, p: Tensor) -> tuple[Tensor, Tensor]:
    """Colour that multiplies the albedo, (b, 3, p), and roughening stains, (b, p)."""
    if bool((coats.contrast > 0).any()):
        value, hue, stain = coats.texture(p).unbind(1)  # (b, p)
        stain = torch.sigmoid((stain - 0.9) * 9) * coats.contrast[:, 2, None]
        shade = torch.exp(coats.contrast[:, 0, None] * value - 1.2 * stain)[:, None]
        tint = shade * torch.exp((coats.contrast[:, 1, None] * hue)[:, None] * coats.hue[..., None])
    else:
        tint, stain = torch.ones_like(p), p.new_zeros(len(p), p.shape[2])
    cells = (coats.pattern == PATTERNS.index("cells"))[:, None, None]
    if bool(cells.any()):
        colour = coats.seed_colours.transpose(1, 2).gather(2, _cell(coats, p)[:, None].expand(-1, 3, -1))
        tint = torch.where(cells, tint * colour, tint)
    return tint, stain


def draw_coats(
    g: np.random.Generator,
    b: int,
    mix: tuple[float, ...],
    varying: float,
    shelf: Library | None,
    kinds: dict[str, float] = PRINCIPLED,
) -> Coats:
    """`mix` are the shares of FAMILIES (those that no file is there for go to the others), `varying` of patterns.

    `kinds` are the shares of kinds of principled materials.
    """
    share = np.asarray(mix, float) * [1, *[shelf is not None] * 3, bool(shelf and shelf.merl), 1]
    if share.sum() == 0:
        share[0] = 1
    first = g.choice(len(FAMILIES), b, p=share / share.sum())
    other = np.where((first == 0) | (first == LAMBERT), first, np.where(g.random(b) < 0.7, first, g.integers(1, 4, b)))
    count = [1, *[len(shelf.names) if shelf else 1] * 3, max(1, len(shelf.merl)) if shelf else 1, 1]
    family = np.stack([first, other], -1)
    pattern = np.where(g.random(b) < varying, g.choice([1, 2, 3, 4], b, p=[0.4, 0.2, 0.25, 0.15]), 0)
    measured_mix = np.where(pattern > 0, -1.0, np.where(g.random(b) < 0.25, g.uniform(0.2, 0.8, b), 0.0))
    textured = (g.random((b, 3)) < [0.45, 0.35, 0.25]) & (g.random(b) < varying + 0.15)[:, None]
    seeds = g.uniform(-1.2, 1.2, (b, SEEDS, 3))
    return Coats(
        torch.from_numpy(family),
        torch.from_numpy((g.random((b, 2)) * np.asarray(count)[family]).astype(np.int64)),
        torch.from_numpy(np.argsort(g.random((b, 3)), -1).copy()),
        tensor(measured_mix),
        tensor((g.random(b) < 0.5).astype(float)),
        tensor(np.stack([_palette(g, kinds) for _ in range(b)])),
        torch.from_numpy(pattern),
        draw_waves(g, log_uniform(g, 1.5, 9, (b, 1)) * np.ones((1, PALETTE)), 1.5),
        tensor(seeds),
        tensor(np.exp(g.normal(0, 0.35, (b, SEEDS, 3)) - 0.2)),
        torch.from_numpy(g.integers(0, PALETTE, (b, SEEDS))),
        draw_waves(g, log_uniform(g, 2, 25, (b, 3)), 2.0),
        tensor(textured * g.uniform(0.1, [0.5, 0.3, 1.0], (b, 3))),
        tensor(g.normal(size=(b, 3))),
    )


def _palette(g: np.random.Generator, kinds: dict[str, float]) -> np.ndarray:
    """Four related principled materials (4, 11)."""
    first = _principled(g, kinds)
    same = g.random() < 0.6
    entries = [first]
    for _ in range(PALETTE - 1):
        other = _principled(g, kinds)
        if same:  # another colour of the same stuff
            entries.append(np.concatenate([other[:3], first[3:4], [first[4] * g.uniform(0.8, 1.25)], first[5:]]))
        else:
            entries.append(other)
    return np.stack(entries)


def _principled(g: np.random.Generator, kinds: dict[str, float]) -> np.ndarray:
    kind = g.choice(list(kinds), p=list(kinds.values()))
    value, saturation, hue = g.uniform(0.15, 0.95), g.beta(1.1, 2.2), g.uniform(0, 2 * np.pi)
    base = value * (1 - 0.85 * saturation * (0.5 + 0.5 * np.cos(hue + np.array([0, 2.1, 4.2]))))
    metallic, rough, spec = 0.0, g.uniform(0.45, 1), g.uniform(0, 0.4)
    sheen = coat = gloss = 0.0
    if kind == "plastic":
        rough, spec = g.uniform(0.18, 0.6), g.uniform(0.3, 1.0) * (1 if g.random() < 0.7 else 2.5)
    elif kind == "metal":
        metallic, rough, spec = 1.0, log_uniform(g, 0.2, 0.7, ()), 0.5
        metals = [[0.95, 0.72, 0.35], [0.95, 0.6, 0.5], [0.9, 0.9, 0.92], [0.6, 0.57, 0.53], [0.75, 0.7, 0.6]]
        base = np.clip(np.array(metals[g.integers(5)]) * g.uniform(0.6, 1) + g.normal(0, 0.04, 3), 0.05, 0.97)
        if g.random() < 0.25:
            metallic = g.uniform(0.3, 0.8)
    elif kind == "cloth":
        rough, sheen = g.uniform(0.7, 1), g.uniform(0.3, 1)
    elif kind == "coated":
        rough, coat, gloss = g.uniform(0.3, 0.9), g.uniform(0.4, 1), g.uniform(0, 0.75)
    elif kind == "glazed":  # dark, under a sharp highlight
        rough, spec = log_uniform(g, 0.15, 0.4, ()), g.uniform(0.4, 0.9)
        base = base * log_uniform(g, 0.04, 0.6, ())
    return np.array([*base, metallic, rough, spec, g.random(), sheen, g.random(), coat, gloss])


def at_points(values: Tensor, pixels: Tensor) -> Tensor:
    """Values (b, k, s, s) of maps at pixels (b, p): (b, k, p)."""
    return values.flatten(2).gather(2, pixels.long()[:, None].expand(-1, values.shape[1], -1))


def skins_albedo(skins: list[Skin], b: int) -> Float[Tensor, "b 3 p"]:
    """Albedo of all scenes for the bounce."""
    out = skins[0].albedo.new_empty(b, *skins[0].albedo.shape[1:])
    for skin in skins:
        out[skin.scenes] = skin.albedo
    return out
