"""One checkpoint file, whole or not there: what a training needs to go on as if it had never stopped."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import torch

from photonormal.disk import write
from photonormal.options import NotNegative, Precision, Whole
from photonormal.stored import converted
from photonormal.types import InputError

NAME = "checkpoint.pt"


class State(TypedDict):
    """A training between two steps."""

    step: Whole
    seconds: NotNegative
    recipe: dict[str, Any]
    network: dict[str, torch.Tensor]
    mean: dict[str, torch.Tensor]
    optimiser: dict[str, Any]
    precision: NotRequired[Precision]
    data: NotRequired[list[dict[str, Any]]]


def save(out: Path, state: dict[str, Any]) -> None:
    """Write the checkpoint of the folder `out`; a process killed meanwhile leaves the one before."""
    encoded = io.BytesIO()
    torch.save(state, encoded)
    write(out / NAME, encoded.getvalue())


def load(out: Path, recipe: dict[str, Any], data: Sequence[dict[str, Any]] = ()) -> State:
    """The checkpoint of `out`, on the processor; InputError if there is none, or of another recipe or other data."""
    path = out / NAME
    if not path.is_file():
        raise InputError(f"no checkpoint in {out} to resume from; start without --resume.")
    try:
        with zipfile.ZipFile(path) as archive:  # nothing in it is larger than the file
            if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
                raise ValueError("it is compressed")
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged file fails in many ways
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"checkpoint {path} can't be read ({reason}); start again.") from None
    state = converted(state, State, f"checkpoint {path}", "start again")
    if list(data) != state.get("data", []):
        came, needed = (
            ", ".join(str(s.get("name")) for s in sets) or "rendered scenes" for sets in (data, state.get("data", []))
        )
        raise InputError(
            f"checkpoint {path} learned from {needed} but {came} came, or what these hold has changed; "
            "resume with its own --data."
        )
    differs = sorted(k for k in recipe if _plain(recipe[k]) != _plain(state["recipe"].get(k)))
    if differs:
        raise InputError(f"checkpoint {path} has another {differs[0]} than this recipe; resume with its own recipe.")
    return state


def fits(out: Path, kept: dict[str, torch.Tensor], needed: dict[str, torch.Tensor]) -> None:
    """InputError where tensors of a checkpoint are not those of its training."""
    shapes = [{k: (v.shape, v.dtype, v.device.type) for k, v in tensors.items()} for tensors in (kept, needed)]
    if shapes[0] != shapes[1]:
        raise InputError(f"checkpoint in {out} does not fit the recipe's network; start again.")


def _plain(value: Any) -> Any:
    return [_plain(v) for v in value] if isinstance(value, tuple | list) else value
