"""Files with lights, as people and their programs write them -> names of pictures, and vectors.

A form of file is one module with `read(path) -> LightTable`, and one line in KINDS. Frame: x right, y up, z to the
camera, from the object to the light; vectors need not be unit. With a scale they are positions in mm (`lights.near`).
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

from photonormal.capture.lights.table import AS, Listed, vectors
from photonormal.types import InputError

TEXT = "photonormal.capture.lights.rows"  # `.lp`, `.csv`, `.txt` and whatever else
KINDS = {  # suffix -> module
    **dict.fromkeys((".npy", ".npz", ".mat"), "photonormal.capture.lights.arrays"),
    **dict.fromkeys((".dome", ".relight"), "photonormal.capture.lights.relight"),
    ".json": "photonormal.capture.lights.alicevision",
}
OWN = (  # of a folder of photographs, the first that is there
    *("*.lp", "light_directions.txt", "lights.csv", "*.dome", "*.relight"),
    *("lights.txt", "lights.npy", "lights.mat", "light_directions.csv", "light_directions.npy", "light_directions.mat"),
)


def read_lights(path: Path, lights_as: str = "") -> Listed:
    """The lights that a file lists.

    Parameters
    ----------
    lights_as : what its numbers are, one of AS; empty: directions, or what the file's header says
    """
    if lights_as and lights_as not in AS:
        raise InputError(f"--lights-as {lights_as[:40]!r} came but one of {', '.join(AS)} is needed; correct it.")
    table = import_module(KINDS.get(path.suffix.lower(), TEXT)).read(path)
    return vectors(table, lights_as, path)


def own_lights(folder: Path) -> Path | None:
    """The file of lights that lies beside the photographs in a folder, if any."""
    inside = sorted(p for p in folder.iterdir() if not p.is_dir() and not p.name.startswith("."))
    for name in OWN:
        if name.startswith("*"):
            found = [p for p in inside if p.suffix.lower() == name[1:]]
        else:
            found = [p for p in inside if p.name.lower() == name]
        if len(found) > 1:
            raise InputError(
                f"{folder} has {len(found)} {name[1:]} files ({', '.join(p.name for p in found)}) but one is needed; "
                "choose one with --lights."
            )
        if found:
            return found[0]
    return None
