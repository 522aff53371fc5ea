"""Surfaces like CyclesPS' (S. Ikehata, ECCV 2018): about a hundred cells, each of its own colour and gloss.

The material is Mitsuba's own `principled`, another one than the family that training draws from.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from photonormal.synth.pathtraced.meshes import Triangles

KINDS = ("diffuse", "specular", "metallic")
CELLS = 100
ETA = {"diffuse": 1.4, "specular": 1.8, "metallic": 1.5}  # CyclesPS: 2 / (1 - sqrt(0.08 specular)) - 1
NUMBERS = ("roughness", "metallic", "spec_tint", "sheen", "sheen_tint")


def kind_of_material(kind: str) -> dict[str, Any]:
    """A principled material whose numbers come from the faces' attributes."""
    numbers = {name: {"type": "mesh_attribute", "name": f"face_{name}"} for name in NUMBERS}
    colour = {"type": "mesh_attribute", "name": "face_base"}
    return {"type": "principled", "base_color": colour, "eta": ETA[kind], **numbers}


def cells(mesh: Triangles, kind: str, seed: int) -> Triangles:
    """The mesh with the numbers of a kind of material in each face's cell: the nearest of CELLS random places."""
    from scipy.spatial import KDTree

    g = np.random.default_rng(seed)
    seeds = mesh.vertices[g.choice(len(mesh.vertices), CELLS)]
    _, cell = KDTree(seeds).query(mesh.centres())
    low, high = {"diffuse": (0.5, 1.0), "specular": (0.15, 0.5), "metallic": (0.3, 0.7)}[kind]
    table = {
        "base": g.uniform(0.05, 0.95, (CELLS, 3)),
        "roughness": g.uniform(low, high, (CELLS, 1)),
        "metallic": np.full((CELLS, 1), float(kind == "metallic")),
        "spec_tint": g.uniform(0, 1, (CELLS, 1)),
        "sheen": g.uniform(0, 1, (CELLS, 1)) * (kind == "diffuse"),
        "sheen_tint": g.uniform(0, 1, (CELLS, 1)),
    }
    return replace(mesh, attributes={f"face_{name}": values[cell] for name, values in table.items()})
