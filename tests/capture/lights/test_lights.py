"""Files with lights, as people and their programs write them, and what is said of those that can't be sure."""

import json
from typing import ClassVar

import numpy as np
import pytest
from scipy.io import savemat

from photonormal import load
from photonormal.capture.lights import read_lights
from photonormal.doctor import findings_of
from photonormal.types import InputError
from tests.capture.files import LIGHTS, refusal, samples, write_folder, write_picture

NAMES = [f"IMG_{j}.png" for j in range(1, 5)]
ROWS = [[f"{v:.6f}" for v in l] for l in LIGHTS]


def rows(separator: str, names=NAMES, count: str | None = "4", end: str = "") -> str:
    lines = [separator.join([name, *row]) + end for name, row in zip(names, ROWS, strict=True)]
    return "\n".join([*([count] if count else []), *lines]) + "\n"


def directions(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize(
    "text",
    [
        rows(" "),
        rows(","),
        rows(";"),
        rows(", "),
        rows(",", count="4,,,"),
        rows(" ", count=None),
        "# my dome\n" + rows(" "),
        rows(" ", end=" # ok"),
        rows(" ", end=" 12.5 0.3"),
        rows(",", end=",12.5,north"),
        rows(" ").replace("-", "\u2212"),
        rows(" ") + "\x1a",
        rows(" ").replace(" 0.", " 0,"),
        rows(";").replace(".0", ",0").replace("0.", "0,"),
        "x;y;z\n".join(["", rows(";", count=None)]).replace("x;", "name;x;", 1),
        "name,x,y,z,remark\n" + rows(",", count=None, end=",left of the door"),
        "name,z,y,x,lamp\n" + "\n".join(",".join([n, *r[::-1], "7"]) for n, r in zip(NAMES, ROWS, strict=True)),
        "name  x  y  z  lamp\n" + rows(" ", count=None, end=" 7"),
        rows(" ", names=[f'"{n}"' for n in NAMES]),
        "x;y;z;file\n" + "\n".join(";".join([*row, n]) for n, row in zip(NAMES, ROWS, strict=True)),
        "\n".join(",".join([*row, n]) for n, row in zip(NAMES, ROWS, strict=True)),
        "sep=,\n" + rows(",", count=None),
        "no,file,z,y,x\n" + "\n".join(f"7,{n},{','.join(r[::-1])}" for n, r in zip(NAMES, ROWS, strict=True)),
        "\n".join(f"{k}\t{n}\t" + "\t".join(r) for k, (n, r) in enumerate(zip(NAMES, ROWS, strict=True))),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("suffix", [".lp", ".csv", ".txt"])
def test_a_list_is_read_however_it_is_written(tmp_path, text, encoding, suffix):
    (tmp_path / f"a{suffix}").write_bytes(text.encode(encoding))
    listed = read_lights(tmp_path / f"a{suffix}")
    assert listed.names == NAMES
    np.testing.assert_allclose(listed.vectors, LIGHTS, atol=1e-6)


@pytest.mark.parametrize(
    "text",
    [
        "\n".join(" ".join(row) for row in ROWS),
        "4\n" + "\n".join(" ".join(row) for row in ROWS),
        "X\tY\tZ\n" + "\n".join("\t".join(row) for row in ROWS),
        " ,X,Y,Z\n" + "\n".join(",".join([str(k + 1), *row]) for k, row in enumerate(ROWS)),
        " \tX\tY\tZ\n" + "\n".join("\t".join([str(k + 1), *row]) for k, row in enumerate(ROWS)),
        "# z y x\n" + "\n".join(" ".join(row[::-1]) for row in ROWS),
        "# in a dome of x rows\n" + "\n".join(" ".join(row) for row in ROWS),
        "lamp z y x\n" + "\n".join(" ".join([str(k), *row[::-1]]) for k, row in enumerate(ROWS)),
        "\n".join(" ".join([str(k), *row]) for k, row in enumerate(ROWS)),
        "\n".join(" ".join(column) for column in zip(*ROWS, strict=True)),
    ],
)
def test_a_table_names_no_pictures(tmp_path, text):
    (tmp_path / "a.txt").write_text(text)
    listed = read_lights(tmp_path / "a.txt")
    assert listed.names == [] and listed.notes == ()
    np.testing.assert_allclose(listed.vectors, LIGHTS, atol=1e-6)


def test_arrays(tmp_path):
    np.save(tmp_path / "a.npy", LIGHTS)
    np.save(tmp_path / "b.npy", LIGHTS.T)
    savemat(tmp_path / "c.mat", {"mu": np.ones((4, 1)), "S": 300 * LIGHTS})
    savemat(tmp_path / "d.mat", {"Phi": np.ones((4, 3)), "S": LIGHTS, "text": "x"})
    np.savez(tmp_path / "h.npz", S=LIGHTS, names=np.arange(4))
    for name in ("a.npy", "b.npy", "c.mat", "d.mat", "h.npz"):
        np.testing.assert_allclose(directions(read_lights(tmp_path / name).vectors), LIGHTS)
    assert "array S" in read_lights(tmp_path / "d.mat").notes[0]
    savemat(tmp_path / "e.mat", {"S": LIGHTS, "L": LIGHTS})
    assert "S, L" in refusal(read_lights, tmp_path / "e.mat")
    np.save(tmp_path / "f.npy", LIGHTS.astype(object), allow_pickle=True)
    assert "objects" in refusal(read_lights, tmp_path / "f.npy")
    (tmp_path / "g.npy").write_bytes(b"junk")
    assert "g.npy can't be read" in refusal(read_lights, tmp_path / "g.npy")
    (tmp_path / "lights.dat").write_bytes(LIGHTS.tobytes())
    assert "no text" in refusal(read_lights, tmp_path / "lights.dat")


def test_json_may_name_pictures(tmp_path):
    named = [{"name": n, "direction": v.tolist()} for n, v in zip(NAMES, LIGHTS, strict=True)]
    (tmp_path / "a.json").write_text(json.dumps({"lights": named}))
    listed = read_lights(tmp_path / "a.json")
    assert listed.names == NAMES
    np.testing.assert_allclose(listed.vectors, LIGHTS)
    (tmp_path / "a.json").write_text(json.dumps({"lights": [*named[:3], {"direction": [0, 0, 1]}]}))
    assert "names 3 of its 4 lights" in refusal(read_lights, tmp_path / "a.json")
    (tmp_path / "a.json").write_text(json.dumps(LIGHTS.tolist()))
    assert '"direction": [x, y, z]' in refusal(read_lights, tmp_path / "a.json")


class TestAngles:
    SLANT_TILT = np.degrees(np.stack([np.arccos(LIGHTS[:, 2]), np.arctan2(LIGHTS[:, 1], LIGHTS[:, 0])], axis=1))
    AZIMUTH_ELEVATION = np.stack([SLANT_TILT[:, 1], 90 - SLANT_TILT[:, 0]], axis=1)

    def test_by_a_header(self, tmp_path):
        for header, table in (
            ("slant tilt", self.SLANT_TILT),
            ("azimuth elevation", self.AZIMUTH_ELEVATION),
            ("Azimut[°] El[°]", self.AZIMUTH_ELEVATION),
            ("no tilt_deg slant_deg", np.column_stack([np.arange(4), self.SLANT_TILT[:, ::-1]])),
        ):
            for remark in ("", "# "):
                np.savetxt(tmp_path / "a.txt", table, header=header, comments=remark)
                listed = read_lights(tmp_path / "a.txt")
                np.testing.assert_allclose(listed.vectors, LIGHTS, atol=1e-9)
                assert listed.notes == ()

    @pytest.mark.parametrize("numbered", [False, True])
    def test_without_a_header_they_have_to_be_said(self, tmp_path, numbered):
        for kind, table in (("angles", self.SLANT_TILT), ("azimuth-elevation", self.AZIMUTH_ELEVATION)):
            np.savetxt(tmp_path / "a.txt", np.column_stack([np.arange(1, 5), table]) if numbered else table)
            assert "--lights-as angles" in refusal(read_lights, tmp_path / "a.txt")
            listed = read_lights(tmp_path / "a.txt", kind)
            np.testing.assert_allclose(listed.vectors, LIGHTS, atol=1e-9)
            assert "in degrees" in listed.notes[0]

    def test_beside_names(self, tmp_path):
        lines = [f"{name},{s},{t}" for name, (s, t) in zip(NAMES, self.SLANT_TILT, strict=True)]
        (tmp_path / "a.csv").write_text("\n".join(["picture,slant,tilt", *lines]))
        listed = read_lights(tmp_path / "a.csv")
        assert listed.names == NAMES
        np.testing.assert_allclose(listed.vectors, LIGHTS, atol=1e-9)

    def test_radians_are_refused(self, tmp_path):
        np.savetxt(tmp_path / "a.txt", np.radians(self.SLANT_TILT), header="slant tilt", comments="")
        assert "radians" in refusal(read_lights, tmp_path / "a.txt")


def test_a_wrong_count_is_told_where_the_lights_have_names_and_refused_where_they_have_none(tmp_path):
    (tmp_path / "a.lp").write_text(rows(" ", count="7"))
    listed = read_lights(tmp_path / "a.lp")
    assert listed.names == NAMES and listed.notes == ("a.lp says 7 pictures but lists 4, which were used.",)
    (tmp_path / "a.lp").write_text("7\n" + "\n".join(" ".join(row) for row in ROWS))
    assert "says 7 pictures but lists 4; correct" in refusal(read_lights, tmp_path / "a.lp")


def test_lengths_that_differ_much_are_told(tmp_path):
    np.savetxt(tmp_path / "a.txt", LIGHTS * [[1], [1], [1], [9]])
    assert "--lights-as" in read_lights(tmp_path / "a.txt").notes[0]


class TestPrograms:
    DOME: ClassVar = {
        "imageWidth": 210.0,
        "domeDiameter": 600.0,
        "lightConfiguration": "spherical",
        "directions": [dict(zip("xyz", l, strict=True)) for l in LIGHTS.tolist()],
        "positions3d": [],
    }

    def test_relight(self, tmp_path):
        project = {"images": [{"filename": n, "skip": False} for n in NAMES], "dome": self.DOME}
        for name, content, names in (("a.dome", self.DOME, []), ("a.relight", project, NAMES)):
            (tmp_path / name).write_text(json.dumps(content))
            listed = read_lights(tmp_path / name)
            assert listed.names == names and "--dome-radius-mm 300" in listed.notes[0]
            np.testing.assert_allclose(listed.vectors, LIGHTS)

    def test_relight_s_positions(self, tmp_path):
        (tmp_path / "a.dome").write_text(json.dumps({"positions3d": (300 * LIGHTS).tolist()}))
        np.testing.assert_allclose(read_lights(tmp_path / "a.dome").vectors, 300 * LIGHTS)
        (tmp_path / "a.dome").write_text("{}")
        assert "no directions" in refusal(read_lights, tmp_path / "a.dome")

    def test_alicevision(self, tmp_path):
        lights = [{"viewId": "7", "direction": [str(v) for v in l], "intensity": [1, 2, "3"]} for l in LIGHTS]
        (tmp_path / "a.json").write_text(json.dumps({"lights": lights}))
        listed = read_lights(tmp_path / "a.json")
        np.testing.assert_allclose(listed.vectors, LIGHTS)
        assert listed.intensities is not None
        np.testing.assert_array_equal(listed.intensities, [[1, 2, 3]] * 4)
        assert "order of AliceVision's views" in listed.notes[0]
        (tmp_path / "a.json").write_text(json.dumps({"lights": [{"direction": [0] * 9, "type": "SH"}]}))
        assert "type SH" in refusal(read_lights, tmp_path / "a.json")

    @pytest.mark.parametrize("text", ["", "[]", "{", '{"lights": 3}', '{"lights": [{"direction": [1, 2]}]}'])
    def test_other_json(self, tmp_path, text):
        for name in ("a.json", "a.dome", "a.relight"):
            (tmp_path / name).write_text(text)
            assert name in refusal(read_lights, tmp_path / name)


@pytest.mark.parametrize("suffix", [".lp", ".csv", ".npy", ".mat", ".dome", ".relight", ".json"])
def test_any_change_is_read_or_refused(tmp_path, suffix):
    file, rng = tmp_path / f"a{suffix}", np.random.default_rng(0)
    if suffix == ".npy":
        np.save(file, LIGHTS)
    elif suffix == ".mat":
        savemat(file, {"S": LIGHTS, "cells": np.array(["a", 3], object)})
    elif suffix in (".lp", ".csv"):
        file.write_text(rows(" " if suffix == ".lp" else ","))
    else:
        content = TestPrograms.DOME | {"lights": [{"direction": l} for l in LIGHTS.tolist()]}
        file.write_text(json.dumps(content))
    data = file.read_bytes()
    for k in range(150):
        changed = bytearray(data if k % 10 else data[: rng.integers(len(data))])
        for place in rng.integers(0, max(len(changed), 1), 1 + k % 4):
            changed[place : place + 1] = rng.integers(0, 256, 1, np.uint8).tobytes()
        file.write_bytes(changed)
        try:
            read_lights(file)
        except InputError as error:
            assert len(str(error).splitlines()) == 1


class TestNames:
    @pytest.fixture
    def folder(self, tmp_path):
        for j, name in enumerate(NAMES):
            write_picture(tmp_path / "owl" / name, samples(j))
        return tmp_path / "owl"

    @pytest.mark.parametrize("change", [str.lower, lambda n: n.replace(".png", ".JPG"), lambda n: n[:-4]])
    def test_case_extension_and_folder_may_differ(self, folder, change):
        names = [f"C:\\rti\\{change(n)}" for n in NAMES]
        order = [2, 0, 3, 1]
        lines = [" ".join([names[j], *ROWS[j]]) for j in order]
        file = folder.parent / "rig.lp"
        file.write_text("\n".join(["4", *lines]))
        np.testing.assert_allclose(load(folder, lights=file).known_lights(), LIGHTS, atol=1e-5)
        file.rename(folder / "rig.lp")
        capture = load(folder)
        assert capture.image_names == tuple(NAMES[j] for j in order) and capture.notes == ()
        np.testing.assert_allclose(capture.known_lights(), LIGHTS[order], atol=1e-5)

    @pytest.mark.parametrize("lights", [None, "rig.lp"])
    def test_names_of_other_pictures_go_by_order(self, folder, lights):
        (folder / "rig.lp").write_text(rows(" ", names=["a.jpg", "b.jpg", "c.jpg", "d.jpg"]))
        capture = load(folder, lights=lights and folder / lights)
        np.testing.assert_allclose(capture.known_lights(), LIGHTS, atol=1e-5)
        assert "names other pictures (a.jpg, ...)" in capture.notes[0]

    def test_no_names_go_by_order(self, folder):
        (folder / "rig.lp").write_text("\n".join(" ".join(row) for row in ROWS))
        capture = load(folder)
        np.testing.assert_allclose(capture.known_lights(), LIGHTS, atol=1e-5)
        assert "names no pictures" in capture.notes[0]
        found = [finding for finding in findings_of(capture) if finding.kind == "reading"]
        assert [finding.message for finding in found] == list(capture.notes)

    def test_row_numbers_are_no_names(self, folder):
        (folder / "lights.csv").write_text(
            "\n".join([" ,X,Y,Z", *(",".join([str(k + 1), *row]) for k, row in enumerate(ROWS))])
        )
        np.testing.assert_allclose(load(folder).known_lights(), LIGHTS, atol=1e-5)

    def test_other_pictures_in_another_number(self, folder):
        (folder / "rig.lp").write_text("3\n" + "\n".join(f"{c}.jpg {' '.join(ROWS[0])}" for c in "abc"))
        message = refusal(load, folder)
        assert "4 pictures but 3 light directions in rig.lp" in message and "--lights" in message

    @pytest.mark.parametrize("second", ["IMG_1.png", "img_1.PNG", "IMG_1.jpg"])
    def test_a_picture_named_twice_is_refused(self, folder, second):
        file = folder.parent / "rig.lp"
        file.write_text(rows(" ", names=[*NAMES[:2], second, NAMES[3]]))
        assert "IMG_1" in refusal(load, folder, lights=file)
        file.rename(folder / "rig.lp")
        assert "twice" in refusal(load, folder)

    def test_the_file_named_wins_over_the_folder_s(self, folder):
        (folder / "broken.lp").write_text("nonsense")
        (folder / "gone.lp").write_text(rows(" ", names=["x.png", "y.png", "z.png", "w.png"]))
        (folder / "right.lp").write_text(rows(" "))
        np.testing.assert_allclose(load(folder, lights=folder / "right.lp").known_lights(), LIGHTS, atol=1e-5)

    def test_intensities_lie_beside_any_lights(self, folder):
        (folder / "rig.lp").write_text(rows(" "))
        np.savetxt(folder / "light_intensities.txt", [1, 2, 4, 8])
        np.testing.assert_allclose(load(folder).images[3], samples(3) / 65535 / 8, rtol=1e-5)
        np.testing.assert_allclose(load(folder / "rig.lp").images[2], samples(2) / 65535 / 4, rtol=1e-5)


class TestProjects:
    """RTIBuilder's folders, with absolute paths of another machine."""

    @pytest.fixture
    def project(self, tmp_path):
        folder = tmp_path / "vase"
        for j, name in enumerate(NAMES):
            write_picture(folder / "jpeg-exports" / name, samples(j))
        (folder / "assembly-files").mkdir()
        text = rows(" ", names=[f"C:\\RTI\\vase\\jpeg-exports\\{n}" for n in NAMES])
        for name in ("vase.lp", "vase_OriginalSet.lp"):
            (folder / "assembly-files" / name).write_text(text)
        return folder

    def test_the_project_and_its_lists(self, project):
        for path in (project, project / "assembly-files", project / "assembly-files" / "vase.lp"):
            capture = load(path)
            assert capture.name == "vase"
            assert capture.image_names == tuple(NAMES)
            np.testing.assert_allclose(capture.images[1], samples(1) / 65535, rtol=1e-6)
            np.testing.assert_allclose(capture.known_lights(), LIGHTS, atol=1e-5)

    def test_cropped_pictures_are_preferred(self, project):
        (project / "assembly-files" / "vase.lp").write_text(
            rows(" ", names=[f"C:\\vase\\cropped-files\\{n}" for n in NAMES])
        )
        np.testing.assert_allclose(load(project).images[1], samples(1) / 65535, rtol=1e-6)  # none are there
        for j, name in enumerate(NAMES):
            write_picture(project / "cropped-files" / name, samples(j + 9))
        np.testing.assert_allclose(load(project).images[1], samples(10) / 65535, rtol=1e-6)

    def test_pictures_that_were_moved(self, project):
        (project / "jpeg-exports").rename(project / "moved")
        assert load(project).image_names == tuple(NAMES)
        for j, name in enumerate(NAMES):
            write_picture(project / "others" / name, samples(j))
        assert "moved, others" in refusal(load, project)


class TestRing:
    def test_lamps_at_equal_steps(self, tmp_path):
        folder = write_folder(tmp_path / "cloth")
        (folder / "light_directions.txt").unlink()
        up = np.sin(np.radians(40)), np.cos(np.radians(40))
        right, top = [up[1], 0, up[0]], [0, up[1], up[0]]
        left, bottom = [-up[1], 0, up[0]], [0, -up[1], up[0]]
        for options, expected in (
            ({}, [right, top, left, bottom]),
            ({"clockwise": True}, [right, bottom, left, top]),
            ({"start": 90}, [top, left, bottom, right]),
            ({"frame": "directx"}, [right, top, left, bottom]),
        ):
            capture = load(folder, ring=4, elevation=40, **options)
            np.testing.assert_allclose(capture.known_lights(), expected, atol=1e-9)

    def test_what_is_missing_is_told(self, tmp_path):
        folder = write_folder(tmp_path)
        assert "--elevation" in refusal(load, folder, ring=4)
        assert "--elevation 90" in refusal(load, folder, ring=4, elevation=90)
        assert "4 pictures but 8 light directions" in refusal(load, folder, ring=8, elevation=40)
        assert "--ring" in refusal(load, folder, elevation=40)
        assert "one of them" in refusal(load, folder, ring=4, elevation=40, lights=folder / "light_directions.txt")
