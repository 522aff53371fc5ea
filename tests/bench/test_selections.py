"""Draws that are the same in every run and on every machine."""

from pathlib import Path

import numpy as np
import pytest

from photonormal.bench.benchmarks import Item
from photonormal.bench.selections import Plan, draw, psfcn_draw, read_fixed
from photonormal.types import InputError


def item(name: str, index: int = 0) -> Item:
    return Item("diligent", name, index, Path(name), "diligent")


def test_the_draw_of_ps_fcn_s_code_is_its_own():
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    theirs = np.random.permutation(96)[:10]  # noqa: NPY002
    np.random.set_state(state)  # noqa: NPY002
    assert psfcn_draw(3, 96, 10) == tuple(sorted(int(j) for j in theirs))


def test_draws_differ_by_number_and_object_and_repeat():
    assert draw(0, 0, 96, 10) == draw(0, 0, 96, 10)
    assert len({draw(i, d, 96, 10) for i in range(10) for d in range(10)}) == 100
    assert all(len(set(draw(0, d, 96, 10))) == 10 for d in range(10))


def test_every_image_is_drawn_about_equally_often():
    counts = np.bincount([j for d in range(960) for j in draw(0, d, 96, 10)], minlength=96)
    assert abs(counts.mean() - 100) < 1e-9 and counts.std() < 15


def test_only_bear_has_pictures_to_leave_out():
    plan = Plan.parse("96", 5, ())
    assert [s.name for s in plan.of(item("bear"), 96)] == ["", "21-96"]
    assert [s.name for s in plan.of(item("ball"), 96)] == [""]


def test_counts_below_all_are_drawn():
    names = [s.name for s in Plan.parse("10, all", 2, ()).of(item("ball"), 96)]
    assert names == ["10-000", "10-001", "10-psfcn", ""]


@pytest.mark.parametrize("text", ["", "ball: ", "1-3\n4-6", "a: 1-3\na: 4-6"])
def test_unclear_files_are_refused(tmp_path, text):
    (tmp_path / "f.txt").write_text(text)
    with pytest.raises(InputError, match=r"f\.txt"):
        read_fixed(tmp_path / "f.txt")


def test_nothing_of_a_file_that_without_numbers_is_told(tmp_path):
    (tmp_path / "shadow").write_text("1-3\nroot:$6$abc:20228:0:99999:7::\nuser: secret\n")
    with pytest.raises(InputError, match=r"shadow, line 2: one line like") as told:
        read_fixed(tmp_path / "shadow")
    assert "$6$" not in str(told.value) and "20228" not in str(told.value)
