"""Maps of materials: what is not told is a blend of what is told around it."""

import numpy as np

from photonormal.disk import at_once
from photonormal.export.materials import fill, write_materials
from photonormal.files.decode import decode
from photonormal.files.rows import Rows
from photonormal.types import Materials


def test_what_is_unknown_is_between_what_is_known_around_without_steps():
    y, x = np.mgrid[:300, :90]
    values = (60 + x + 0.3 * y).astype(np.uint8)
    known = np.random.default_rng(0).random(values.shape) < 0.01
    picture = np.where(known, values, 255).astype(np.uint8)
    fill(known, picture)
    assert np.array_equal(picture[known], values[known])
    assert picture.min() >= values[known].min() and picture.max() <= values[known].max()
    assert np.abs(picture.astype(int) - values)[5:-5, 5:-5].mean() < 4
    assert np.quantile(np.abs(np.diff(picture.astype(int), axis=1)), 0.99) < 6


def test_one_known_pixel_fills_all():
    known = np.zeros((37, 21), bool)
    known[30, 4] = True
    picture = np.full(known.shape, 200, np.uint8)
    picture[known] = 90
    fill(known, picture)
    assert (picture == 90).all()


def test_where_nothing_is_known_nothing_is_changed():
    picture = np.full((5, 6), 255, np.uint8)
    fill(np.zeros((5, 6), bool), picture)
    assert (picture == 255).all()


def on_disk(map):
    rows = Rows(map.shape, map.dtype)
    rows[:] = map
    return rows


def test_the_usual_specular_level_is_a_half_and_metalness_is_one_or_the_other(tmp_path):
    shape = (20, 30)
    roughness, metalness = np.full(shape, np.nan, np.float32), np.full(shape, np.nan, np.float32)
    roughness[:, 5:9], metalness[:, 5:9] = 0.4, 0
    roughness[:, 20:24], metalness[:, 20:24] = 0.3, 1
    F0 = np.zeros((*shape, 3), np.float32)
    F0[:, 5:9], F0[:, 20:24] = 0.5, 0.9  # 1 is no white here: the exposure is not known
    made_of = Materials(np.full((*shape, 3), 0.3, np.float32), F0, on_disk(roughness), metalness)
    with at_once(tmp_path) as folder:
        write_materials(made_of, np.ones(shape, bool), 1.0, folder)
    maps = {name: decode(tmp_path / f"{name}.png")[..., 0] for name in ("specular", "metalness", "roughness")}
    assert np.abs(maps["specular"][:, :9].astype(int) - 128).max() <= 1
    assert set(np.unique(maps["metalness"])) == {0, 255}
    assert (maps["metalness"][:, :12] == 0).all() and (maps["metalness"][:, 17:] == 255).all()
    assert (np.abs(np.diff(maps["roughness"].astype(int), axis=1)) < 8).all()
