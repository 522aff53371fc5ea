"""Blocks worked on side by side."""

import torch

from photonormal.methods.inputs.workers import side_by_side
from photonormal.methods.learned.processor import computing_in, number_format

CPU = torch.device("cpu")


def test_results_come_in_order_of_the_parts():
    assert side_by_side(lambda k: k * k, range(50), CPU) == [k * k for k in range(50)]


def test_each_part_has_one_core_and_all_are_back_afterwards():
    before = torch.get_num_threads()
    torch.set_num_threads(3)
    try:
        assert side_by_side(lambda _: torch.get_num_threads(), range(9), CPU) == [1] * 9
        assert torch.get_num_threads() == 3
    finally:
        torch.set_num_threads(before)


def test_each_part_computes_in_what_was_asked_for():
    with computing_in("bf16"):
        assert side_by_side(lambda _: number_format(CPU), range(4), CPU) == ["bf16"] * 4


def test_gradients_are_off_where_they_are_off_outside():
    def recorded(_: int) -> bool:
        return not torch.is_inference_mode_enabled()

    assert all(side_by_side(recorded, range(4), CPU))
    with torch.inference_mode():
        assert not any(side_by_side(recorded, range(4), CPU))
