"""Measuring with a network: images streamed one or a few at a time, in tiles where the object is large.

Memory does not grow with the number of images and is bounded in the number of pixels. The mask's box alone is computed;
tiles overlap by the network's reach, so they agree with the whole to rounding.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.solve.learned.network import Network, grey, moment, placed, scaled
from photonormal.solve.learned.pooling import Pooled
from photonormal.solve.learned.processor import inner_precision
from photonormal.types import Capture, InputError, Normals

log = logging.getLogger(__name__)

KEPT = 2**29  # bytes of features kept between images, unless one tile alone needs more
PRIOR = 2**26  # grey levels that a prior other than least squares looks at in one pass over the images
PART = 2**13  # pixels of an image that a processor encodes at a time
AHEAD = 2**22  # pixels of a frame up to which the next one is decoded while this one is computed


def measure(
    net: Network,
    capture: Capture,
    device: torch.device,
    rotations: int = 1,
    tile: int = 0,
    prior: str | None = None,
    passes: int = 1,
) -> Normals:
    """Normals of a capture by a network, on `device` (where it is moved).

    Parameters
    ----------
    rotations : 1, or 4: average over quarter turns of the images; four times the work
    tile : side of a tile in pixels, without its overlap; 0: 512 on a processor, 1024 on a GPU
    prior : a classical method in place of the one that the network learned with
    passes : how often the network looks; from the second time on its own normals are the prior
    """
    if rotations not in (1, 4):
        raise InputError(f"{rotations} rotations came but 1 or 4 is possible; quarter turns keep the pixels.")
    if passes < 1:
        raise InputError(f"{passes} passes came but at least 1 is needed.")
    tile = -(-(tile or (512 if device.type == "cpu" else 1024)) // net.stride) * net.stride
    net = placed(net, device).eval()
    box = Box.of(capture, net.stride)
    L = box.lights(capture).to(device)  # (n, 3), or (n, 3, h, w)
    start = time.perf_counter()
    with torch.inference_mode():
        look = first_look(net, capture, box, L, net.config.prior if prior is None else prior)
        log.info("prior and scale: %.2f s", time.perf_counter() - start)
        found = looked(net, capture, box, look, L, rotations, tile, passes)  # (3 or 4, h, w)
    log.info("network: %.2f s in all", time.perf_counter() - start)
    return box.normals(found[:3], found[3:], look.lit.cpu(), capture)


def looked(
    net: Network,
    capture: Capture,
    box: Box,
    look: Look,
    L: Float[Tensor, "n 3 *hw"],
    rotations: int,
    tile: int,
    passes: int,
) -> Float[Tensor, "d h w"]:
    """All passes over all images, some tiles at a time: normals and expected errors of the box, on the processor."""
    N: Tensor | None = None
    margin = passes * net.reach  # each pass reaches as far into what the pass before has found
    windows = box.windows(tile, margin)
    together = max(1, KEPT // (4 * net.floats * rotations * (tile + 2 * margin) ** 2))  # tiles
    for first in range(0, len(windows), together):
        tiles = [Tile(net, box, look, w, L, rotations) for w in windows[first : first + together]]
        chunk = 1 if L.device.type == "cpu" else max(1, 2**21 // (tiles[0].mask.numel() * rotations))
        for following in reversed(range(passes)):
            for t in tiles:
                t.begin(L, (following + 1) * net.reach)
            for j, images in frames(capture, box, L.device, chunk):
                for t in tiles:
                    t.add(images, L[j : j + images.shape[1]])
            for t in tiles:
                t.finish()
        for t in tiles:
            found = t.result()
            N = torch.zeros(len(found), *box.mask.shape) if N is None else N
            N[:, *t.core] = found
    assert N is not None  # a mask has pixels
    return N


@dataclass(frozen=True)
class Box:
    """The mask's box, its size rounded up to the network's stride."""

    top: int
    left: int
    mask: Tensor  # (h, w) bool

    @staticmethod
    def of(capture: Capture, stride: int) -> Box:
        ys, xs = (np.flatnonzero(capture.mask.any(axis)) for axis in (1, 0))
        top, left, bottom, right = int(ys[0]), int(xs[0]), int(ys[-1]) + 1, int(xs[-1]) + 1
        h, w = (-(-side // stride) * stride for side in (bottom - top, right - left))
        mask = torch.zeros(h, w, dtype=torch.bool)
        mask[: bottom - top, : right - left] = torch.from_numpy(capture.mask[top:bottom, left:right])
        return Box(top, left, mask)

    def crop(self, image: np.ndarray) -> Float[Tensor, "1 1 c h w"]:
        """This box of a picture (rows, columns, c); zero where the box reaches beyond it."""
        h, w = self.mask.shape
        inside = torch.from_numpy(image[self.top : self.top + h, self.left : self.left + w])
        crop = torch.zeros(1, 1, image.shape[2], h, w)
        crop[0, 0, :, : inside.shape[0], : inside.shape[1]] = inside.permute(2, 0, 1)
        return crop

    def lights(self, capture: Capture) -> Float[Tensor, "n 3 *hw"]:
        """Light directions (n, 3), or those that each pixel of the box sees."""
        L = torch.as_tensor(capture.known_lights(), dtype=torch.float32)
        if capture.lights_at is None:
            return L
        L = L[..., None, None].repeat(1, 1, *self.mask.shape)
        L[:, :, self.mask] = torch.from_numpy(capture.lights_at).permute(1, 2, 0)
        return L

    def windows(self, tile: int, reach: int) -> list[tuple[slice, slice, slice, slice]]:
        """Rows and columns of each tile, and of what it is computed from; tiles without a mask pixel are left out.

        A box that is less than two reaches larger than a tile is one tile.
        """
        h, w = self.mask.shape
        tile_h, tile_w = (s if s <= tile + 2 * reach else tile for s in (h, w))
        found = []
        for y in range(0, h, tile_h):
            for x in range(0, w, tile_w):
                core = slice(y, min(y + tile_h, h)), slice(x, min(x + tile_w, w))
                if self.mask[core].any():
                    rows = slice(max(0, core[0].start - reach), min(h, core[0].stop + reach))
                    columns = slice(max(0, core[1].start - reach), min(w, core[1].stop + reach))
                    found.append((*core, rows, columns))
        return found

    def normals(
        self,
        N: Float[Tensor, "3 h w"],
        expected_deg: Float[Tensor, "e h w"],
        lit: Bool[Tensor, "h w"],
        capture: Capture,
    ) -> Normals:
        """Maps of the whole picture, with the expected errors if any; pixels black in all images are left out."""
        h = min(self.mask.shape[0], capture.mask.shape[0] - self.top)
        w = min(self.mask.shape[1], capture.mask.shape[1] - self.left)
        here = slice(self.top, self.top + h), slice(self.left, self.left + w)
        mask = np.zeros_like(capture.mask)
        mask[here] = (self.mask & lit)[:h, :w].numpy()
        values = np.zeros((*mask.shape, 3), np.float32)
        values[here] = N[:, :h, :w].permute(1, 2, 0).numpy()
        expected = np.full(mask.shape, np.nan, np.float32) if len(expected_deg) else None
        if expected is not None:
            expected[here] = expected_deg[0, :h, :w].numpy()
        return Normals(values, mask, expected)


@dataclass(frozen=True)
class Look:
    """What a first pass over the images gives."""

    prior: Tensor  # (3, h, w), zero outside the mask
    moments: Tensor  # (1, c, h, w) or (1, 1, 1, 1), see network.moment
    lit: Tensor  # (h, w) bool, some image is not black here


def first_look(net: Network, capture: Capture, box: Box, L: Float[Tensor, "n 3 *hw"], prior: str) -> Look:
    """The prior, what scales the images, and the pixels that some light reached."""
    mask = box.mask[None, None].to(L.device)  # (1, 1, h, w)
    one_by_one = prior == "woodham" and L.ndim == 2  # least squares, one image at a time
    plus = torch.linalg.pinv(L.double()).float() if one_by_one else None  # (3, n)
    b = torch.zeros(3, *box.mask.shape, device=L.device)
    moments: Tensor | None = None
    lit = torch.zeros(box.mask.shape, dtype=torch.bool, device=L.device)
    for j, images in frames(capture, box, L.device, 1):
        I = grey(images)[0, 0, 0]  # (h, w)
        lit |= I > 0
        here = moment(net.scaling, images, mask)
        moments = here if moments is None else moments.add_(here)
        if plus is not None:
            b += plus[:, j, None, None] * I
    if moments is None or not (lit & mask[0, 0]).any():
        raise InputError(f"all pixels of {capture.name} inside the mask are dark; check exposure, mask and images.")
    if prior and plus is None:
        from photonormal.solve import method_class

        method = method_class(prior)()
        streamed = hasattr(method, "normals")  # else it takes the whole capture, with the memory that it needs
        b = by_blocks(method, capture, box, L) if streamed else box.crop(method(capture, L.device).map)[0, 0].to(L)
    b /= b.norm(dim=0, keepdim=True).clamp(min=1e-12)
    b *= mask[0]
    return Look(b, moments, lit)


def by_blocks(method: Any, capture: Capture, box: Box, L: Float[Tensor, "n 3 *hw"]) -> Float[Tensor, "3 h w"]:
    """Normals of a classical method that needs all images of a pixel: as many pixels at a time as memory allows."""
    where = box.mask.flatten().nonzero()[:, 0]  # (p,)
    N = torch.zeros(box.mask.numel(), 3, device=L.device)
    for block in where.to(L.device).split(max(1, PRIOR // len(L))):
        I = torch.empty(len(block), len(L), device=L.device)
        for j, images in frames(capture, box, L.device, 1):
            I[:, j] = grey(images).flatten()[block]
        for part in torch.arange(len(block), device=L.device).split(max(1, 2**22 // len(L))):
            seen = L if L.ndim == 2 else L.flatten(2)[..., block[part]].permute(2, 0, 1)  # (q, n, 3)
            N[block[part]] = method.normals(I[part], seen)
    return N.T.reshape(3, *box.mask.shape)


def frames(capture: Capture, box: Box, device: torch.device, chunk: int) -> Iterator[tuple[int, Tensor]]:
    """(j, images j, j + 1, ... (1, k, c, h, w)) of the box, up to `chunk` at a time."""
    n, h, w, _ = capture.images.shape
    held: list[Tensor] = []
    for j, image in enumerate(read_ahead(capture, box) if h * w <= AHEAD else map(box.crop, in_order(capture))):
        held.append(image)
        if len(held) == chunk or j == n - 1:
            together = held[0] if len(held) == 1 else torch.cat(held, dim=1)
            held = []
            yield j + 1 - together.shape[1], together.to(device)
            del image, together  # before the next is read


def in_order(capture: Capture) -> Iterator[np.ndarray]:
    """The pictures, one after the other."""
    return (capture.images[j] for j in range(capture.images.shape[0]))


def read_ahead(capture: Capture, box: Box) -> Iterator[Tensor]:
    """The box of every picture, the next ones read while one is looked at."""
    n = capture.images.shape[0]
    with ThreadPoolExecutor(1) as reader:
        waiting = [reader.submit(lambda j: box.crop(capture.images[j]), j) for j in range(min(2, n))]
        for j in range(n):
            image = waiting.pop(0).result()
            if j + 2 < n:
                waiting.append(reader.submit(lambda j: box.crop(capture.images[j]), j + 2))
            yield image


class Tile:
    """One part of the object: in each pass its share of every image goes in and normals come out."""

    def __init__(
        self, net: Network, box: Box, look: Look, window: tuple[slice, ...], L: Float[Tensor, "n 3 *hw"], rotations: int
    ) -> None:
        self.net, self.n = net, len(L)
        self.core, self.seen = window[:2], window[2:]
        self.mask = box.mask[self.seen][None, None].to(L.device)  # (1, 1, h, w)
        self.moments = look.moments if look.moments.numel() == 1 else look.moments[..., *self.seen]
        self.turns = range(rotations)
        self.found = look.prior[:, *self.seen][None]  # (1, d, h, w), the last pass's, or the prior

    def begin(self, L: Float[Tensor, "n 3 *hw"], margin: int) -> None:
        """A pass over the images begins, from the normals, and the network's memory, of the last one.

        What is more than `margin` pixels away from the tile is seen no more.
        """
        near = [slice(max(s.start, c.start - margin), min(s.stop, c.stop + margin)) for c, s in self.sides()]
        y, x = (slice(n.start - s.start, n.stop - s.start) for n, s in zip(near, self.seen, strict=True))
        self.seen, self.mask, self.found = tuple(near), self.mask[..., y, x], self.found[..., y, x]
        if self.moments.numel() > 1:
            self.moments = self.moments[..., y, x]
        prior = self.found[:, : 3 + self.net.memory].to(L.device) * self.mask
        with inner_precision(L.device):
            self.shared = [
                self.net.begin(turned(torch.rot90(prior, r, (2, 3)), r, 1), self.lights(L, r)) for r in self.turns
            ]
        self.parts = [parts(self.net, s, torch.rot90(self.mask, r, (2, 3))) for r, s in enumerate(self.shared)]
        self.pooled: list[list[Pooled]] = [[] for _ in self.turns]  # of each turn's parts

    def add(self, images: Float[Tensor, "1 k c h w"], L: Float[Tensor, "k 3 *hw"]) -> None:
        """Look at k images of the box under the lights `L`."""
        images = scaled(self.net.scaling, images[..., *self.seen], self.mask, self.moments, self.n)
        for r in self.turns:
            seen, lights, pooled = torch.rot90(images, r, (3, 4)), self.lights(L, r), self.pooled[r]
            for i, (rows, shared) in enumerate(self.parts[r]):
                at = lights if lights.ndim == 3 else lights[..., rows, :]
                with inner_precision(L.device):
                    new = self.net.encode(seen[..., rows, :], at, shared)
                if i < len(pooled):
                    pooled[i].merged(new)
                else:
                    pooled.append(new)

    def lights(self, L: Float[Tensor, "k 3 *hw"], r: int) -> Float[Tensor, "1 k 3 *ij"]:
        """Lights as this tile sees them after `r` quarter turns."""
        seen = L[None] if L.ndim == 2 else torch.rot90(L[None][..., *self.seen], r, (3, 4))
        return turned(seen, r, 2)

    def finish(self) -> None:
        """Every image has been seen: decode them all, the mean over all turns."""
        total = torch.zeros(1)
        for r in self.turns:
            with inner_precision(self.mask.device):
                found = self.net.look(self.digested(r), self.n, self.shared[r]).float()
            total = total + torch.rot90(turned(found, -r, 1), -r, (2, 3)).cpu()
        total[:, :3] = torch.nn.functional.normalize(total[:, :3], dim=1)
        total[:, 3:] /= len(self.turns)
        self.found = total

    def digested(self, r: int) -> Any:
        """What the network digests of all images in a turn, part by part; what was pooled is then forgotten."""
        found = [self.net.digest(self.pooled[r].pop(0), self.n, shared) for _, shared in self.parts[r]]
        return found[0] if len(found) == 1 else torch.cat(found, dim=1)

    def sides(self) -> list[tuple[slice, slice]]:
        """Rows, then columns: the tile's own, and those that it sees."""
        return list(zip(self.core, self.seen, strict=True))

    def result(self) -> Float[Tensor, "d i j"]:
        """Normals, and expected errors if any, without the margins."""
        y, x = (slice(c.start - s.start, c.stop - s.start) for c, s in self.sides())
        here = self.found[0, :, y, x]
        return torch.cat([here[:3], here[3 + self.net.memory :]])


def parts(net: Network, shared: Any, mask: Bool[Tensor, "1 1 h w"]) -> list[tuple[slice, Any]]:
    """Rows of a tile to take at a time, with what all images share of them; all rows, or few on a processor.

    What is small is soon reused; the result is the same.
    """
    h, w = mask.shape[2:]
    if mask.device.type != "cpu" or not net.pointwise:
        return [(slice(h), shared)]
    step = max(1, PART // w)
    return [(rows, shared.rows(rows)) for rows in (slice(y, y + step) for y in range(0, h, step))]


def turned(v: Tensor, quarters: int, axis: int) -> Tensor:
    """Vectors along `axis` turned about the view axis, counter-clockwise by quarter turns; from z on all stays."""
    x, y, *rest = v.unbind(axis)
    for _ in range(quarters % 4):
        x, y = -y, x
    return torch.stack([x, y, *rest], axis)
