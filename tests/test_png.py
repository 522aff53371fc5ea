"""PNG written some rows at a time is read by OpenCV as the picture that it was."""

import io

import cv2
import numpy as np
import pytest

from photonormal.png import SRGB, PngRows, remarks, text, texts


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(40, 31, 3), (40, 31), (1, 1), (5, 1, 3)])
def test_rows_make_the_picture(dtype, shape):
    picture = np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)
    file = io.BytesIO()
    written = PngRows(file, shape[:2], dtype, len(shape) == 3, SRGB | text("key", "value"))
    for y in range(0, shape[0], 7):
        written.write(picture[y : y + 7])
    written.close()
    found = cv2.imdecode(np.frombuffer(file.getvalue(), np.uint8), -1)
    assert found.dtype == dtype and np.array_equal(found[..., ::-1] if found.ndim == 3 else found, picture)
    assert texts(file) == {"key": "value"} and (b"sRGB", b"\0") in list(remarks(file))
