"""Some changed stored files; `make fuzz` tries 2,000."""

import sys

import pytest

from tests.fuzz.drive import Driver
from tests.fuzz.stored_files import KINDS, faults, originals

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the driver reads /proc")


def test_changed_files_are_read_or_refused_in_one_line(tmp_path):
    originals(tmp_path)
    with Driver("tests.fuzz.stored_files:command") as driver:
        assert [fault for seed in range(3 * len(KINDS)) for fault in faults(driver, tmp_path, seed)] == []
    assert set(driver.ends) == {"done", "refused in one line"}
