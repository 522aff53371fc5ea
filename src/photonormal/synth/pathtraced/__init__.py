"""An independent path tracer, Mitsuba 3: what the training renderer is checked against, and the source of test scenes.

Nothing here shares code with the training renderer but `compare`, which runs both. Nothing heavy is imported before it
is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_WHERE = {
    "SCENE_SETS": "photonormal.synth.pathtraced.sets",
    "SceneSet": "photonormal.synth.pathtraced.sets",
    "render_scene_set": "photonormal.synth.pathtraced.sets",
}
__all__ = ["SCENE_SETS", "SceneSet", "render_scene_set"]


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_WHERE[name]), name)
