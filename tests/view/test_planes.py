"""Tiles: what they hold is what was stored, at every size."""

import zlib

import cv2
import numpy as np
import pytest

from photonormal.view.planes import (
    SIDE,
    UNIT,
    UNKNOWN,
    degrees_plane,
    exact,
    height_plane,
    normals_plane,
    plane,
)


def inflated(data, shape, kind):
    """The other way round from `exact`, as the page does it."""
    h, w, c = shape
    item = np.dtype(kind).itemsize
    parts = np.frombuffer(zlib.decompress(data), np.uint8).reshape(item, c, h, w).transpose(2, 3, 1, 0)
    change = np.ascontiguousarray(parts).view(np.dtype(kind).newbyteorder("<"))[..., 0]
    return np.cumsum(change, axis=1, dtype=kind)


@pytest.mark.parametrize(("kind", "channels"), [(np.int16, 3), (np.uint16, 1), (np.uint8, 1)])
def test_numbers_are_kept_exactly(kind, channels):
    info = np.iinfo(kind)
    part = np.random.default_rng(0).integers(info.min, info.max + 1, (9, 14, channels)).astype(kind)
    assert (inflated(exact(part), part.shape, kind) == part).all()


def test_tiles_have_a_rim_and_cover_the_whole():
    whole = np.arange(700 * 1100).reshape(700, 1100, 1).astype(np.uint16)
    p = plane("height", whole)
    assert [level.shape[:2] for level in p.levels] == [(700, 1100), (350, 550), (175, 275)]
    padded = np.pad(whole, ((1, 1), (1, 1), (0, 0)), mode="edge")
    for x, y, w, h in ((0, 0, 512, 512), (2, 0, 76, 512), (2, 1, 76, 188)):
        part = inflated(p.tile(0, x, y), (h + 2, w + 2, 1), np.uint16)
        assert (part == padded[y * SIDE : y * SIDE + h + 2, x * SIDE : x * SIDE + w + 2]).all()
    for level, x, y in ((0, 3, 0), (0, 0, 2), (3, 0, 0), (-1, 0, 0), (0, -1, 0)):
        with pytest.raises(IndexError):
            p.tile(level, x, y)


def test_normals_stay_unit_vectors_at_every_size():
    rng = np.random.default_rng(1)
    n = rng.normal((0, 0, 3), size=(1030, 40, 3))
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    n[:, :7] = 0
    for k, level in enumerate(normals_plane(n).levels):
        length = np.linalg.norm(level / UNIT, axis=-1)
        assert ((length == 0) | (np.abs(length - 1) < 5e-4)).all()
        assert (length[:, : 7 // 2**k] == 0).all() and (length[:, 8 // 2**k :] > 0).all()


def test_what_is_unknown_does_not_enter_a_mean():
    height = np.full((600, 600), 5.0)
    height[:, 300:] = np.nan
    p, low, step = height_plane(height)
    assert {int(v) for v in np.unique(p.levels[1])} == {0, 1} and low == 5 and step > 0
    angle = np.full((600, 600), 10.0)
    angle[::2, ::2] = np.nan
    angle[:, 300:] = np.nan
    assert {int(v) for v in np.unique(degrees_plane(angle).levels[1])} == {40, UNKNOWN}


def test_heights_are_within_a_step():
    height = np.random.default_rng(2).uniform(-30, 80, (50, 60))
    p, low, step = height_plane(height)
    assert np.abs(low + (p.levels[0][..., 0] - 1.0) * step - height).max() <= 0.51 * step < 1e-3


def test_colours_are_pictures_that_a_browser_reads():
    whole = np.full((40, 50, 3), (200, 100, 50), np.uint8)
    picture = cv2.imdecode(np.frombuffer(plane("colour", whole).tile(0, 0, 0), np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (42, 52, 3) and np.abs(picture[..., ::-1].astype(int) - (200, 100, 50)).max() <= 4
