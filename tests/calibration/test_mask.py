"""A mask from the shading."""

from dataclasses import replace

import numpy as np
import pytest

import photonormal as pn
from photonormal.calibration.mask import mask_from_shading
from photonormal.capture.images import ImageFiles, read_mask
from photonormal.capture.pictures import evenly, find_pictures
from photonormal.cli import main
from photonormal.types import InputError
from tests.calibration.chrome import dome
from tests.scenes import lambertian, sphere, write_diligent


def overlap(a, b) -> float:
    return float((a & b).sum() / (a | b).sum())


def on_ground(level: float, wall: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Pictures of a sphere on a ground of that brightness, with a wall behind its upper half."""
    capture = lambertian(sphere(96), dome(8, 50.0))
    rng = np.random.default_rng(0)
    ground = np.where(np.arange(96)[:, None] < 40, wall or level, level)
    images = np.where(capture.mask, np.asarray(capture.images)[..., 0], ground)
    return (images + 0.004 * rng.standard_normal(images.shape)).clip(0).astype(np.float32), capture.mask


@pytest.mark.parametrize(("level", "wall"), [(0.0, 0.0), (0.06, 0.0), (0.01, 0.15)])
def test_a_sphere_is_cut_out_of_its_ground(level, wall):
    pictures, truth = on_ground(level, wall)
    assert overlap(mask_from_shading(pictures), truth) > 0.93


def test_dark_spots_of_the_object_belong_to_it():
    pictures, _ = on_ground(0.0)
    pictures[:, 45:50, 45:50] = 0
    assert mask_from_shading(pictures)[45:50, 45:50].all()


def test_an_even_frame_holds_no_object():
    with pytest.raises(InputError, match="draw a mask"):
        mask_from_shading(np.full((4, 60, 60), 0.5, np.float32))


def test_the_command_writes_a_mask_that_the_capture_uses(tmp_path, capsys):
    right = lambertian(sphere(), dome(8, 50.0))
    write_diligent(tmp_path / "object", right)
    (tmp_path / "object" / "mask.png").unlink()
    assert main(["mask", str(tmp_path / "object"), "--out", str(tmp_path / "object" / "mask.png")]) == 0
    assert overlap(pn.load(tmp_path / "object").mask, right.mask) > 0.93
    assert len(find_pictures(tmp_path / "object")) == 8  # the preview is no photograph
    assert main(["mask", str(tmp_path / "object"), "--out", str(tmp_path / "object" / "mask.png")]) == 2


def test_sixteen_photographs_are_enough(tmp_path):
    """The others are not even decoded: here all but those are cut short."""
    capture = lambertian(sphere(48), dome(23, 50.0))
    write_diligent(tmp_path, capture)
    (tmp_path / "mask.png").unlink()
    pictures = find_pictures(tmp_path)
    for picture in set(pictures) - set(evenly(pictures, 16)):
        picture.write_bytes(picture.read_bytes()[:200])
    assert main(["mask", str(tmp_path), "--out", str(tmp_path / "mask.png")]) == 0
    assert overlap(read_mask(tmp_path / "mask.png"), capture.mask) > 0.9


def test_a_second_thing_in_the_frame_is_left_out_and_named(tmp_path, capsys):
    right = lambertian(sphere(), dome(8, 50.0))
    small = np.asarray(right.images)[:, ::2, ::2]
    side = right.mask.shape[0]
    images = np.zeros((8, side, 2 * side, 1), np.float32)
    images[:, :, :side], images[:, : small.shape[1], -small.shape[2] :] = (
        np.asarray(right.images)[..., :1],
        small[..., :1],
    )
    write_diligent(tmp_path / "two", replace(right, images=images, mask=np.ones((side, 2 * side), bool), truth=None))
    assert main(["mask", str(tmp_path / "two"), "--out", str(tmp_path / "two.png")]) == 0
    said = capsys.readouterr().out
    x, y = 2 * side - small.shape[2] / 2, small.shape[1] / 2
    assert f"another stands out around {x - 0.5:.0f},{y - 0.5:.0f}" in said
    assert overlap(read_mask(tmp_path / "two.png")[:, :side], right.mask) > 0.93


@pytest.mark.data
@pytest.mark.parametrize(("name", "least"), [("uw/owl", 0.96), ("uw/horse", 0.93)])
def test_real_objects(data, name, least):
    folder = data / "captures" / name
    paths = find_pictures(folder)
    images = ImageFiles(paths, None, np.ones((len(paths), 1)))
    found = mask_from_shading(np.stack([images[j].mean(-1) for j in range(len(paths))]))
    assert overlap(found, read_mask(next(folder.glob("*.mask.png")))) > least


def test_a_mask_is_the_same_each_time():
    pictures, _ = on_ground(0.06, 0.15)
    first = mask_from_shading(pictures)
    assert all(np.array_equal(first, mask_from_shading(pictures)) for _ in range(2))
