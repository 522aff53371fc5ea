"""Lens calibrations as OpenCV writes them: YAML, XML or JSON; or the same names in an .npz file.

    camera_matrix               3 x 3, pixels; also called cameraMatrix, K or mtx
    distortion_coefficients     4, 5, 8, 12 or 14 numbers; also called distCoeffs, D or dist

A matrix is `rows` and `cols`, or `sizes`, and `data`; or plain lists. What else the file holds is not looked at.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from photonormal.files.opening import read_bytes, read_npz, reason_of
from photonormal.types import InputError

NAMES = (("camera_matrix", "cameraMatrix", "K", "mtx"), ("distortion_coefficients", "distCoeffs", "D", "dist"))
LARGEST = 2**19  # bytes of a calibration, with the points that it was made from
COUNTS = (4, 5, 8, 12, 14)  # distortion coefficients that OpenCV knows


@dataclass(frozen=True)
class Lens:
    """Camera matrix (3, 3) in pixels and OpenCV's distortion coefficients."""

    K: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, " k"]

    def undistorted(self, picture: np.ndarray, nearest: bool = False) -> np.ndarray:
        """The picture as a camera with the same matrix and no distortion would have taken it."""
        import cv2

        h, w = picture.shape[:2]
        x, y = cv2.initUndistortRectifyMap(self.K, self.distortion, np.eye(3), self.K, (w, h), cv2.CV_32FC1)
        how = cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR
        return cv2.remap(picture, x, y, how, borderMode=cv2.BORDER_CONSTANT).reshape(picture.shape)


def read_lens(path: Path) -> Lens:
    """A calibration that OpenCV wrote (.yml, .yaml, .xml, .json), or an .npz with the same names.

    Raises
    ------
    InputError
        If the file can't be read, or holds no finite camera matrix (3, 3) and distortion coefficients.
    """
    if path.suffix.lower() == ".npz":
        wanted = tuple(name for names in NAMES for name in names)
        values: dict[str, Any] = read_npz(path, "save it again", wanted, LARGEST)
    else:
        values = _parsed(path)
    found = [next((values[n] for n in names if values.get(n) is not None), None) for names in NAMES]
    K, distortion = (None if value is None else _matrix(value) for value in found)
    if K is None or distortion is None or K.shape != (3, 3) or distortion.size not in COUNTS:
        raise InputError(
            f"{path} has no camera_matrix (3, 3) and distortion_coefficients of 4, 5, 8, 12 or 14 numbers; write them "
            "with OpenCV's calibration."
        )
    if not (K[0, 0] > 0 and K[1, 1] > 0):
        raise InputError(f"{path} has focal lengths {K[0, 0]:g} and {K[1, 1]:g} but both must be above 0; correct it.")
    return Lens(K, distortion.ravel())


def _parsed(path: Path) -> dict[str, Any]:
    """The names and values that a text file holds at its top, by what it begins with."""
    from photonormal.stored import decoded

    data = read_bytes(path, "a lens calibration", LARGEST).removeprefix(b"\xef\xbb\xbf").lstrip()
    if data.startswith(b"{"):
        values = decoded(data, dict, path, "give OpenCV's .yml file")
    else:
        try:
            values = _xml(data) if data.startswith(b"<") else _yaml(data)
        except RecursionError:
            values = None
        except Exception as error:  # parsers raise anything on damaged text
            raise InputError(
                f"{path} can't be read as a lens calibration ({reason_of(error)}); give OpenCV's .yml file."
            ) from None
    if not isinstance(values, dict):
        raise InputError(f"{path} can't be read as a lens calibration; give OpenCV's .yml file.")
    return values


def _yaml(data: bytes) -> Any:
    """OpenCV's YAML: its first line, and the tags of its matrices, are none of YAML's own. All scalars stay text."""
    import yaml

    text = data.decode("utf-8", "replace")
    if text.startswith("%YAML"):
        text = text.partition("\n")[2]
    return yaml.load(text, Loader=yaml.BaseLoader)  # builds dicts, lists and text only


def _xml(data: bytes) -> dict[str, Any]:
    from xml.etree import ElementTree

    text = data.decode("utf-8")
    if "<!" in text:  # OpenCV declares no entities
        raise ValueError("it has declarations, which a calibration doesn't need")
    return {
        child.tag: {part.tag: part.text or "" for part in child} if len(child) else child.text
        for child in ElementTree.fromstring(text)
    }


def _matrix(value: Any) -> np.ndarray | None:
    """The finite float64 numbers of a matrix; None where it is none."""
    try:
        if isinstance(value, dict):
            data = value["data"]
            sizes = value["sizes"] if "sizes" in value else [value["rows"], value["cols"]]
            shape = [int(n) for n in (sizes.split() if isinstance(sizes, str) else sizes)]
            numbers = np.array(data.split() if isinstance(data, str) else data, np.float64)
            if not 1 <= len(shape) <= 2 or min(shape) < 1 or numbers.shape != (prod(shape),):
                return None
            matrix = numbers.reshape(shape)
        else:
            matrix = np.array(value, np.float64)
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    return matrix if np.isfinite(matrix).all() else None
