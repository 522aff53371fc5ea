"""Pictures for materials: named, turned and encoded as programs expect them; tiles whose edges meet."""

import json
import shutil

import cv2
import numpy as np
import pytest

from photonormal.cli import main
from photonormal.export import load_normals
from photonormal.export.heights import read_depth
from photonormal.export.pictures import read_albedo
from photonormal.files import memory
from photonormal.files.decode import decode
from photonormal.geometry import normalised
from photonormal.handover import surfaces
from photonormal.handover.tiles import closed
from photonormal.masked import box_of
from photonormal.srgb import to_linear
from photonormal.types import Capture, Normals
from tests.scenes import lambertian, ring, write_diligent

SIZE = 40


def waves(tilt):
    """Normals of waves that repeat after SIZE pixels, on a plane that rises to the right."""
    y, x = 2 * np.pi * np.mgrid[:SIZE, :SIZE] / SIZE
    p, q = tilt + 0.4 * np.cos(x + y), 0.4 * np.cos(x + y) + 0.2 * np.cos(2 * y)  # rise to the right, and downwards
    return normalised(np.stack([-p, q, np.ones_like(p)], -1)).astype(np.float32)


@pytest.fixture(scope="module")
def sloping(tmp_path_factory):
    """The result of a sheet of waves that slopes, and is brighter on its right."""
    folder = tmp_path_factory.mktemp("sloping")
    seen = lambertian(Normals(waves(0.2), np.ones((SIZE, SIZE), bool)), ring(8))
    images = seen.images * np.linspace(0.6, 1, SIZE)[:, None].astype(np.float32)
    write_diligent(folder / "sheet", Capture(images, seen.mask, seen.lights))
    assert main(["measure", str(folder / "sheet"), "--out", str(folder / "r"), "--method", "woodham"]) == 0
    return folder / "r"


def maps(result, out, *words):
    """The pictures of a folder, from 0 to 1, by their names, and what it says of them."""
    assert main(["export", str(result), "--to", "maps", "--out", str(out), *words]) == 0
    found = {p.name: cv2.imread(str(p), -1) for p in out.glob("*.png")}
    depth = {name: p.dtype for name, p in found.items()}
    found = {name: p[..., ::-1] if p.ndim == 3 else p for name, p in found.items()}
    scaled = {name: p / np.iinfo(p.dtype).max for name, p in found.items()}
    return scaled, depth, json.loads((out / f"{out.name}.json").read_text())


def test_programs_find_their_names_and_their_green(measured, tmp_path):
    blender, depth, told = maps(measured / "r", tmp_path / "stone", "--mm-per-px", "0.5")
    substance, _, _ = maps(measured / "r", tmp_path / "s" / "stone", "--program", "substance")
    unreal, _, px = maps(measured / "r", tmp_path / "u" / "stone", "--program", "unreal")
    names = ("BaseColor", "Normal", "Height", "AmbientOcclusion")
    assert set(blender) == set(substance) == {f"stone_{name}.png" for name in names}
    assert set(unreal) == {f"T_stone_{name}.png" for name in ("BC", "N", "H", "ORM")}
    assert depth["stone_Height.png"] == depth["stone_Normal.png"] == np.uint16
    assert np.abs(substance["stone_Normal.png"][..., 1] + blender["stone_Normal.png"][..., 1] - 1).max() < 1e-4
    assert np.array_equal(unreal["T_stone_N.png"], substance["stone_Normal.png"])
    assert np.array_equal(unreal["T_stone_ORM.png"][..., 0], blender["stone_AmbientOcclusion.png"])
    assert (unreal["T_stone_ORM.png"][..., 1] == 1).all() and (unreal["T_stone_ORM.png"][..., 2] == 0).all()
    assert (told["unit"], px["unit"], told["normals"], told["repeats"]) == ("mm", "px", "opengl", False)
    assert told["width"] == px["width"] / 2


def test_pictures_hold_what_was_measured(measured, tmp_path):
    found, _, told = maps(measured / "r", tmp_path / "a")
    normals, surface = load_normals(measured / "r"), read_depth(measured / "r" / "depth.npz")
    box = box_of(normals.mask)
    mask = normals.mask[box]
    low, high = told["height"]["low"], told["height"]["high"]
    height = low + found["a_Height.png"] * (high - low)
    assert np.abs(height - surface.heights_px()[box])[mask].max() < 1e-3 * (high - low)
    assert np.abs(2 * found["a_Normal.png"] - 1 - normals.map[box])[mask].max() < 1e-4
    albedo = cv2.imread(str(measured / "r" / "albedo.png"), -1)[..., ::-1][box] / 65535
    assert np.abs(found["a_BaseColor.png"] - albedo)[mask].max() < 1 / 255
    assert (found["a_BaseColor.png"].min(-1) > 0.1).all()  # no black border that would bleed into the object


def test_some_rows_at_a_time_give_what_all_at_once_give(measured, tmp_path, monkeypatch):
    whole, _, told = maps(measured / "r", tmp_path / "a")
    monkeypatch.setattr(surfaces, "PIXELS", 1000)
    parts, _, again = maps(measured / "r", tmp_path / "b" / "a")
    assert told == again and whole.keys() == parts.keys()
    mask = load_normals(measured / "r").mask
    mask = mask[box_of(mask)]
    for name, picture in whole.items():
        assert np.array_equal(picture[mask], parts[name][mask]), name
        assert np.abs(picture - parts[name]).mean() < 1e-3  # of two pixels as near, either is taken


def test_floats_hold_the_values_themselves(measured, tmp_path):
    found, _, told = maps(measured / "r", tmp_path / "a", "--exr", "--mm-per-px", "0.5")
    assert found.keys() == {"a_AmbientOcclusion.png"}
    normals, surface = load_normals(measured / "r"), read_depth(measured / "r" / "depth.npz")
    box = box_of(normals.mask)
    mask = normals.mask[box]
    height, n, colour = (decode(tmp_path / "a" / f"a_{name}.exr") for name in ("Height", "Normal", "BaseColor"))
    assert np.abs(height[..., 0] - 0.5 * surface.heights_px()[box])[mask].max() < 1e-5
    assert np.isclose([height.min(), height.max()], [told["height"]["low"], told["height"]["high"]]).all()
    assert np.abs(2 * n - 1 - normals.map[box])[mask].max() < 1e-6
    albedo = read_albedo(measured / "r" / "albedo.png")[box]
    assert np.abs(colour - albedo)[mask].max() < 1e-3  # half floats


def test_an_edge_that_is_closed_is_a_step_like_those_inside():
    noise = np.random.default_rng(0).normal(size=(SIZE, SIZE))
    layer = np.arange(SIZE) + 0.5 * np.arange(SIZE)[:, None] + 0.1 * noise
    found = closed(layer)
    assert abs(found.mean() - layer.mean()) < 1e-4
    assert np.abs(found[:, 0] - found[:, -1]).max() < 2 and np.abs(found[0] - found[-1]).max() < 2
    assert np.std(np.diff(found, axis=1)) < 1.5 * np.std(np.diff(layer, axis=1))


def test_a_tile_is_the_waves_without_their_slope_and_without_a_seam(sloping, tmp_path):
    found, _, told = maps(sloping, tmp_path / "t", "--tile")
    N = 2 * found["t_Normal.png"] - 1
    off = np.degrees(np.arccos((normalised(N) * waves(0.0)).sum(-1).clip(-1, 1)))
    assert told["repeats"] and np.median(off) < 2
    plain = maps(sloping, tmp_path / "p")[0]
    tiles = found["t_Height.png"], to_linear(found["t_BaseColor.png"][..., 0])
    cuts = plain["p_Height.png"], to_linear(plain["p_BaseColor.png"][..., 0])
    for tile, cut in zip(tiles, cuts, strict=True):
        assert np.abs(tile[:, 0] - tile[:, -1]).max() < 0.1 and np.abs(tile[0] - tile[-1]).max() < 0.1
        assert np.abs(cut[:, 0] - cut[:, -1]).max() > 0.3


def test_a_tile_that_bends_what_it_shows_is_doubted(sloping, tmp_path, capsys, caplog):
    maps(sloping, tmp_path / "t", "--tile")
    assert not caplog.messages and "no roughness" in capsys.readouterr().err
    y, x = 0.8 * (np.mgrid[:SIZE, :SIZE] / SIZE - 0.5) * 2
    dome = normalised(np.stack([x, -y, np.ones_like(x)], -1)).astype(np.float32)
    write_diligent(tmp_path / "dome", lambertian(Normals(dome, np.ones((SIZE, SIZE), bool)), ring(8)))
    assert main(["measure", str(tmp_path / "dome"), "--out", str(tmp_path / "r"), "--method", "woodham"]) == 0
    maps(tmp_path / "r", tmp_path / "d", "--tile")
    assert "hardly meet" in caplog.messages[-1] and "--crop" in caplog.messages[-1]


def test_what_is_no_tile_and_what_is_there_is_refused(measured, tmp_path, refused, monkeypatch):
    out = tmp_path / "a"
    refused("--to", "maps", "--out", out, "--tile", says="--crop")
    monkeypatch.setattr(memory, "_given", None)  # and again afterwards
    refused("--to", "maps", "--out", out, "--tile", "--memory", "120KB", says="a tile of")
    refused("--to", "gltf", "--out", tmp_path / "a.glb", "--exr", says="--to maps")
    shutil.copytree(measured / "r", tmp_path / "r")
    refused("--to", "maps", "--out", tmp_path / "r", says="--overwrite")
    refused("--to", "maps", "--out", tmp_path / "r", "--overwrite", result=tmp_path / "r", says="is read here")
    (tmp_path / "r" / "albedo.png").unlink()
    refused("--to", "maps", "--out", out, result=tmp_path / "r", says="albedo.png")
