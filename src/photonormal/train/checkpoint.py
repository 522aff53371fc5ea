"""One checkpoint file, whole or not there: what a training needs to go on as if it had never stopped."""

from __future__ import annotations

import os
import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from photonormal.types import InputError

NAME = "checkpoint.pt"


def save(out: Path, state: dict[str, Any]) -> None:
    """Write the checkpoint of the folder `out`; a process killed meanwhile leaves the one before."""
    partial = out / f"{NAME}.partial"
    with partial.open("wb") as file:
        torch.save(state, file)
        file.flush()
        os.fsync(file.fileno())
    partial.replace(out / NAME)


def load(out: Path, recipe: dict[str, Any], data: Sequence[dict[str, Any]] = ()) -> dict[str, Any]:
    """The checkpoint of `out`, on the processor; InputError if there is none, or of another recipe or other data."""
    path = out / NAME
    if not path.is_file():
        raise InputError(f"no checkpoint in {out} to resume from; start without --resume.")
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, EOFError, OSError, pickle.UnpicklingError) as error:
        raise InputError(f"checkpoint {path} can't be read ({str(error).splitlines()[0]}); start again.") from None
    if list(data) != state.get("data", []):
        came, needed = (
            ", ".join(s["name"] for s in sets) or "rendered scenes" for sets in (data, state.get("data", []))
        )
        raise InputError(
            f"checkpoint {path} learned from {needed} but {came} came, or what these hold has changed; "
            "resume with its own --data."
        )
    differs = sorted(k for k in recipe if _plain(recipe[k]) != _plain(state["recipe"].get(k)))
    if differs:
        raise InputError(f"checkpoint {path} has another {differs[0]} than this recipe; resume with its own recipe.")
    return {"precision": None} | state


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value
