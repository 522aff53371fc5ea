"""Disks that are mounted: where only root may, and not everywhere."""

import os
import subprocess

import pytest

from photonormal.export.folder import report, whole_folder
from photonormal.types import InputError
from tests.disk.test_batch import content, place


@pytest.fixture
def mounted(tmp_path):
    """Mounts small disks, and takes them away again."""
    there = []

    def mount(name, *options):
        (tmp_path / name).mkdir(parents=True, exist_ok=True)
        if subprocess.run(["mount", "-t", "tmpfs", *options, "tmpfs", tmp_path / name], capture_output=True).returncode:
            pytest.skip("only root mounts, and not everywhere")
        there.append(tmp_path / name)
        return tmp_path / name

    if os.name == "nt":
        pytest.skip("there is no mount")
    yield mount
    for path in reversed(there):
        subprocess.run(["umount", path], check=True)


def result(out, text, **how):
    with whole_folder(out, **how) as batch:
        batch.write("normals.png", text)
        report(batch, {})


def test_a_mount_point_with_an_older_result_and_a_disk_mounted_in_it(mounted):
    out = mounted("out")
    result(out, b"old")
    place(out, {"letter.txt": "mine"})
    inner = mounted("out/private")
    place(inner, {"letter.txt": "mine, too"})
    result(out, b"new")
    found = content(out)
    found.pop("report.json")
    assert found == {"normals.png": "new", "letter.txt": "mine", "private/letter.txt": "mine, too"}


def test_a_full_disk_leaves_the_older_result(mounted):
    out = mounted("out", "-o", "size=100k")
    result(out, b"old")
    before = content(out)
    with pytest.raises(InputError, match=r"no space is left.*Nothing was changed\.$"):
        result(out, bytes(200_000))
    assert content(out) == before
