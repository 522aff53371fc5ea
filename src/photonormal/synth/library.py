"""Measured materials, read from a folder that the user has: none is shipped."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from photonormal.synth.brdf import abc, sgd
from photonormal.synth.brdf.merl import Merl, read_merl
from photonormal.synth.brdf.neural import Neural
from photonormal.types import InputError

FAMILIES = ("principled", "sgd", "abc", "neural", "merl", "lambert")
ADVICE = "restore it"
HELD_OUT_EVERY = 7  # of the names in alphabetical order, from the fourth: never in the training split


@dataclass(frozen=True)
class Library:
    """Fitted (and, where files are there, raw) materials of one split; `k` of each family, sorted by name."""

    names: tuple[str, ...]
    sgd: Float[Tensor, "k 11 3"]
    abc: Float[Tensor, "k 9"]
    neural: tuple[Tensor, ...]  # w1, w2, w3, b1, b2, b3, each (k, ...)
    merl: tuple[Path, ...]
    sgd_gloss: Float[Tensor, "k 3"]  # albedo of the glossy part
    abc_gloss: Float[Tensor, "k 3"]
    neural_albedo: Float[Tensor, "k 3"]


def data_folder(folder: Path | str | None = None) -> Path | None:
    """Folder with merl_sgd.csv, merl_abc.csv and merl_nbrdf.npz: `folder`, or PHOTONORMAL_DATA/brdf; None: neither."""
    if folder is not None:
        if not (Path(folder) / "merl_sgd.csv").is_file():
            raise InputError(f"{folder} holds no merl_sgd.csv; give the folder with the fitted materials.")
        return Path(folder)
    root = os.environ.get("PHOTONORMAL_DATA")
    found = Path(root) / "brdf" if root else None
    return found if found and (found / "merl_sgd.csv").is_file() else None


@lru_cache(maxsize=8)
def library(folder: Path | None, split: str = "train") -> Library | None:
    """Materials of a split, "train", "validation" (its names are never trained on) or "all"; None without a folder."""
    if split not in ("train", "validation", "all"):
        raise InputError(f"no split {split!r} of the materials; use train, validation or all.")
    if folder is None:
        return None
    names, values = _table(folder / "merl_sgd.csv", 33)
    abc_names, abc_values = _table(folder / "merl_abc.csv", 9)
    neural = folder / "merl_nbrdf.npz"
    try:
        with np.load(neural) as z:
            neural_names = [str(name) for name in z["material"]]
            arrays = [z[key] for key in ("w1", "w2", "w3", "b1", "b2", "b3")]
    except (OSError, ValueError, KeyError, BadZipFile) as error:
        raise InputError(f"{neural} can't be read as a table of materials ({error}); {ADVICE}.") from None
    common = sorted(set(names) & set(abc_names) & set(neural_names))
    chosen = [
        name for i, name in enumerate(common) if split == "all" or (i % HELD_OUT_EVERY == 3) == (split != "train")
    ]
    s = torch.from_numpy(values[[names.index(name) for name in chosen]]).reshape(-1, 11, 3).contiguous()
    a = torch.from_numpy(abc_values[[abc_names.index(name) for name in chosen]]).contiguous()
    order = [neural_names.index(name) for name in chosen]
    w = tuple(torch.from_numpy(array[order].astype(np.float32)) for array in arrays)
    raw = tuple(p for p in sorted(folder.glob("*.binary")) if split == "all" or (p.stem in chosen))
    return Library(
        tuple(chosen), s, a, w, raw,
        albedo(sgd.SGD(s[..., None]).specular),
        albedo(abc.ABC(a[..., None]).specular),
        albedo(Neural(*w)),
    )  # fmt: skip


def named(folder: Path, family: str, name: str) -> Callable[..., Tensor]:
    """One measured material by its name, as a reflectance model."""
    every = library(folder, "all")
    assert every is not None
    if family == "merl":
        return Merl(read_merl(folder / f"{name}.binary")[None])
    if name not in every.names or family not in FAMILIES[1:4]:
        raise InputError(f"no {family} material {name!r}; there are {', '.join(every.names[:4])}, ...")
    i = every.names.index(name)
    if family == "sgd":
        return sgd.SGD(every.sgd[i : i + 1, None, :, :, None])
    if family == "abc":
        return abc.ABC(every.abc[i : i + 1, None, :, None])
    return Neural(*(w[i : i + 1] for w in every.neural))


def albedo(f: Callable[..., Tensor], cos_v: float = 0.8) -> Float[Tensor, "k 3"]:
    """Share of a white sky's light that a surface sends to a view at `cos_v`: the integral of f cos over directions."""
    theta = (torch.arange(40) + 0.5) / 40 * (math.pi / 2)
    phi = (torch.arange(40) + 0.5) / 40 * math.pi
    sin_v = math.sqrt(1 - cos_v**2)
    l = torch.stack(
        [
            torch.sin(theta)[:, None] * phi.cos(),
            torch.sin(theta)[:, None] * phi.sin(),
            theta.cos()[:, None].expand(-1, 40),
        ]
    ).flatten(1)  # (3, m)
    h = l + torch.tensor([[sin_v], [0.0], [cos_v]])
    h = h / h.norm(dim=0)
    cos_d = (l * h).sum(0)
    weight = l[2] * torch.sin(theta).repeat_interleave(40) * (math.pi / 2 / 40) * (2 * math.pi / 40)
    shape = (len(f.w1), 1, -1) if isinstance(f, Neural) else (1, -1)
    values = f(*(c.expand(shape) for c in (l[2], torch.full_like(l[2], cos_v), h[2], cos_d)))
    return (values.clamp(max=200) * weight).sum(-1).reshape(-1, 3).clamp(0, 1)


def _table(path: Path, width: int) -> tuple[list[str], np.ndarray]:
    """Names, and the first `width` numbers of each."""
    try:
        with path.open(newline="") as file:
            rows = [row for row in csv.reader(file) if row][1:]
        values = np.array([row[1 : 1 + width] for row in rows], np.float32)
    except (OSError, ValueError) as error:
        raise InputError(f"{path} can't be read as a table of materials ({error}); {ADVICE}.") from None
    if values.shape != (len(rows), width) or not rows:
        raise InputError(f"{path} has no or incomplete rows but {width} numbers a material are needed; {ADVICE}.")
    return [row[0] for row in rows], values
