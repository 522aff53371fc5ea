"""A result under other lights, as pictures and films."""

import shutil

import cv2
import numpy as np
import pytest

from photonormal.cli import main
from photonormal.export import load_normals
from photonormal.handover.relit import STEPS
from photonormal.masked import box_of
from photonormal.relighting import FORMATS, films
from photonormal.relighting.pictures import direction, relit_by_fit
from photonormal.srgb import from_linear, to_linear
from photonormal.types import InputError
from tests.relighting.test_files import dome, glossy
from tests.scenes import ring, write_diligent


def picture(path):
    return cv2.imread(str(path))[..., ::-1] / 255


def test_azimuth_goes_from_right_to_up_and_elevation_to_the_camera():
    assert np.allclose([direction(0, 0), direction(90, 0), direction(33, 90)], np.eye(3), atol=1e-12)


def test_a_light_that_was_left_out_is_shown_as_the_photograph_is(measured, tmp_path):
    azimuth, elevation = 40, 55
    out = tmp_path / "a.png"
    assert main(["export", str(measured / "r"), "--relit", f"{azimuth},{elevation}", "--out", str(out)]) == 0
    capture = glossy(np.stack([direction(azimuth, elevation), *np.eye(3)[1:]]))
    box = box_of(capture.mask)
    shown, truth, mask = picture(out), capture.images[0][box], capture.mask[box]
    assert shown.shape == truth.shape and not shown[~mask].any()
    gain = (to_linear(shown[mask]) * truth[mask]).sum() / (truth[mask] ** 2).sum()  # white is not 1
    assert np.sqrt(((shown[mask] - from_linear((gain * truth[mask]).clip(0, 1))) ** 2).mean()) < 0.06


def test_a_picture_may_be_a_jpeg(measured, tmp_path):
    for name in ("a.png", "a.JPG"):
        assert main(["export", str(measured / "r"), "--relit", "40,55", "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.JPG").read_bytes()[:3] == b"\xff\xd8\xff"
    assert np.abs(picture(tmp_path / "a.JPG") - picture(tmp_path / "a.png")).mean() < 0.01


def test_a_light_far_from_those_of_the_photographs_is_said_to_be_a_guess(measured, tmp_path, caplog):
    words = ["export", str(measured / "r"), "--out", str(tmp_path / "a.png"), "--overwrite", "--relit"]
    assert main([*words, "40,30"]) == 0 and not caplog.messages
    assert main([*words, "40,2", "--by", "matt"]) == 0 and not caplog.messages
    assert main([*words, "40,2", "--by", "hsh16"]) == 0 and "elevations of 18 to 81" in caplog.messages[-1]


def test_matt_is_albedo_times_the_cosine(measured, tmp_path):
    out = tmp_path / "a.png"
    assert main(["export", str(measured / "r"), "--relit", "0,90", "--by", "matt", "--out", str(out)]) == 0
    normals = load_normals(measured / "r" / "normals.npz")
    box = box_of(normals.mask)
    albedo = to_linear(cv2.imread(str(measured / "r" / "albedo.png"), -1)[..., ::-1] / 65535)[box]
    wanted = from_linear(albedo * normals.map[box][..., 2:].clip(0, 1))
    assert np.abs(picture(out) - wanted).max() < 1 / 255


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_a_light_goes_around_in_a_film(ending, measured, tmp_path):
    out = tmp_path / f"a.{ending}"
    assert main(["export", str(measured / "r"), "--sweep", "--out", str(out)]) == 0
    if ending == "gif":
        frames = cv2.imreadanimation(str(out))[1].frames
    else:
        film, frames = cv2.VideoCapture(str(out)), []
        while (read := film.read())[0]:
            frames.append(read[1])
    assert len(frames) == STEPS
    with relit_by_fit(glossy(dome(40)), FORMATS["hsh"].basis) as relit:
        small = relit.reduced(960, multiple=2)
        for step in (0, 30):
            wanted = small(direction(360 * step / STEPS, 45)).astype(float)
            off = cv2.blur(frames[step][..., 2::-1] - wanted, (5, 5))  # GIF has 256 colours, and strews them
            assert np.abs(off).mean() < 4


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_a_film_that_the_disk_cuts_short_is_refused(ending):
    resource = pytest.importorskip("resource")
    frames = [np.full((64, 64, 3), 3 * step, np.uint8) + np.arange(64, dtype=np.uint8)[:, None] for step in range(60)]
    most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, most[1]))
    try:
        with pytest.raises(InputError, match="has no room for a film"):
            films.encoded(frames, f".{ending}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, most)


def test_what_can_not_be_shown_is_refused(measured, tmp_path, refused):
    out = tmp_path / "a.png"
    for angles in ("45", "a,b", "10,0", "10,95", "nan,10", "10,inf"):
        refused("--relit", angles, "--out", out, says="azimuth,elevation")
    refused("--relit", "10,20", "--out", tmp_path / "a.gif", says=".png")
    refused("--sweep", "--out", out, says=".mp4 or .gif")
    refused("--sweep", says="--out")
    few = tmp_path / "few"
    write_diligent(few, glossy(ring(4)))
    assert main(["measure", str(few), "--out", str(tmp_path / "of few"), "--method", "woodham"]) == 0
    refused(
        "--relit", "10,20", "--out", out, result=tmp_path / "of few", says="needs at least 9; add photographs, or cho"
    )
    refused("--sweep", "--to", "ptm", "--out", out, says="one of them")
    shutil.copytree(measured / "r", tmp_path / "r")
    report = tmp_path / "r" / "report.json"
    report.write_text(report.read_text().replace(str(measured / "ball"), str(measured / "gone")))
    refused("--relit", "10,20", "--out", out, result=tmp_path / "r", says=f"{measured / 'gone'}")
    (tmp_path / "r" / "albedo.png").unlink()
    refused("--relit", "10,20", "--by", "matt", "--out", out, result=tmp_path / "r", says="albedo.png")
