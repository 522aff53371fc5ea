"""What a training is launched on."""

import pytest

from photonormal.train.launch import launched

pytest.importorskip("lightning_fabric")


def test_lightning_prints_nothing_of_its_own(capfd):
    launched("cpu", "bf16")
    assert capfd.readouterr() == ("", "")
