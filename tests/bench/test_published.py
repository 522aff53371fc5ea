"""The published figures: each row's average fits its entries, or a remark says why not."""

import pytest

from photonormal.bench.benchmarks import DILIGENT
from photonormal.bench.published import of_method, others, published
from photonormal.methods import METHODS


def of(method: str, images: int = 96, protocol: str = "all"):
    return of_method(method, "diligent", images, protocol)[0]


@pytest.mark.parametrize("row", published(), ids=lambda r: f"{r.table}-{r.name}")
def test_averages_fit_their_entries_or_a_remark_says_why_not(row):
    entries = [row.values[o] for o in DILIGENT if o in row.values]
    if len(entries) < 9 or "average" not in row.values:
        return
    bears = [row.values[b] for b in ("bear", "bear76") if b in row.values]
    rest = sum(v for o, v in row.values.items() if o in DILIGENT and o != "bear")
    fits = [abs((rest + b) / 10 - row.values["average"]) < 0.03 for b in bears]
    assert any(fits) or row.remark


def test_well_known_figures():
    assert of("woodham").values["average"] == 15.39
    assert of("lambertian-prior").values["reading"] == 11.01
    assert of("woodham", 10, "psfcn").values["average"] == 17.31
    assert of("woodham", 10, "draws").values == {"average": 16.10}


def test_known_slips_are_remarked():
    remarks = {(r.table, r.name.split(" [")[0]): r.remark for r in published()}
    assert "10.56" in remarks["paper-10", "PS-FCN"]
    assert "9.90" in remarks["paper-10", "the paper, trained with 64 images"]
    assert "8.30" in remarks["paper-96", "CNN-PS"]
    assert "94.77" in remarks["paper-blocks", "single branch"]


def test_an_average_is_over_the_same_objects():
    row = of("woodham")
    assert row.value("average", list(DILIGENT)) == 15.39
    assert row.value("average", ["ball", "bear"]) == pytest.approx((4.10 + 8.39) / 2)
    assert row.value("average", ["ball", "horse"]) is None
    assert of("woodham", 10, "draws").value("average", ["ball"]) is None  # printed over ten only


def test_others_are_named_once():
    names = [r.name.split(" [")[0].rstrip("†") for r in others("diligent", 96)]
    assert len(names) == len(set(names)) > 30 and {"MT-PS-CNN", "PX-Net", "Manifold-PSN"} <= set(names)


def test_rows_are_of_methods_that_exist_or_will():
    assert {r.method for r in published()} - {""} <= set(METHODS)
