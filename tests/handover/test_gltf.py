"""A result as glTF: read again by the format's description."""

import json
import shutil
import struct

import cv2
import numpy as np
import pytest

from photonormal.cli import main
from photonormal.export.heights import read_depth
from photonormal.handover import surfaces
from photonormal.handover.gltf import encoded
from photonormal.handover.surfaces import textured_relief
from photonormal.masked import box_of

SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Read:
    """A .glb file: its JSON, arrays by accessor, pictures by texture."""

    def __init__(self, data):
        magic, version, length = struct.unpack("<4sII", data[:12])
        assert (magic, version, length) == (b"glTF", 2, len(data)) and length % 4 == 0
        size, kind = struct.unpack("<I4s", data[12:20])
        assert kind == b"JSON"
        self.json = json.loads(data[20 : 20 + size])
        rest = data[20 + size :]
        assert struct.unpack("<I4s", rest[:8]) == (self.json["buffers"][0]["byteLength"], b"BIN\0")
        self.body = rest[8:]
        self.mesh = self.json["meshes"][0]["primitives"][0]
        self.material = self.json["materials"][0]

    def view(self, number):
        view = self.json["bufferViews"][number]
        return self.body[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def array(self, number):
        told = self.json["accessors"][number]
        values = np.frombuffer(self.view(told["bufferView"]), {5126: "<f4", 5125: "<u4"}[told["componentType"]])
        values = values.reshape(told["count"], SIZES[told["type"]])
        if "min" in told:
            assert told["min"] == values.min(0).tolist() and told["max"] == values.max(0).tolist()
        return values

    def attribute(self, name):
        return self.array(self.mesh["attributes"][name])

    def picture(self, texture):
        source = self.json["textures"][texture["index"]]["source"]
        return cv2.imdecode(np.frombuffer(self.view(self.json["images"][source]["bufferView"]), np.uint8), -1)[
            ..., ::-1
        ]


@pytest.fixture(scope="module")
def found(measured):
    with textured_relief(measured / "r") as found:
        yield found


def read(result, most_faces=10**6):
    with textured_relief(result) as found:
        return Read(b"".join(encoded(found, most_faces)))


@pytest.mark.parametrize("step", [1, 3])
def test_the_normal_map_on_the_mesh_is_the_normals_that_were_measured(found, step):
    file = Read(b"".join(encoded(found, 2 * found.known.sum() // step**2 + 1)))
    N, T, uv = (file.attribute(name).astype(float) for name in ("NORMAL", "TANGENT", "TEXCOORD_0"))
    assert np.abs((N**2).sum(1) - 1).max() < 1e-6 and np.abs((T[:, :3] ** 2).sum(1) - 1).max() < 1e-6
    assert np.abs((N * T[:, :3]).sum(1)).max() < 1e-6 and (T[:, 3] == 1).all()
    triangles = file.array(file.mesh["indices"]).reshape(-1, 3)
    picture = file.picture(file.material["normalTexture"]) / 127.5 - 1
    h, w = picture.shape[:2]
    box = box_of(found.known, 8)
    assert picture.shape[:2] == (box[0].stop - box[0].start, box[1].stop - box[1].start)
    a, _, b = uv[triangles].swapaxes(0, 1)
    square = np.abs((a - b) @ np.diag([w, h])).sum(1) < 3 * step + 0.5
    n, t, p = (values[triangles[square]].mean(1) for values in (N, T[:, :3], uv))  # a third of the way for a step of 3
    column, row = (p * [w, h] - 0.5).T
    on = (np.abs(row - np.rint(row)) < 1e-3) & (np.abs(column - np.rint(column)) < 1e-3)
    if step == 1:
        n, t, (column, row), on = N, T[:, :3], (uv * [w, h] - 0.5).T, np.ones(len(N), bool)
    assert on.sum() > 50
    n, t = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (n, t))
    texel = picture[np.rint(row[on]).astype(int), np.rint(column[on]).astype(int)]
    shaded = np.einsum("pi,pij->pj", texel, np.stack([t[on], np.cross(n, t)[on], n[on]], axis=1))
    truth = found.part(*box).normals[np.rint(row[on]).astype(int), np.rint(column[on]).astype(int)]
    cosine = (shaded * truth).sum(1) / np.linalg.norm(shaded, axis=1)
    off = np.degrees(np.arccos(cosine.clip(-1, 1)))
    assert np.median(off) < 0.4 and off.max() < 4  # triangles at the outline lie across the grid


def test_the_mesh_lies_around_the_origin_in_metres(measured, tmp_path):
    out = tmp_path / "a.glb"
    words = ["export", str(measured / "r"), "--to", "gltf", "--out", str(out), "--mm-per-px", "2"]
    assert main(words) == 0
    X = Read(out.read_bytes()).attribute("POSITION")
    surface = read_depth(measured / "r" / "depth.npz")
    rows, columns = box_of(surface.mask)
    size = 0.002 * np.array([columns.stop - columns.start - 1, rows.stop - rows.start - 1])
    assert np.allclose(np.ptp(X, axis=0)[:2], size, rtol=1e-5) and np.abs(X.max(0) + X.min(0)).max() < 1e-6
    assert np.argmax(X[:, 2]) // 200 == len(X) // 2 // 200  # the ball's middle is nearest to the camera


def test_the_material_is_matt_unless_the_result_says_how_rough_it_is(measured, found, tmp_path):
    plain = read(measured / "r")
    assert plain.material["pbrMetallicRoughness"].keys() == {"baseColorTexture", "metallicFactor", "roughnessFactor"}
    assert plain.material["pbrMetallicRoughness"]["metallicFactor"] == 0
    shutil.copytree(measured / "r", tmp_path / "r")
    shape = found.known.shape
    roughness = np.full(shape, 16384, np.uint16)
    roughness[: shape[0] // 2] = 0  # unknown
    cv2.imwrite(str(tmp_path / "r" / "roughness.png"), roughness)
    told = read(tmp_path / "r").material["pbrMetallicRoughness"]
    assert told["metallicFactor"] == 0 and told["roughnessFactor"] == 1
    rough = read(tmp_path / "r")
    assert set(np.unique(rough.picture(told["metallicRoughnessTexture"])[..., 1])) == {64, 255}


def test_measured_materials_are_the_colour_and_the_gloss(measured, found, tmp_path):
    shutil.copytree(measured / "r", tmp_path / "r")
    shape = found.known.shape
    cv2.imwrite(str(tmp_path / "r" / "base_colour.png"), np.full((*shape, 3), (30, 60, 90), np.uint8))
    cv2.imwrite(str(tmp_path / "r" / "metalness.png"), np.full(shape, 255, np.uint8))
    file = read(tmp_path / "r")
    rough = file.material["pbrMetallicRoughness"]
    assert (file.picture(rough["baseColorTexture"]) == (90, 60, 30)).all() and rough["metallicFactor"] == 1
    assert (file.picture(rough["metallicRoughnessTexture"])[..., 2] == 255).all()


def test_pictures_are_as_large_as_was_asked_for(measured, found, tmp_path, capsys, monkeypatch):
    words = ["export", str(measured / "r"), "--to", "gltf", "--out", str(tmp_path / "a.glb")]
    assert main(words) == 0 and capsys.readouterr().err == ""
    full = Read((tmp_path / "a.glb").read_bytes())
    monkeypatch.setattr(surfaces, "PIXELS", 1000)
    assert main([*words, "--texture", "32", "--overwrite"]) == 0
    told = capsys.readouterr().err
    assert "reduced to 32 pixels" in told and len(told.splitlines()) == 1
    small = Read((tmp_path / "a.glb").read_bytes())
    for kind in ("normalTexture", "occlusionTexture"):
        large, picture = full.picture(full.material[kind]), small.picture(small.material[kind])
        assert max(picture.shape[:2]) == 32
        expected = cv2.resize(large, picture.shape[1::-1], interpolation=cv2.INTER_AREA).astype(int)
        assert np.abs(expected - picture).mean() < 1
    assert np.array_equal(small.attribute("POSITION"), full.attribute("POSITION"))


def test_what_is_one_pixel_wide_has_no_triangle(measured, tmp_path, refused):
    shutil.copytree(measured / "r", tmp_path / "r")
    depth = dict(np.load(tmp_path / "r" / "depth.npz"))
    depth["mask"][:, np.arange(depth["mask"].shape[1]) != 24] = False
    np.savez(tmp_path / "r" / "depth.npz", **depth)
    refused("--to", "gltf", "--out", tmp_path / "a.glb", result=tmp_path / "r", says="too narrow for a mesh")


def test_what_has_no_surface_is_refused(measured, tmp_path, refused):
    refused("--to", "gltf", "--out", tmp_path / "a.gltf", says=".glb")
    refused("--to", "gltf", "--out", tmp_path / "a.glb", "--texture", "8", says="16 to 16384")
    shutil.copytree(measured / "r", tmp_path / "r")
    cv2.imwrite(str(tmp_path / "r" / "roughness.png"), np.zeros((3, 3), np.uint8))
    refused("--to", "gltf", "--out", tmp_path / "a.glb", result=tmp_path / "r", says="roughness.png is (3, 3)")
    (tmp_path / "r" / "depth.npz").unlink()
    refused("--to", "gltf", "--out", tmp_path / "a.glb", result=tmp_path / "r", says="depth.npz")
    refused("--to", "gltf", "--out", tmp_path / "a.glb", result=tmp_path, says="give a result in it, such as")
