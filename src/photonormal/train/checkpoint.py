"""One checkpoint file, whole or not there: what a training needs to go on as if it had never stopped."""

from __future__ import annotations

import io
import pickletools
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import torch

from photonormal.disk import write
from photonormal.files.opening import reason_of
from photonormal.options import NotNegative, Precision, Whole
from photonormal.stored import converted
from photonormal.types import InputError

NAME = "checkpoint.pt"
MADE = {"collections OrderedDict", "torch._utils _rebuild_tensor_v2"}  # what a checkpoint is made of, and storages


class TrainingState(TypedDict):
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


def load(out: Path, recipe: dict[str, Any], data: Sequence[dict[str, Any]] = ()) -> TrainingState:
    """The checkpoint of `out`, on the processor; InputError if there is none, or of another recipe or other data."""
    path = out / NAME
    if not path.is_file():
        raise InputError(f"no checkpoint in {out} to resume from; start without --resume.")
    try:
        with zipfile.ZipFile(path) as archive:  # nothing in it is larger than the file
            if any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
                raise ValueError("it is compressed")
            _check_makers(next(archive.read(name) for name in archive.namelist() if name.endswith("data.pkl")))
        state = torch.load(path, map_location="cpu", weights_only=True)
        if any(t.numel() * t.itemsize > t.untyped_storage().nbytes() for t in _tensors(state, set())):
            raise ValueError("a tensor claims more numbers than there are")
    except Exception as error:  # a damaged file fails in many ways
        raise InputError(f"checkpoint {path} can't be read ({reason_of(error)}); start again.") from None
    state = converted(state, TrainingState, f"checkpoint {path}", "start again")
    if list(data) != state.get("data", []):
        came, needed = (
            ", ".join(str(s.get("name")) for s in sets) or "rendered scenes" for sets in (data, state.get("data", []))
        )
        raise InputError(
            f"checkpoint {path} learned from {needed} but {came} came, or what these hold has changed; "
            "resume with its own --data."
        )
    differs = sorted(k for k in recipe if not _same(recipe[k], state["recipe"].get(k)))
    if differs:
        raise InputError(f"checkpoint {path} has another {differs[0]} than this recipe; resume with its own recipe.")
    return state


def fits(out: Path, kept: dict[str, torch.Tensor], needed: dict[str, torch.Tensor]) -> None:
    """InputError where tensors of a checkpoint are not those of its training."""
    shapes = [{k: (v.shape, v.dtype, v.device.type) for k, v in tensors.items()} for tensors in (kept, needed)]
    if shapes[0] != shapes[1]:
        raise InputError(f"checkpoint in {out} does not fit the recipe's network; start again.")


def _check_makers(pickled: bytes) -> None:
    """ValueError where a file asks for more than tensors, which torch would make of any size."""
    for operation, argument, _ in pickletools.genops(pickled):
        if operation.name in ("GLOBAL", "STACK_GLOBAL", "INST"):
            asked = str(argument)
            if asked not in MADE and not (asked.startswith("torch ") and asked.endswith("Storage")):
                raise ValueError(f"it asks for {asked}")


def _tensors(value: Any, seen: set[int]) -> Iterator[torch.Tensor]:
    """All tensors in nested lists and dictionaries, which may hold each other."""
    if isinstance(value, torch.Tensor):
        yield value
    elif isinstance(value, dict | list | tuple) and id(value) not in seen:
        seen.add(id(value))
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _tensors(inner, seen)


def _same(needed: Any, kept: Any) -> bool:
    """Whether a value of a recipe is kept; a list may stand for a tuple. Looks no deeper than the recipe goes."""
    if isinstance(needed, dict):
        return (
            isinstance(kept, dict) and needed.keys() == kept.keys() and all(_same(needed[k], kept[k]) for k in needed)
        )
    if isinstance(needed, tuple | list):
        return isinstance(kept, tuple | list) and len(needed) == len(kept) and all(map(_same, needed, kept))
    return isinstance(kept, bool | int | float | str | None) and needed == kept
