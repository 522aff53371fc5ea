"""What the camera makes of the light: exposure, noise, saturation, quantisation, and what goes wrong in a set-up."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.synth.coarse import Coarsening, stored
from photonormal.synth.params import tensor
from photonormal.synth.recipes import Rendering

SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
JUMP = 3.0  # pixels of depth by which a surface breaks off
Pictures = Float[Tensor, "c n 3 h w"]


def expose(I: Pictures, crops: int, saturated: Float[Tensor, " b"]) -> tuple[Pictures, Float[Tensor, " b"]]:
    """Scale each scene (of `crops` windows each) so that the share `saturated` of its samples exceeds 1, or none.

    Also gives the level that nine tenths of a scene's lit samples stay below.
    """
    b = len(saturated)
    samples = I.view(b, crops, *I.shape[1:]).transpose(2, 3).flatten(3)  # (b, crops, 3, n h w)
    brightest = samples.amax((1, 2, 3))
    samples = samples[:, :, 1, :: max(1, crops * samples.shape[3] // 32768) | 1].flatten(1).sort(-1).values  # green
    lit = (samples > 0).sum(-1)

    def exceeded(share: Tensor) -> Tensor:
        return samples.gather(1, samples.shape[1] - 1 - (lit * share).long()[:, None])[:, 0]

    level = torch.where(saturated > 0, exceeded(saturated), brightest).clamp(min=1e-6)  # (b,)
    return I / level.repeat_interleave(crops).view(-1, 1, 1, 1, 1), exceeded(torch.full_like(level, 0.1)) / level


def photograph(
    I: Pictures,
    noise: Float[Tensor, " c"],
    levels: Float[Tensor, " c"],
    generator: torch.Generator,
    black: Float[Tensor, " c"] | None = None,
) -> Pictures:
    """Shot and read noise, saturation at 1 and quantisation of linear values.

    `noise` is the standard deviation at full scale; it falls with the square root of the light to a third of it.
    `levels` is how many steps there are up to 1; 0 for values that stay as they are. `black`, in steps, is added
    before rounding: -0.5 cuts off what is not a full step.
    """
    per = noise.view(-1, 1, 1, 1, 1)
    if bool((noise > 0).any()):
        sigma = I.clamp(0, 1).mul_(0.9).add_(0.1).sqrt_().mul_(per)  # in place: memory costs more than arithmetic here
        I = sigma.mul_(torch.randn(I.shape, generator=generator, device=I.device)).add_(I)
    I = I.clamp(0, 1)
    if not bool((levels > 0).any()):
        return I
    steps = levels.view(-1, 1, 1, 1, 1)
    counted = I * steps
    if black is not None and bool((black != 0).any()):
        counted += black.view(-1, 1, 1, 1, 1)
    return torch.where(steps > 0, counted.round_().clamp_(min=0).minimum(steps) / steps.clamp(min=1), I)


def misaligned(L: np.ndarray, g: np.random.Generator, sigma_deg: np.ndarray) -> np.ndarray:
    """Directions (b, n, 3) measured with an error of `sigma_deg` (b,) degrees about each of two axes."""
    tilt = g.normal(size=L.shape) * np.radians(sigma_deg)[:, None, None]
    tilt -= (tilt * L).sum(-1, keepdims=True) * L
    wrong = L + tilt
    wrong /= np.linalg.norm(wrong, axis=-1, keepdims=True)
    return np.where(wrong[..., 2:] > 0.02, wrong, L)


def soften(
    I: Pictures, height: Float[Tensor, "c h w"], mask: Bool[Tensor, "c h w"], generator: torch.Generator
) -> Pictures:
    """Mix pixels on occluding edges with what lies beyond, as a pixel that covers both does.

    The own surface fills at least half of such a pixel, since its centre is on it.
    """
    h, w = I.shape[-2:]
    z = torch.where(mask, height, -1e3)
    padded = torch.nn.functional.pad(z, (1, 1, 1, 1), value=torch.nan)
    drop = torch.stack([padded[:, 1 + r : 1 + r + h, 1 + c : 1 + c + w] for r, c in SIDES]) - z  # (4, c, h, w)
    bend = torch.nan_to_num(drop[0::2] + drop[1::2]).abs().amax(0)  # 0 on a plane however steep, and on the border
    side = torch.nan_to_num(drop).abs().argmax(0)
    window, row, col = (mask & (bend > JUMP)).nonzero().unbind(1)
    if len(window) == 0:
        return I
    step = torch.tensor(SIDES, device=I.device)[side[window, row, col]]
    beyond = I[window, :, :, (row + step[:, 0]).clamp(0, h - 1), (col + step[:, 1]).clamp(0, w - 1)]  # (e, n, 3)
    share = 0.5 * torch.rand(len(window), 1, 1, generator=generator, device=I.device)
    out = I.clone()
    out[window, :, :, row, col] = torch.lerp(I[window, :, :, row, col], beyond, share)
    return out


def blur(I: Pictures, share: Float[Tensor, " c"]) -> Pictures:
    """Give the share, up to 1/4, of each pixel's light to either side in rows and columns: a lens not quite sharp."""
    some = (share > 0).nonzero()[:, 0]
    if len(some) == 0:
        return I
    x, a = I[some], share[some].view(-1, 1, 1, 1, 1)
    for axis in (3, 4):
        last = x.shape[axis] - 1
        sides = torch.cat([x.narrow(axis, 0, 1), x.narrow(axis, 0, last)], axis)
        sides += torch.cat([x.narrow(axis, 1, last), x.narrow(axis, last, 1)], axis)
        x = torch.addcmul(x * (1 - 2 * a), sides, a.expand_as(sides))
    I = I.clone()
    I[some] = x
    return I


def corrupt(I: Pictures, share: Float[np.ndarray, " c"], g: np.random.Generator) -> Pictures:
    """In the share of each window's images a half or a patch is dimmed or brightened, or the image is shifted."""
    if not (share > 0).any():
        return I
    c, n, _, h, w = I.shape
    hurt = g.random((c, n)) < share[:, None]
    window, image = (torch.from_numpy(i) for i in np.nonzero(hurt))
    k = len(window)
    if k == 0:
        return I
    angle = g.uniform(0, 2 * math.pi, k)
    normal = tensor(np.stack([np.cos(angle), np.sin(angle)]))[..., None, None].to(I.device)  # (2, k, 1, 1)
    y, x = torch.meshgrid(torch.linspace(-1, 1, h), torch.linspace(-1, 1, w), indexing="ij")
    x, y = x.to(I.device), y.to(I.device)
    offset = tensor(g.uniform(-0.7, 0.7, (k, 1, 1))).to(I.device)
    half = normal[0] * x + normal[1] * y > offset
    patch = (x - normal[0] * 0.5).square() + (y - normal[1] * 0.5).square() < (0.3 + offset.abs()) ** 2
    chosen = torch.where(torch.from_numpy(g.random((k, 1, 1)) < 0.5).to(I.device), half, patch)
    factor = np.where(g.random(k) < 0.65, g.uniform(0.0, 0.75, k), g.uniform(1.3, 2.5, k))
    gain = torch.where(chosen, tensor(factor)[:, None, None].to(I.device), 1.0)
    wrong = (I[window, image] * gain[:, None]).clamp(max=1)  # of the sensor's range
    shifted = g.random(k) < 0.25
    moves = g.integers(-3, 4, (k, 2))
    for i in np.flatnonzero(shifted):
        wrong[i] = torch.roll(I[window[i], image[i]], tuple(moves[i]), (-2, -1))
    I = I.clone()
    I[window, image] = wrong
    return I


def sensed(
    I: Pictures,
    L: Float[Tensor, "b n 3"],
    height: Tensor,
    mask: Tensor,
    recipe: Rendering,
    g: np.random.Generator,
    generator: torch.Generator,
) -> tuple[Pictures, Float[Tensor, "c n 3"]]:
    """What a camera makes of the windows of `b` scenes, and the lights as somebody measured them.

    `height` and `mask` are (c, h, w).
    """
    b, n, _ = L.shape
    c = len(I) // b  # windows of each scene
    device = I.device

    def drawn(values: np.ndarray) -> Tensor:
        return tensor(values.astype(float)).to(device)

    if recipe.smooth_edges:
        I = soften(I, height, mask, generator)
    if recipe.blurred:
        I = blur(I, drawn(0.2 * g.random(b) * (g.random(b) < recipe.blurred)).repeat_interleave(c))
    coarse = Coarsening.drawn(recipe, g, b, n)
    saturated = recipe.saturated * g.random(b) ** 2 * (g.random(b) < 0.7)
    I, bright = expose(I, c, drawn(np.maximum(saturated, coarse.clipped)))
    if recipe.intensity_error:
        error = recipe.intensity_error * g.random((b, 1)) * g.normal(size=(b, n))
        I = I * drawn(1 + error).repeat_interleave(c, 0)[:, :, None, None, None]
    bits = np.where(g.random(b) < recipe.low_bits, 8.0, 16.0) * (recipe.low_bits > 0)
    levels = np.where(coarse.levels > 0, coarse.levels, 2**bits - 1)
    noise = (drawn(recipe.noise * g.random(b) ** 2) * bright.clamp(max=1)).repeat_interleave(c)
    coarse, levels = coarse.windows(c), drawn(levels).repeat_interleave(c)
    gain = drawn(coarse.gain)[:, :, None, None, None]
    I = stored(photograph(I * gain, noise, levels, generator, drawn(coarse.black)), coarse, g) / gain
    share = np.where(g.random(b) < recipe.corrupted, g.uniform(0.05, 0.3, b), 0.0)
    I = corrupt(I, np.repeat(share, c), g)
    if recipe.directions:
        known = np.tile(recipe.directions, (b, 1, 1))
    else:
        known = misaligned(L.cpu().numpy().astype(np.float64), g, recipe.light_error_deg * g.random(b))
    return I, drawn(known).repeat_interleave(c, 0)
