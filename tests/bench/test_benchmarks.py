"""Which objects a root holds, in each benchmark's layout."""

import json

import cv2
import numpy as np
import pytest

from photonormal.bench import bench
from photonormal.bench.benchmarks import items
from photonormal.bench.tables import tables
from photonormal.capture import load
from photonormal.capture.augmentation import NOISE, augmented
from photonormal.types import InputError, Normals
from tests.scenes import lambertian, ring, sphere, write_diligent


def png(path, picture):
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imencode(path.suffix, picture)[1].tofile(path)


def pictures(capture, scale, dtype):
    return [np.repeat(np.rint(scale * capture.images[j]).astype(dtype), 3, -1) for j in range(len(capture.images))]


def encoded(truth: Normals, scale: int, dtype):
    return np.rint((truth.map + 1) / 2 * scale).astype(dtype)[..., ::-1]


@pytest.fixture(scope="module")
def capture():
    return lambertian(sphere(64), ring(63, 60))  # 64 lights


def test_diligent_keeps_the_benchmark_s_order_and_seeds(root):
    found = items("diligent", root)
    assert [(i.name, i.index) for i in found] == [("ball", 0), ("bear", 1), ("cat", 3)]
    assert items("diligent", root / "pmsData") == found


def test_captures_of_any_layout(tmp_path):
    kept, scene = tmp_path / "mine" / "vase", lambertian(sphere(24), ring(6, 60))
    write_diligent(kept, scene)
    (kept / "filenames.txt").unlink()
    (kept / "light_intensities.txt").unlink()
    (kept / "light_directions.txt").rename(kept / "lights.txt")
    write_diligent(tmp_path / "mine" / "without truth", scene)
    (tmp_path / "mine" / "without truth" / "Normal_gt.mat").unlink()
    done = bench("captures", tmp_path / "mine", tmp_path / "runs", methods="woodham")
    assert done.predicted == 1 and len(done.failures) == 1 and "no true normals" in done.failures[0]
    (table,) = tables(tmp_path / "runs")
    assert table.dataset == "captures-mine" and table.rows[0].cells["vase"].value < 3
    done = bench("diligent", tmp_path / "mine", tmp_path / "others", methods="woodham", objects="without truth")
    assert "Normal_gt.mat is missing" in done.failures[0] and "bench captures" in done.failures[0]


def test_captures_whose_files_do_not_say_that_they_are_encoded(tmp_path):
    write_diligent(tmp_path / "mine" / "vase", lambertian(sphere(24), ring(6, 60)))
    bench("captures", tmp_path / "mine", tmp_path / "right", methods="woodham")
    bench("captures", tmp_path / "mine", tmp_path / "linearised", methods="woodham", srgb=True)
    right, linearised = (tables(tmp_path / runs)[0].rows[0].cells["vase"].value for runs in ("right", "linearised"))
    assert linearised > right + 3
    with pytest.raises(InputError, match="was made with"):
        bench("captures", tmp_path / "mine", tmp_path / "linearised", methods="woodham")
    with pytest.raises(InputError, match="--srgb is for `bench captures`"):
        bench("diligent", tmp_path / "mine", tmp_path / "others", methods="woodham", srgb=True)


def test_materials_have_means_instead_of_columns(tmp_path, run):
    for k in range(14):
        write_diligent(tmp_path / "root" / f"material-{k}", lambertian(sphere(24), ring(6, 60), 0.1 + k / 20))
    done = bench("materials", tmp_path / "root", tmp_path / "runs", methods="woodham")
    assert done.predicted == 14 and not done.failures
    (table,) = tables(tmp_path / "runs")
    assert table.dataset == "materials-root"  # the same materials on another object stay apart
    assert [c.name for c in table.columns] == ["mean_deg", "below_15", "below_30"] and table.rows[0].over == 14
    assert table.rows[0].cells["below_30"].value == 100
    bench("materials", tmp_path / "root", tmp_path / "runs", methods="trimmed", objects="material-2,material-5")
    printed = run("table", tmp_path / "runs")[1].splitlines()
    assert "| method | mean of 14, deg |" in " ".join(printed)
    first = {x.split("|")[1].strip(): x.split("|")[2] for x in reversed(printed) if x.startswith("| ")}
    assert "(of 2)" in first["trimmed"] and "(of" not in first["woodham"]


def test_cycles_finds_renderings_and_their_counts(tmp_path, capture):
    for count in ("L64",):
        folder = tmp_path / count / "sphere.obj"
        for kind in ("images_specular", "images_metallic"):
            for j, picture in enumerate(pictures(capture, 65535, np.uint16)):
                png(folder / kind / f"{j:05d}.tif", picture)
        png(folder / "gt_normal.tif", encoded(capture.truth, 65535, np.uint16))
        png(folder / "inboundary.png", capture.mask.astype(np.uint8) * 255)
        np.savetxt(folder / "light.txt", capture.lights)
    found = items("cycles", tmp_path)
    assert {(i.dataset, i.name) for i in found} == {("cycles64", "sphere specular"), ("cycles64", "sphere metallic")}
    done = bench("cycles", tmp_path, tmp_path / "runs", methods="woodham")
    assert done.predicted == 2 and not done.failures
    assert tables(tmp_path / "runs")[0].rows[0].cells["sphere specular"].value < 6
    (tmp_path / "set.json").write_text("{}")  # as photonormal.synth leaves it: published figures are of other pictures
    assert {i.dataset for i in items("cycles", tmp_path / "L64")} == {"rendered-cycles64"}


def test_lightstage_has_pictures_but_no_errors(tmp_path, capture, run):
    root = tmp_path / "root"
    for j, picture in enumerate(pictures(capture, 255, np.uint8)):
        png(root / "helmet" / f"helmet_{j:04d}.png", picture)
    png(root / "helmet" / "helmet_matte.png", np.where(capture.mask, 0, 255).astype(np.uint8))
    rows = [f"{j} " + " ".join(f"{-x:.6f}" for x in l) for j, l in enumerate(capture.lights)]
    (root / "light_directions.txt").write_text("\n".join(rows))
    (root / "light_intensities.txt").write_text("\n".join(f"{j} 1 1 1" for j in range(len(rows))))
    code, _, err = run("bench", "lightstage", root, "--methods", "woodham", "--out", tmp_path / "runs")
    assert (code, err) == (0, "")
    code, out, _ = run("table", tmp_path / "runs")
    assert code == 0 and "nothing to score" in out and "| woodham |" in out


@pytest.fixture(scope="module")
def blobby(tmp_path_factory, capture):
    root = tmp_path_factory.mktemp("blobby")
    shape = root / "Images" / "blob01"
    png(shape / "blob01_normal.png", np.where(capture.mask[..., None], encoded(capture.truth, 255, np.uint8), 127))
    for material in ("matt", "grey"):
        lines = []
        for j, picture in enumerate(pictures(capture, 255, np.uint8)):
            png(shape / material / f"{j}.png", picture)
            lines.append(f"{j}.png " + " ".join(f"{x:.6f}" for x in capture.lights[j]))
        (shape / material / f"blob01_{material}.txt").write_text("\n".join(lines))
    (root / "val_mtrl.txt").write_text("blob01/matt\nblob01/grey\n")
    return root


def test_blobby_is_scored_clean_and_as_the_paper_validates(blobby, tmp_path):
    done = bench("blobby", blobby, tmp_path, methods="woodham")
    assert done.predicted == 4 and not done.failures
    clean, paper = tables(tmp_path)
    assert (clean.dataset, clean.images, paper.dataset, paper.images) == ("blobby", 64, "blobby-paper", 32)
    assert clean.rows[0].cells["average"].value < paper.rows[0].cells["average"].value  # noise and fewer images
    record = json.loads((tmp_path / "woodham" / "blobby-paper" / "blob01" / "matt.json").read_text())
    assert len(set(record["images"])) == 32


def test_the_paper_s_crop_repeats_and_stays_in_its_limits(blobby):
    whole = load(blobby / "Images" / "blob01" / "matt")
    a, b, c = (augmented(whole, np.random.default_rng(seed)) for seed in (1, 1, 2))
    assert a.images.shape == (32, 32, 32, 3) and (np.asarray(a.images) == np.asarray(b.images)).all()
    assert np.asarray(c.images).shape == a.images.shape and (np.asarray(a.images) != np.asarray(c.images)).any()
    assert np.asarray(a.images).max() <= 2.025 and np.asarray(a.images).min() >= -0.025
    assert np.abs(np.linalg.norm(a.truth.map[a.mask], axis=-1) - 1).max() < 1e-3


def test_the_paper_s_crop_leaves_normals_right(blobby):
    """Without noise, least squares on a crop of a matt sphere finds the crop's own normals where all lights reach."""
    from photonormal.geometry import angle_deg
    from photonormal.methods import solve

    whole = load(blobby / "Images" / "blob01" / "matt")
    crop = augmented(whole, np.random.default_rng(5))
    lit = crop.mask & (crop.truth.map @ np.asarray(crop.lights, np.float32).T > 0.1).all(-1)
    assert lit.sum() > 20
    error = angle_deg(solve(crop, "woodham").map[lit], crop.truth.map[lit])
    assert np.median(error) < 20 * NOISE * 10


@pytest.mark.parametrize("which", ["diligent", "materials", "cycles", "blobby", "lightstage"])
def test_a_root_without_objects_says_what_is_needed(tmp_path, which):
    with pytest.raises(InputError, match=f"holds no objects of {which}; give"):
        items(which, tmp_path)
