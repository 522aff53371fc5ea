"""Rendered captures with exact normals, for training and testing: shapes, materials, shadows and inter-reflections.

Nothing heavy is imported before it is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from photonormal.synth.output import render
    from photonormal.synth.recipes import RECIPES, Rendering, recipe
    from photonormal.synth.stream import RenderedBatch, Stream

_WHERE = {
    "RenderedBatch": "photonormal.synth.stream",
    "Stream": "photonormal.synth.stream",
    "RECIPES": "photonormal.synth.recipes",
    "Rendering": "photonormal.synth.recipes",
    "recipe": "photonormal.synth.recipes",
    "render": "photonormal.synth.output",
}
__all__ = ["RECIPES", "RenderedBatch", "Rendering", "Stream", "recipe", "render"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), name)
