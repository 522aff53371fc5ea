"""What a first look over the images gives: a prior, what scales the images, and which pixels some light reached."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.masked import row_bands
from photonormal.methods.contract import Prior
from photonormal.methods.engine import plan
from photonormal.methods.engine.frames import frames
from photonormal.methods.engine.maps import Maps
from photonormal.methods.engine.windows import Box
from photonormal.methods.inputs.grey import darkest, grey, telling
from photonormal.methods.inputs.scaling import moment
from photonormal.progress import progress
from photonormal.types import Capture, InputError

PART = 16  # a prior looks at this part of them together


@dataclass(frozen=True)
class FirstLook:
    """What every window of a box starts from."""

    prior: Maps  # three (h, w), zero outside the mask
    moments: Tensor  # (1, c, h, w) or (1, 1, 1, 1), see inputs.scaling.moment
    lit: Bool[Tensor, "h w"]  # some image is not black here


def prior_named(text: str) -> Prior | None:
    """The classical method that a network starts from, such as "l1" or "l1:steps=12"; None where `text` is empty.

    Raises
    ------
    InputError
        If there is no such method, or it is no prior.
    """
    if not text:
        return None
    from photonormal.methods import METHODS, configure, method_class, parse

    name, options = parse(text)
    method = configure(name, **options)
    if not isinstance(method, Prior):
        priors = [m for m, place in METHODS.items() if ".classical." in place and issubclass(method_class(m), Prior)]
        raise InputError(f"{name} can't be a prior, since it takes no batches; choose from {', '.join(priors)}.")
    return method


def first_look(
    scaling: str, capture: Capture, box: Box, device: torch.device, prior: Prior | None, rows: slice | None = None
) -> FirstLook:
    """One pass over the images, some rows at a time. The prior is found where it is asked for: in `rows` of the box."""
    n = capture.images.shape[0]
    h, w = box.mask.shape
    N = Maps(3, (h, w), device)
    lit = torch.zeros(h, w, dtype=torch.bool, device=device)
    moments = torch.zeros(1, 1, 1, 1, device=device)
    parts = _rows(box, plan.pixels(capture))
    together = max(1, plan.levels(capture) // PART // n)
    asked = rows or slice(0, h)
    some = torch.from_numpy(telling(box.mask.numpy(), n))
    dark = None if prior is None or len(parts) == 1 else float(darkest(_shown(capture, box, some)))
    with progress("a first look", len(parts) * n) as advance:
        for rows in parts:
            start = prior if rows.start < asked.stop and asked.start < rows.stop else None
            seen = rows, slice(0, w)
            mask = box.mask[seen].to(device)
            inside = mask.flatten().nonzero()[:, 0]
            I = torch.empty(len(inside), n if start else 0, device=device)
            found: Tensor | None = None
            for j, images in frames(capture, box, seen, device):
                level = grey(images)[0, 0, 0]
                lit[seen] |= level > 0
                here = moment(scaling, level[None, None, None] if scaling == "grey" else images, mask[None, None])
                found = here if found is None else found.add_(here)
                if start:
                    I[:, j] = level.flatten().index_select(0, inside)
                advance()
            assert found is not None
            if found.numel() == 1:
                moments += (found * (mask.sum() / box.mask.sum().to(device))).nan_to_num(0)
            else:
                moments = moments.new_empty(*found.shape[:2], h, w) if moments.numel() == 1 else moments
                moments[:, :, *seen] = found
            if start:
                dark = float(darkest(I[some[box.mask].to(device)])) if dark is None else dark
                N[seen] = _normals(start, I, box.lights(capture, seen).to(device), mask, dark, together)
    if not (lit & box.mask.to(device)).any():
        raise InputError(f"all pixels of {capture.name} inside the mask are dark; check exposure, mask and images.")
    return FirstLook(N, moments, lit)


def _shown(capture: Capture, box: Box, some: Bool[Tensor, "h w"]) -> Float[Tensor, "q n"]:
    """Grey levels of some pixels of the box."""
    spans, columns = row_bands(some.numpy()), slice(0, some.shape[1])

    def levels(j: int) -> Float[Tensor, " q"]:
        return torch.cat([grey(box.read(capture, j, (rows, columns)))[0, 0, 0][some[rows]] for rows in spans])

    return torch.stack(capture.each_image(levels), dim=1)


def _normals(
    prior: Prior,
    I: Float[Tensor, "p n"],
    L: Float[Tensor, "n 3 *hw"],
    mask: Bool[Tensor, "h w"],
    dark: float,
    step: int,
) -> Float[Tensor, "3 h w"]:
    """Those of some rows of the box, so many pixels at a time."""
    found = torch.zeros(3, *mask.shape, device=I.device)
    seen = L if L.ndim == 2 else L[:, :, mask].permute(2, 0, 1)  # (p, n, 3)
    parts = [
        prior.normals(I[a : a + step], L if L.ndim == 2 else seen[a : a + step], dark) for a in range(0, len(I), step)
    ]
    if parts:
        found[:, mask] = torch.cat(parts).T
    return found


def _rows(box: Box, pixels: int) -> list[slice]:
    """Rows of the box, so many pixels at a time."""
    h, w = box.mask.shape
    step = max(1, pixels // w)
    return [slice(y, min(y + step, h)) for y in range(0, h, step)]
