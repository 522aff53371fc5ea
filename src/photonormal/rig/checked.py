"""What is wrong with a rig's photographs, and lights that fit better, on disk."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import photonormal
from photonormal.capture import files_read, load
from photonormal.geometry import normalised
from photonormal.options import LightsFrom

if TYPE_CHECKING:
    from photonormal.doctor.finding import Finding


def check_files(
    capture: str | Path,
    out: str | Path | None = None,
    overwrite: bool = False,
    lights_from: LightsFrom = "given",
    **how: Any,
) -> tuple[list[Finding], list[Path]]:
    """What is wrong with a capture, grave findings first, and the files written.

    Parameters
    ----------
    capture : folder or `.lp` file, as for `photonormal.load`, which `how` is passed on to
    out : folder for report.json, a polar plot of the lights, and corrected lights where other ones fit; None: no files
    lights_from : "given", or those that are checked are found from the photographs first, as `pn.measure` does it
    """
    from photonormal.doctor.coverage import polar_plot
    from photonormal.examination import check
    from photonormal.export import lights as text
    from photonormal.export.folder import report, whole_folder
    from photonormal.png import encode_png

    photographs, lights_found = load(capture, **how), None
    if lights_from != "given":
        from photonormal.methods.uncalibrated import found_lights

        lights_found = found_lights(photographs, lights_from)
        photographs = lights_found.shown_by(photographs)
    found = check(photographs, lights_found)
    if out is None:
        return found, []
    with whole_folder(Path(out), overwrite, files_read(capture, photographs, *how.values())) as folder:
        names, L = photographs.image_names, photographs.lights
        content = {
            "photonormal": photonormal.__version__,
            "capture": photographs.name,
            "images": list(names),
            "crop": None if photographs.crop is None else photographs.crop.as_dict(),
            "findings": [f.as_dict() for f in found],
        }
        if L is not None:
            folder.write("lights.png", encode_png(polar_plot(L)))
        fixed = next((f.lights for f in found if f.lights is not None), None)
        if fixed is not None:
            camera, crop = photographs.camera if photographs.lamps is not None else None, photographs.crop
            middle = 0 if camera is None else camera.flat_mm(photographs.mask).mean(0)  # lamps' are positions
            origin = 0 if camera is None or crop is None else crop.origin_mm(camera)
            folder.write("corrected.lp", text.lp(names, fixed + origin))  # of the whole photographs
            folder.write("corrected.png", encode_png(polar_plot(normalised(fixed - middle))))
        report(folder, content)
    return found, [Path(out) / name for name in sorted(folder.names)]
