"""Two lobes at a pixel: I = (rho + pi F0 lobe) max(n.l, 0), matt and a GGX highlight; least squares for each roughness.

F0 is what the surface reflects at right angles, in the unit of the albedo rho. What Schlick's law adds to it is at most
(1 - cos 45 deg)^5 = 0.2 % of white for lights on the camera's side. It is left out: pictures do not show what white is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.methods.albedo import STEEPEST, matt_rank
from photonormal.shading import cosines, ggx, half_vectors

ROUGHNESS = torch.logspace(-1, 0, 20)  # that are tried
LEAST = 0.01  # weight in the grey level of a channel that is saturated under all lights; 1: under none
LOW = 0.4  # quantile of I / n.l in no shadow that is taken for the matt part at first: highlights are above it
SHADE = 0.4  # of that, below which a sample lies in a shadow
BLACK = 1e-10  # least variance at all, in squares of the samples' mean: some pixels are black under all lights
NOISE = 1e-4  # least variance, over the signal's square: what the model can't explain anyway
FAINT = 0.06  # a highlight that is seen adds this to the matt part where that is brightest
FLANK = 0.08  # of the lobe's peak: a light must show so much of it
EXPLAINED = 0.2  # of what the matt part leaves: the highlight must explain so much
SCARCE = 0.5  # share of a channel's samples below which it does not part both lobes: the other channels do
BARE = 0.05  # share of the albedo in albedo + F0 below which there is no matt part
BROADEST = 0.8  # roughness from which a highlight looks like what matt surfaces show
CERTAIN = 0.8  # of what the matt part leaves, where the highlight is to show that there is no matt part
ALIKE = 0.98  # cosine between the samples of both lobes above which they can't be separated


@dataclass(frozen=True)
class FittedLobes:
    """Both lobes of some pixels.

    Parameters
    ----------
    albedo, F0 : not below zero
    alone : the albedo if there is no highlight
    told : True where the lights show a highlight that fits
    certain : it fits so well, and so unlike a matt part, that it shows how much of that there is
    """

    albedo: Float[Tensor, "p c"]
    F0: Float[Tensor, "p c"]
    alone: Float[Tensor, "p c"]
    told: Bool[Tensor, " p"]
    certain: Bool[Tensor, " p"]


@dataclass(frozen=True)
class ReflectanceSamples:
    """What some pixels show, and how each light meets them.

    Parameters
    ----------
    I : radiance
    cos_l, cos_v, cos_h : n.l, n.v and n.h
    w : weights, one over the squared level of a sample; 0 where it is in shadow, and of a channel that is saturated
    lit : which ones are in no shadow, saturated ones too
    albedo : a first guess
    """

    I: Float[Tensor, "p n c"]
    cos_l: Float[Tensor, "p n"]
    cos_v: Float[Tensor, "p 1"]
    cos_h: Float[Tensor, "p n"]
    w: Float[Tensor, "p n c"]
    lit: Bool[Tensor, "p n"]
    albedo: Float[Tensor, "p c"]

    def lobe(self, roughness: Float[Tensor, "#p 1"] | Tensor) -> Float[Tensor, "p n"]:
        """pi D G / (4 n.l n.v) max(n.l, 0): the radiance of a highlight whose F0 is 1."""
        cos = self.cos_l.clamp(min=1e-3)
        return math.pi * ggx(cos, self.cos_v.clamp(min=0.05), self.cos_h, roughness**4) * cos


def samples(
    I: Float[Tensor, "p n c"],
    N: Float[Tensor, "p 3"],
    L: Float[Tensor, "n 3"] | Float[Tensor, "p n 3"],
    saturated: Bool[Tensor, "p n c"],
) -> ReflectanceSamples:
    """Samples and their weights: those in shadow are found by a low quantile of I / n.l over the lights."""
    cos_l = cosines(N, L)
    facing = cos_l > STEEPEST
    count = facing.sum(1, keepdim=True)
    trusted = (facing[..., None] & ~saturated).sum(1) + LEAST * count  # (p, c)
    Y = (I @ trusted[..., None])[..., 0] / trusted.sum(1, keepdim=True).clamp(min=1e-12)  # (p, n)
    ratio = torch.where(facing, Y / cos_l.clamp(min=STEEPEST), torch.inf)
    order = torch.from_numpy(np.argsort(ratio.numpy(), axis=1))  # several times as fast as torch's
    at = order.gather(1, torch.from_numpy(matt_rank(ratio.gather(1, order).numpy(), count.numpy(), LOW)))
    steep = cos_l.gather(1, at).clamp(min=STEEPEST)
    albedo = I.gather(1, at[..., None].expand(-1, 1, I.shape[2]))[:, 0] / steep * (count > 0)
    level = Y.gather(1, at) / steep
    lit = facing & (Y >= SHADE * level * cos_l)
    sigma = level + Y + 1e-3 * Y.amax(1, keepdim=True)
    cos = cos_l.clamp(0, 1)
    grazing = level * cos * (1 - cos) ** 5  # by so much matt surfaces differ from Lambert's, as F. Schlick's law has it
    variance = (sigma.square() + grazing.square() / NOISE).clamp(min=BLACK)
    w = (lit / variance)[..., None] * ~saturated
    return ReflectanceSamples(I, cos_l, N[:, 2:], cosines(N, half_vectors(L)), w, lit, albedo)


def log_likelihood(s: ReflectanceSamples) -> Float[Tensor, "p r"]:
    """Of each of ROUGHNESS, the best matt and highlight colours given; zero for the best one of a pixel."""
    matt = s.cos_l.clamp(min=0)
    wI, wm = s.w * s.I, s.w * matt[..., None]  # (p, n, c)
    both = torch.cat([wI, wm], -1)
    Im, mm = (matt[:, None] @ both)[:, 0].chunk(2, -1)  # (p, c)
    mm = mm.clamp(min=1e-12)
    rest = (wI * s.I).sum((1, 2)) - (Im.square() / mm).sum(1)  # (p,) what the matt part leaves
    G = torch.stack([s.lobe(roughness) for roughness in ROUGHNESS], 1)  # (p, r, n)
    Ig, gm = (G @ both).chunk(2, -1)  # (p, r, c)
    gg = G.square_() @ s.w - gm.square() / mm[:, None]  # the lobe, without what the matt part explains
    Ig = (Ig - (Im / mm)[:, None] * gm).clamp(min=0)
    left = rest[:, None] - (Ig.square() / gg.clamp(min=1e-9)).sum(-1)  # (p, r)
    degrees = (s.w > 0).sum((1, 2))[:, None]
    values = -0.5 * degrees * torch.log(left.clamp(min=0) / degrees.clamp(min=1) + NOISE)
    return values - values.amax(1, keepdim=True)


def likeliest(values: Float[Tensor, "p r"]) -> Float[Tensor, " p"]:
    """The roughness at the top of the parabola through the largest of the log-likelihoods and its neighbours."""
    k = values.argmax(1, keepdim=True)
    inner = k.clamp(1, values.shape[1] - 2)
    a, b, c = (values.gather(1, inner + i)[:, 0] for i in (-1, 0, 1))
    bend = (2 * b - a - c).clamp(min=1e-12)
    between = torch.where(k == inner, (0.5 * (c - a) / bend)[:, None].clamp(-0.5, 0.5), 0.0)
    log = ROUGHNESS.log()
    return torch.exp(log[k] + between * (log[1] - log[0]))[:, 0]


def fitted_lobes(s: ReflectanceSamples, roughness: Float[Tensor, " p"]) -> FittedLobes:
    """The lobes in least squares at a given roughness."""
    matt, g = s.cos_l.clamp(min=0), s.lobe(roughness[:, None])
    both = torch.stack([matt, g], 1)  # (p, 2, n)
    Im, Ig = (both @ (s.w * s.I)).unbind(1)  # (p, c)
    mm, gg = (both.square() @ s.w).clamp(min=1e-12).unbind(1)
    gm = ((matt * g)[:, None] @ s.w)[:, 0]
    det = (mm * gg - gm.square()).clamp(min=1e-6 * mm * gg)
    rho, F0 = (gg * Im - gm * Ig) / det, (mm * Ig - gm * Im) / det
    rho, F0 = torch.where(F0 < 0, Im / mm, rho), torch.where(rho < 0, Ig / gg, F0)
    rho, F0 = rho.clamp(min=0), F0.clamp(min=0)

    def left(rho: Tensor, F0: Tensor) -> Float[Tensor, " p"]:
        model = matt[..., None] * rho[:, None] + g[..., None] * F0[:, None]  # (p, n, c)
        return (s.w * (s.I - model).square()).sum((1, 2))

    alone = Im / mm
    unexplained, of = left(rho, F0), left(alone, torch.zeros_like(F0))
    a2 = roughness[:, None] ** 4
    near = (a2 / ((a2 - 1) * s.cos_h.square() + 1)).square() > FLANK  # of D over its peak
    brightest = (rho.mean(-1, keepdim=True) * matt * s.lit).amax(1, keepdim=True)
    shown = s.lit & near & (F0.mean(-1, keepdim=True) * g > FAINT * brightest)
    scarce = (s.w > 0).sum(1) < SCARCE * s.lit.sum(1, keepdim=True)  # (p, c)
    told = shown.any(1) & ~scarce.all(1) & (unexplained < (1 - EXPLAINED) * of) & (roughness < BROADEST)
    certain = told & (unexplained < (1 - CERTAIN) * of) & (gm.square().sum(1) < ALIKE**2 * (mm * gg).sum(1))
    alone = torch.where((s.w > 0).any(1), alone, s.albedo)
    matt_part, shine, channels = ((part * ~scarce).sum(1, keepdim=True) for part in (rho, F0, torch.ones_like(rho)))
    bare = matt_part < BARE * (matt_part + shine)
    rho = torch.where(scarce, alone * ~bare, rho)
    F0 = torch.where(scarce, shine / channels.clamp(min=1), F0)
    return FittedLobes(rho, F0, alone, told, certain)
