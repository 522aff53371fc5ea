"""From the photographs of an object to its lights on disk, without a sphere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import photonormal
from photonormal.capture import UNKNOWN, files_read, load
from photonormal.disk import at_once, refuse_taken
from photonormal.export import lights as text
from photonormal.export.folder import as_json
from photonormal.geometry import in_frame
from photonormal.types import InputError


def calibrate_from_object(
    folder: str | Path, out: str | Path = "lights.lp", frame: str = "opengl", overwrite: bool = False, **how: Any
) -> dict[str, Any]:
    """Directions and intensities of all lights from the photographs of an object alone; returns the report, as written.

    Parameters
    ----------
    folder : photographs and mask, as for `photonormal.load`, which `how` is passed on to; lights in it aren't read
    out : `.lp` file; `light_intensities.txt`, `light_directions.txt` and a JSON report are written beside it
    frame : of the directions, a key of photonormal.geometry.FRAMES

    Raises
    ------
    InputError
        If the photographs show no lights, or a file is there already.
    """
    from photonormal.methods.uncalibrated import found_lights

    out = Path(out)
    if out.suffix.lower() != ".lp":
        raise InputError(f"--out {out} ends in {out.suffix!r} but an .lp file is written; choose a name that ends so.")
    beside = [out.with_name(name) for name in ("light_intensities.txt", "light_directions.txt")]
    files = [out, *beside, out.with_suffix(".json")]
    refuse_taken(files, overwrite)
    capture = load(folder, lights=UNKNOWN, **how)
    refuse_taken(files, overwrite, files_read(folder, capture))
    found = found_lights(capture, "unknown")
    assert found.intensities is not None
    directions = in_frame(found.lights, frame)
    content = {
        "photonormal": photonormal.__version__,
        "folder": Path(folder).resolve().name,
        "frame": frame,
        "axes": "from the object to the light; opengl: x right, y up, z to the camera",
        "lights": [
            {"picture": name, "direction": l, "intensity": round(float(e), 6)}
            for name, l, e in zip(capture.image_names, directions, found.intensities, strict=True)
        ],
        "warnings": list(found.notes),
    }
    with at_once(out.parent) as batch:
        batch.write(beside[0].name, text.table(found.intensities[:, None]))
        batch.write(beside[1].name, text.table(directions))
        batch.write(files[-1].name, as_json(content))
        batch.write(out.name, text.lp(capture.image_names, directions))
    return content | {"files": [str(p) for p in files]}
