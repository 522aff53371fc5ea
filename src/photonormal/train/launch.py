"""What a training computes in, and with which devices and processes: Lightning Fabric's."""

from __future__ import annotations

import logging
import os
import warnings
from typing import Any

from photonormal.methods.engine.device import torch_device
from photonormal.methods.learned.processor import computing_in, number_format
from photonormal.options import Precision
from photonormal.train import checkpoint
from photonormal.types import InputError


def agreed(asked: Precision, state: checkpoint.TrainingState | None, device: str) -> Precision:
    """The number format of a training: its checkpoint's, or the one asked for."""
    with computing_in(asked):
        found = number_format(torch_device(device))
    kept = state.get("precision") if state else None
    if kept is None or kept == found:
        return found
    if asked != "auto":
        raise InputError(f"--precision {asked} came but this training computes in {kept}; leave it out to go on.")
    return kept


def launched(device: str, precision: Precision, changing: bool = False) -> Any:
    """Fabric on one device, or on torchrun's processes, with `precision` inside the network.

    `changing` where not every step uses all parts of the network.
    """
    try:
        from lightning_fabric import Fabric
    except ImportError:
        try:
            from lightning.fabric import Fabric  # type: ignore[import-not-found]
        except ImportError:
            raise InputError("training needs Lightning Fabric; install it: pip install 'photonormal[train]'.") from None
    logging.getLogger(Fabric.__module__.rpartition(".")[0]).setLevel(logging.WARNING)  # it prints its precision
    kind = torch_device(device).type
    processes = int(os.environ.get("LOCAL_WORLD_SIZE", 1))
    nodes = int(os.environ.get("WORLD_SIZE", processes)) // processes
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The `srun` command is available")  # torchrun starts processes, too
        fabric = Fabric(
            accelerator=kind,
            devices=processes,
            num_nodes=nodes,
            strategy=("ddp_find_unused_parameters_true" if changing else "ddp") if processes * nodes > 1 else "auto",
            precision="bf16-mixed" if precision == "bf16" else "32-true",
        )
    fabric.launch()
    return fabric
