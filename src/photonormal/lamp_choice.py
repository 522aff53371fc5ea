"""Which lamps of a rig are worth keeping: lights of a file -> the few under which a network errs least.

The network is `lmps`, which measures under any lamps; it is asked on objects that are rendered under all of the rig's.
The paper (Li et al., CVPR 2019) learns the choice in the network of one rig; this asks one network about any rig.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.capture.lights import read_lights
from photonormal.disk import refuse_taken, write
from photonormal.export.lights import lp
from photonormal.geometry import far_apart
from photonormal.methods.inputs.scaling import moment, scaled
from photonormal.methods.learned.lmps import LMPS
from photonormal.methods.learned.network import Network
from photonormal.methods.learned.processor import inner_precision
from photonormal.progress import progress
from photonormal.shading import angle_deg
from photonormal.synth import Stream
from photonormal.types import InputError, lights_behind, unit_lights

ASKED, CHECKED = 0, 1  # batches of rendered windows
WINDOWS = {"crop": 8, "crops": 16, "scenes": 32}
PIXELS = 256  # of each
ROUNDS = 2  # in which each lamp of the choice may be exchanged, at most
DRAWS = 10  # choices by chance that it is compared with


@dataclass(frozen=True)
class ChosenLamps:
    """What `choose` found.

    Parameters
    ----------
    lamps : numbers of the chosen lamps from 0, ascending
    error_deg : mean angular error under them on rendered objects that the choice was not made on
    all_deg : the same under all lamps
    chance_deg : the same under as many lamps drawn by chance, a mean over draws
    """

    lamps: tuple[int, ...]
    error_deg: float
    all_deg: float
    chance_deg: float


def choose_from(path: Path, count: int, out: Path | None = None, overwrite: bool = False) -> ChosenLamps:
    """The choice from a file of lights; `out`: an .lp file to write them into."""
    if out is not None:
        refuse_taken([out], overwrite, reads=[path])
    listed = read_lights(path)
    names = listed.names or [str(j + 1) for j in range(len(listed.vectors))]
    L = unit_lights(listed.vectors, [f"lamp {name}" for name in names])
    if len(behind := lights_behind(L)):
        raise InputError(
            f"{len(behind)} of the {len(L)} lights in {path} lie behind the object (z below 0) but "
            "lamps in front of it are needed; change the sign of z, or leave them out."
        )
    found = choose(L, count)
    if out is not None:
        write(out, lp([names[j] for j in found.lamps], L[list(found.lamps)]))
    return found


def choose(lights: Float[np.ndarray, "n 3"], count: int, net: Network | None = None) -> ChosenLamps:
    """`count` of a rig's lamps under which `net`, the package's lmps by default, errs least on rendered objects.

    It starts from lamps that are spread evenly and exchanges one after the other for the best of all others, until no
    exchange helps.

    Raises
    ------
    InputError
        If fewer than 3, or not fewer than there are, are to be chosen.
    """
    n = len(lights)
    if not 3 <= count < n:
        raise InputError(f"--count {count} came but from 3 to {n - 1} of these {n} lamps can be chosen; change it.")
    net = net or LMPS(turns=1).network()
    shown, checked = (RigPixels.of(lights, which) for which in (ASKED, CHECKED))
    with torch.inference_mode(), progress("choosing", ROUNDS * count) as advance:
        lamps = exchanged(far_apart(lights, count), n, lambda some: shown.error_deg(net, some), advance)
        draws = [np.random.default_rng(k).permutation(n)[:count] for k in range(DRAWS)]
        chance = float(np.mean([checked.error_deg(net, draw.tolist()) for draw in draws]))
        kept = checked.error_deg(net, lamps)
        return ChosenLamps(tuple(sorted(lamps)), kept, checked.error_deg(net, list(range(n))), chance)


def exchanged(
    lamps: list[int], n: int, error_deg: Callable[[list[int]], float], advance: Callable[[], None]
) -> list[int]:
    """Lamps of which none can be exchanged for a better one of the `n`, or that ROUNDS exchanges have led to."""
    lamps, least = list(lamps), error_deg(lamps)
    for _ in range(ROUNDS):
        before = list(lamps)
        for k in range(len(lamps)):
            others = [j for j in range(n) if j not in lamps]
            errors = [error_deg([*lamps[:k], j, *lamps[k + 1 :]]) for j in others]
            if min(errors) < least:
                least, lamps[k] = min(errors), others[int(np.argmin(errors))]
            advance()
        if lamps == before:
            break
    return lamps


@dataclass(frozen=True)
class RigPixels:
    """Pixels of rendered objects under all lamps of a rig."""

    images: Float[Tensor, "1 n 3 1 q"]
    lights: Float[Tensor, "1 n 3"]
    normals: Float[Tensor, "q 3"]

    @staticmethod
    def of(lights: Float[np.ndarray, "n 3"], batch: int) -> RigPixels:
        """Pixels by chance, of materials that no training has seen."""
        rig = tuple((x, y, z) for x, y, z in lights.tolist())
        windows = WINDOWS["scenes"] * WINDOWS["crops"]
        stream = Stream("validation", windows, "cpu", seed=0, start_step=batch, directions=rig, **WINDOWS)
        seen = next(islice(stream, 1))
        inside = seen.mask.flatten().nonzero()[:, 0]
        some = inside[torch.randperm(len(inside), generator=torch.Generator().manual_seed(0))[:PIXELS]]
        images = seen.images.permute(1, 2, 0, 3, 4).flatten(2)[None, :, :, None, some]
        return RigPixels(images, seen.lights[:1], seen.normals.permute(0, 2, 3, 1).flatten(0, 2)[some])

    def error_deg(self, net: Network, lamps: list[int]) -> float:
        """Mean angular error under some of the lamps."""
        images = self.images[:, lamps]
        mask = torch.ones(1, 1, 1, images.shape[-1], dtype=torch.bool)
        x = scaled(net.scaling, images, mask, moment(net.scaling, images, mask), len(lamps))
        with inner_precision(x.device):
            N = net(x, self.lights[:, lamps], torch.zeros(1, 3, *mask.shape[2:]))
        return float(angle_deg(N[0, :, 0].T, self.normals).mean())
