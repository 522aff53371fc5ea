"""The training renderer against the path tracer, on the same scenes.

The path tracer has the whole solid, with what the camera can't see, exact geometry terms and any number of directions;
the training renderer has three heights a pixel. Where their images differ is what that costs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from photonormal.geometry import angle_deg, fibonacci_cap
from photonormal.synth.library import FAMILIES
from photonormal.synth.materials import Coats, dress
from photonormal.synth.params import rng, tensor
from photonormal.synth.pathtraced import tracer
from photonormal.synth.pathtraced.meshes import Triangles, polygonise
from photonormal.synth.pathtraced.reflectance import ATTRIBUTES, bsdf, diffuse
from photonormal.synth.pathtraced.tracer import OrthographicCamera, eroded
from photonormal.synth.recipes import Rendering, recipe
from photonormal.synth.scene import Scenes, draw_scenes, frame, heights, shaded
from photonormal.synth.sculptor import KINDS
from photonormal.synth.shadows import distant
from photonormal.synth.trace import NOWHERE, Geometry, surface_gradient, visible_surface

REACH = 1.7  # half side of the cube that holds a drawn solid
LOWEST_DEG = 15.0  # elevation of a light


@dataclass(frozen=True)
class BothRenderings:
    """Both renderers' images of one scene, direct light and with bounces, (n, s, s, 3), and where lights arrive.

    Both see the path tracer's triangles. Of a drawn solid there are the training renderer's own normals, too, marched
    to on the implicit surface, and its images of them: they differ by the triangles' error and by its own.
    """

    name: str
    lights: Float[np.ndarray, "n 3"]
    mask: Bool[np.ndarray, "s s"]
    direct: tuple[np.ndarray, np.ndarray]  # of the training renderer, of the path tracer
    bounced: tuple[np.ndarray, np.ndarray]
    reached: tuple[np.ndarray, np.ndarray]  # (n, s, s) bool
    normals: tuple[np.ndarray, np.ndarray]
    marched: np.ndarray | None = None  # direct light on the training renderer's own surface

    def direct_percent(self) -> float:
        """Mean over images of the mean error over the mean value, on the pixels that light reaches."""
        return self._percent(self.direct)

    def marched_percent(self) -> float:
        """As `direct_percent`, of the training renderer's own surface."""
        return float("nan") if self.marched is None else self._percent((self.marched, self.direct[1]))

    def bounced_percent(self) -> float:
        """As `direct_percent`, of light that came straight or by other places."""
        return self._percent(self.bounced)

    def indirect_ratio(self) -> float:
        """Light that surfaces sent each other, on the whole object: ours over the path tracer's."""
        ours, theirs = (
            (whole - direct)[:, self.mask].sum() for whole, direct in zip(self.bounced, self.direct, strict=True)
        )
        return float(ours / theirs) if theirs > 0 else float("nan")

    def shadows_percent(self) -> float:
        """Share of pixels, at least one away from a shadow's or the object's edge, on whose shadow both agree."""
        ours, theirs = self.reached
        inside = eroded(self.mask)
        sure = (eroded(theirs) | eroded(~theirs & self.mask)) & inside
        return float(100 * (ours == theirs)[sure].mean())

    def normals_deg(self) -> float:
        """Mean angle between the two normal maps."""
        return float(angle_deg(*(n[self.mask] for n in self.normals)).mean())

    def _percent(self, images: tuple[np.ndarray, np.ndarray]) -> float:
        ours, theirs = images
        errors = []
        for a, b, lit in zip(ours, theirs, self.reached[1] & self.reached[0] & self.mask, strict=True):
            if lit.any():
                errors.append(np.abs(a[lit] - b[lit]).sum() / b[lit].sum())
        return float(100 * np.mean(errors))


def plain(**changes: Any) -> Rendering:
    """The training recipe without a sensor's and a set-up's errors, whole objects only, principled materials."""
    clean = {
        "zoom": 0.0, "ambient": 0.0, "saturated": 0.0, "noise": 0.0, "low_bits": 0.0, "intensity_error": 0.0,
        "light_error_deg": 0.0, "corrupted": 0.0, "bounce": 1.0, "smooth_edges": False, "blurred": 0.0,
        "materials": tuple(float(family == "principled") for family in FAMILIES),
    }  # fmt: skip
    return recipe("train", **{**clean, **changes})


def compare(
    kind: str | Triangles,
    seed: int = 0,
    material: np.ndarray | None = None,
    stock: Any = None,
    n: int = 8,
    size: int = 128,
    samples: int = 64,
    cells: int = 256,
    detail: float = 1.0,
    name: str | None = None,
    bounces: int = 1,
) -> BothRenderings:
    """Render one scene with both.

    Parameters
    ----------
    kind : one of KINDS, drawn with `seed`, or a mesh about one unit in radius
    material : eleven principled parameters, or three albedos; None: drawn, varying over the surface
    stock : a material of Mitsuba's own to put in the place of the same formula
    n, size, samples, cells : lights, pixels a side, paths a pixel, cells a side of the grid around a drawn solid
    detail : scale of a drawn solid's relief; 0: smooth
    bounces : how often light may pass between surfaces in the path tracer
    """
    shapes = tuple(float(k == kind) for k in KINDS) if isinstance(kind, str) else Rendering.shapes
    made = plain(shapes=shapes, varying=1.0, detail=detail, bounces=max(1, bounces))
    L = fibonacci_cap(n, LOWEST_DEG)
    scenes = draw_scenes(made, rng(seed, 9), 1, n, None)
    scenes = replace(
        scenes, lights=tensor(L)[None], coats=scenes.coats if material is None else plain_coats(scenes.coats, material)
    )
    own = None
    if isinstance(kind, Triangles):
        camera, mesh = OrthographicCamera(half=1.1, size=size), kind
    else:
        view, start = frame(scenes, size)
        own = visible_surface(scenes.solids, view, start)
        (x, y), half = view.centre[0].tolist(), float(view.half)
        camera, mesh = OrthographicCamera(x, y, half, size), solid(scenes.solids, cells)
    if stock is None:
        matt = material is not None and len(material) == 3
        stock = diffuse(material) if matt else bsdf("principled", material)
    scene = tracer.build([dressed(mesh, scenes.coats, material).shape(stock)], camera)
    seen = tracer.look(scene, camera)
    geometry = geometry_of(seen, tracer.behind(scene, camera), camera)
    straight = replace(scenes, bounce=torch.tensor([False]))
    mask = seen.mask if own is None else seen.mask & own.mask[0].numpy()
    facing = np.einsum("hwc,nc->nhw", seen.normals, L) > 0
    pixels = torch.arange(size * size, dtype=torch.int32)[None]
    visible = distant(heights(geometry), scenes.lights, pixels, geometry.normals.flatten(2))
    return BothRenderings(
        name or (kind if isinstance(kind, str) else "mesh"),
        L,
        mask,
        (_render(straight, geometry, made), tracer.trace(scene, camera, L, 1, 0, centred=True)),
        (
            _render(replace(scenes, bounce=torch.tensor([True])), geometry, made),
            tracer.trace(scene, camera, L, samples, bounces, centred=True),
        ),
        ((visible[0].view(n, size, size).numpy() > 0.5) & facing & mask, tracer.reached(scene, camera, L) & mask),
        (seen.normals if own is None else own.normals[0].permute(1, 2, 0).numpy(), seen.normals),
        None if own is None else _render(straight, own, made),
    )


def _render(scenes: Scenes, geometry: Geometry, made: Rendering) -> Float[np.ndarray, "n s s 3"]:
    s = geometry.mask.shape[-1]
    pixels = torch.arange(s * s)[None]
    I = shaded(scenes, geometry, pixels, made, None, 0)[0]  # (n, 3, s s)
    return I.view(-1, 3, s, s).permute(0, 2, 3, 1).numpy()


def solid(field: Any, cells: int) -> Triangles:
    """All of an implicit solid (a batch of one) as triangles, with its exact normals at their corners."""
    field = field.trimmed()

    def apart(f: Any, p: Tensor) -> Tensor:
        return torch.cat([f(part.T[None])[0] for part in p.split(2**17)], -1)

    def values(p: np.ndarray) -> np.ndarray:
        return apart(field, torch.from_numpy(np.ascontiguousarray(p, np.float32))).numpy()

    mesh = polygonise(values, REACH, cells)
    p = torch.from_numpy(mesh.vertices.astype(np.float32))
    step = float(np.linalg.norm(np.diff(mesh.vertices[mesh.faces[:1, :2]][0], axis=0)))
    inner = p.abs().amax(-1) < REACH * 0.97  # not where the cube cuts the solid
    for _ in range(2):  # onto the surface
        g = apart(lambda q: surface_gradient(field, q), p).T  # (v, 3)
        d = apart(field, p) / g.square().sum(-1).clamp(min=0.05)
        p = p - (d.clamp(-step, step) * inner)[:, None] * g
    g = apart(lambda q: surface_gradient(field, q), p).T
    normals = (g / g.norm(dim=-1, keepdim=True).clamp(min=1e-9)).double().numpy()
    moved = Triangles(p.double().numpy(), mesh.faces)
    return replace(moved, normals=np.where(inner.numpy()[:, None], normals, moved.smooth_normals()))


def dressed(mesh: Triangles, coats: Coats, material: np.ndarray | None) -> Triangles:
    """The mesh with the drawn principled parameters at its vertices, where the material isn't one for all."""
    if material is not None:
        return mesh
    values: Tensor = dress(coats, tensor(mesh.vertices.T.copy())[None], None)[0].f.values[0, 0]  # type: ignore[attr-defined]
    table = np.zeros((len(mesh.vertices), 12))
    table[:, :11] = values.T.numpy()
    return replace(mesh, attributes={a: table[:, 3 * i : 3 * i + 3] for i, a in enumerate(ATTRIBUTES)})


def plain_coats(coats: Coats, material: np.ndarray) -> Coats:
    """Coats of one material everywhere: eleven principled parameters, or the three albedos of a Lambertian surface."""
    family = FAMILIES.index("lambert" if len(material) == 3 else "principled")
    palette = np.zeros(coats.palette.shape[-1])
    palette[: len(material)] = material
    return replace(
        coats,
        family=torch.full_like(coats.family, family),
        palette=tensor(palette).expand_as(coats.palette).clone(),
        pattern=torch.zeros_like(coats.pattern),
        contrast=torch.zeros_like(coats.contrast),
    )


def geometry_of(seen: tracer.CameraHits, behind: Float[np.ndarray, "2 s s"], camera: OrthographicCamera) -> Geometry:
    """What the path tracer sees of a mesh, and what is behind, as the training renderer's heights."""
    z = torch.from_numpy(np.where(seen.mask, seen.points[..., 2] / camera.pixel, 0))
    below = torch.from_numpy(behind / camera.pixel)[None].float().clamp(min=NOWHERE)

    def image(values: np.ndarray) -> Tensor:
        return torch.from_numpy(values).permute(2, 0, 1)[None].float()

    return Geometry(z[None].float(), image(seen.normals), torch.from_numpy(seen.mask)[None], image(seen.points), below)
