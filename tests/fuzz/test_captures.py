"""A malformed capture ends in a result or in one line, whatever is wrong with it."""

import sys

import pytest

from tests.fuzz.captures import faults, with_out
from tests.fuzz.drive import Driver
from tests.fuzz.kinds import KINDS

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver reads /proc")


@pytest.fixture(scope="module")
def driver():
    with Driver() as started:
        yield started


def test_sound_captures_of_every_kind_are_measured(tmp_path, driver):
    driver.ends.clear()
    for kind, write in KINDS.items():
        folder = tmp_path / kind / "capture"
        folder.mkdir(parents=True)
        assert driver.faults(folder, *with_out(write(folder), folder.parent)) == [], kind
    assert driver.ends == {"done": len(KINDS)}


def test_malformed_captures_of_every_kind(driver):
    assert [fault for seed in range(len(KINDS)) for fault in faults(driver, seed)] == []
