"""LUCES objects, lit by LEDs around the camera (R. Mecca, F. Logothetis, I. Budvytis, R. Cipolla, BMVC 2021).

Bell/
    01.png .. 52.png    16-bit linear RGB
    led_params.txt      a line of names; `n rows columns f x0 y0 mean_distance`; then a line for each LED: position (3)
                        and axis (3) in mm, intensity (1 or 3), mu, and perhaps a 0. Camera axes: y down, z forward
    mask.png
    normals.png         16-bit, green up; optional
    zgt.npz             depth; not read
    RAW/                the same with one channel; a folder of its own

f, x0, y0 are in pixels, mean_distance in mm from the camera.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from photonormal.capture.assemble import Choice, assemble, coded_normals
from photonormal.capture.texts import number, positive, read_lines
from photonormal.geometry import from_frame
from photonormal.types import Camera, Capture, InputError, Lamps

PARAMETERS = "led_params.txt"


def matches(path: Path) -> bool:
    """True for a folder with LED parameters."""
    return (path / PARAMETERS).is_file()


def read(path: Path, choice: Choice) -> Capture:
    """One object, with its lamps and its perspective camera."""
    lamps, intensities, camera = read_parameters(path / PARAMETERS)
    normals = path / "normals.png"
    return assemble(
        name=path.resolve().name,
        pictures=[path / f"{j + 1:02d}.png" for j in range(len(intensities))],
        lights=None,
        lamps=lamps,
        camera=camera,
        intensities=intensities / intensities.mean(),
        mask=path / "mask.png" if os.path.lexists(path / "mask.png") else None,
        truth=(lambda frame: coded_normals(normals, frame)) if os.path.lexists(normals) else None,
        choice=choice,
    )


def read_parameters(path: Path) -> tuple[Lamps, np.ndarray, Camera]:
    """Lamps in our frame, their intensities (n, 1 or 3), and the camera."""
    lines = read_lines(path)[1:]
    try:
        n, _, _, f, x0, y0, distance_mm = map(number, lines[0].split())
        rows = [[number(t) for t in line.split()] for line in lines[1:]]
    except (ValueError, IndexError):
        raise InputError(
            f"{path} does not hold n, rows, columns, f, x0, y0, mean_distance in its second line, and numbers below; "
            "restore it."
        ) from None
    widths = {len(row) for row in rows}
    if len(rows) != n or len(widths) != 1 or not widths <= {8, 9, 10, 11}:
        raise InputError(
            f"{path} says {n:g} LEDs but has {len(rows)} lines of {sorted(widths)} numbers; position, axis, intensity "
            "(1 or 3) and mu are needed for each; restore it."
        )
    if not (f > 0 and distance_mm > 0):
        raise InputError(f"{path} has f {f:g} and mean_distance {distance_mm:g} but both must be above 0; restore it.")
    table = np.array(rows)
    channels = 1 if table.shape[1] < 10 else 3
    S, axes = from_frame(table[:, :3], "y-down"), from_frame(table[:, 3:6], "y-down")
    lamps = Lamps(S, axes, table[:, 6 + channels])
    K = np.array([[f, 0, x0], [0, f, y0], [0, 0, 1]])
    return lamps, positive(table[:, 6 : 6 + channels], path), Camera(distance_mm / f, K)
