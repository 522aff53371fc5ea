"""The values that pass between stages, and the only checks of them.

Frame, everywhere: x right, y up, z towards the camera; orthographic view v = (0, 0, 1). Light directions point from the
surface to the light. Images are linear radiance divided by the intensity of the light, per channel. Row 0 of an array
is the top of the picture, so y runs against the row index. Positions are in millimetres, `_mm` in the name; their
origin is the camera in a perspective view, else the middle of the picture at the object's mean depth.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from photonormal.arrays import UNITS as UNITS
from photonormal.arrays import as_array, as_images, as_mask, unit_of
from photonormal.errors import InputError as InputError
from photonormal.errors import MachineLimit as MachineLimit
from photonormal.errors import a_few as a_few
from photonormal.errors import by_name as by_name
from photonormal.errors import code_of_others as code_of_others
from photonormal.errors import in_pixels as in_pixels
from photonormal.errors import no_such as no_such
from photonormal.errors import printable as printable
from photonormal.lamps import Camera as Camera
from photonormal.lamps import Lamps as Lamps
from photonormal.lamps import from_the_middle
from photonormal.lamps import lights_behind as lights_behind
from photonormal.lamps import unit_lights as unit_lights
from photonormal.lazy import Image as Image
from photonormal.lazy import Images as Images
from photonormal.lazy import LightsAt as LightsAt
from photonormal.lazy import saturated_in as saturated_in
from photonormal.lazy import window_of as window_of
from photonormal.masked import picked
from photonormal.notebook import capture_png, normals_png, surface_png
from photonormal.resources import cores, in_threads

if TYPE_CHECKING:
    from photonormal.crop import Crop

Lights = Float[np.ndarray, "n 3"]  # unit vectors, from the surface to the light
Mask = Bool[np.ndarray, "h w"]  # True on the object

T = TypeVar("T")


@dataclass(frozen=True)
class Capture:
    """One view of an object under `n` lights: distant ones, or `lamps` near it.

    Parameters
    ----------
    images : (n, h, w, c), c is 1 or 3, or (n, h, w); an array or a list of pictures, of floats, or of uint8 or uint16,
        which are linear and become 1 at full scale; or an object that decodes the pictures one by one. Floats of an
        array whose brightest sample is above 1e12 or below 1e-6 are divided by it; an object's above 1e12 are refused
        when they are measured
    mask : (h, w) bool, True on the object; of numbers, what is more than half of the largest. None: all pixels
    lights : (n, 3), any length but zero; kept as unit vectors. None: unknown. Of `lamps`, as seen from the object's
        middle, whatever is given
    truth : the true normals, or their map, where they are known
    saturation : (n, c) radiance at which a sample of each image is saturated. None: not known
    name : what reports call the capture
    image_names : the n pictures' names
    lamps : where the lights are, if they are near; needs `camera`
    camera : what a pixel is in millimetres
    lights_at : (p, n, 3) float32, unit vectors to the lights from each of the mask's p pixels, where they differ, or
        what gives those of some pixels when asked (``lights_at[a:b]``); then the images hold no fall-off
        (`photonormal.methods.engine.near` makes such captures)
    crop : which part of the photographs it shows, reduced; None: all of them
    notes : what was assumed when it was read, and the user should know, a sentence each
    encoding : how the files' samples were taken and what says so, such as "sRGB (Exif)"; `linearised` where they were
        not linear; `likely_encoded` where they were taken for linear, as JPEG files that don't say it seldom are

    Raises
    ------
    InputError
        If sizes disagree, fewer than three images came, the mask is empty, a light is zero, not finite, or the lights
        do not span three dimensions; if a lamp is inside the object, or there is no camera to place it.
    """

    images: Images
    mask: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    lights: np.ndarray | None = None
    truth: Normals | None = None
    saturation: np.ndarray | None = field(default=None, repr=False)
    name: str = "capture"
    image_names: tuple[str, ...] = field(default=(), repr=False)
    lamps: Lamps | None = None
    camera: Camera | None = None
    lights_at: LightsAt | None = field(default=None, repr=False)
    crop: Crop | None = None
    notes: tuple[str, ...] = field(default=(), repr=False)
    encoding: str = field(default="", repr=False)
    linearised: bool = field(default=False, repr=False)
    likely_encoded: bool = field(default=False, repr=False)

    def __post_init__(self) -> None:
        keep = partial(object.__setattr__, self)
        given = np.shape(self.images) if isinstance(self.images, np.ndarray) else ()
        images, unknown = as_images(self.images)
        keep("images", images)
        shape = tuple(self.images.shape)
        if len(shape) != 4 or shape[3] not in (1, 3):
            raise InputError(f"images are {shape} but (n, h, w, 1 or 3) is needed; stack pictures of one size.")
        n, h, w, _ = shape
        if n < 3:
            raise InputError(f"{n} images came but normals need at least 3 under different lights; add photographs.")
        if self.lights is not None and len(given) == 3 and given[0] != len(self.lights) == given[2]:
            raise InputError(
                f"images are {given} for {given[2]} lights but the pictures come first, (n, h, w); give "
                "numpy.moveaxis(images, -1, 0)."
            )
        keep("mask", as_mask(self.mask, (h, w)))
        if self.truth is not None:
            keep("truth", as_normals(self.truth, "true normals"))
        if self.mask.shape != (h, w) or self.mask.dtype != bool:
            raise InputError(
                f"mask is {self.mask.shape} {self.mask.dtype} but images are {(h, w)}; "
                "give a bool mask of the pictures' own size."
            )
        if unknown is not None and (unknown := unknown & self.mask).any():
            note = (
                f"of {int(unknown.sum())} pixels inside the mask some samples are NaN, which are taken as black, or "
                "infinite, which are taken as the brightest; leave these pixels out of the mask."
            )
            keep("notes", (*self.notes, note))
        if not self.mask.any():
            raise InputError("the mask is empty but at least one pixel must be on the object; white marks the object.")
        if (unit := unit_of(images, self.mask)) != 1:
            with np.errstate(over="ignore"):  # beside the object
                keep("images", images / np.float32(unit))
            if self.saturation is not None:
                keep("saturation", self.saturation / unit)
            note = f"the brightest sample is {unit:.3g}; all were divided by that, and the albedo is in this unit."
            keep("notes", (*self.notes, note))
        if not self.image_names:
            keep("image_names", tuple(f"image {j + 1}" for j in range(n)))
        if len(self.image_names) != n:
            raise InputError(f"{len(self.image_names)} names came for {n} images; give one for each or none.")
        if self.lamps is not None:
            middle = from_the_middle(self.lamps, self.camera, self.mask, self.image_names)
            keep("lights", middle)
        if self.lights is not None:
            keep("lights", unit_lights(self.lights, self.image_names))
        if self.truth is not None and self.truth.map.shape != (h, w, 3):
            raise InputError(
                f"true normals are {self.truth.map.shape} but images are {(h, w)}; crop both with the same box."
            )

    def __repr__(self) -> str:
        n, h, w, c = self.images.shape
        known = [name for name in ("lights", "lamps", "camera", "truth") if getattr(self, name) is not None]
        return (
            f"Capture({self.name!r}: {n} photographs of {h} x {w} x {c}, {int(self.mask.sum())} pixels on the mask, "
            f"with {', '.join(known) or 'nothing else'})"
        )

    def _repr_png_(self) -> bytes:
        return capture_png(self.images)

    def known_lights(self) -> Lights:
        """The light directions (n, 3), or an error that says that they are missing."""
        if self.lights is None:
            raise InputError(
                f"{self.name} has no light directions but this method needs them; add light_directions.txt or an .lp."
            )
        return self.lights

    def window(self, j: int, rows: slice, columns: slice) -> Image:
        """A part of image `j`, as `window_of` reads it."""
        return window_of(self.images, j, rows, columns)

    def saturated(self, j: int, rows: slice, columns: slice, shown: Image) -> Bool[np.ndarray, "h w c"]:
        """Where a part of image `j`, which is `shown`, is saturated; nowhere if that is not known."""
        told = saturated_in(self.images, j, rows, columns)
        if told is not None:
            return told
        # the division by the light's intensity rounds: a saturated sample may fall short by the last bits
        return shown >= (np.inf if self.saturation is None else self.saturation[j] * (1 - 1e-5))

    def samples(self, rows: slice, columns: slice, on: Mask) -> Float[np.ndarray, "p n c"]:
        """What all images show of the pixels `on` of a window, float32."""
        n, _, _, c = self.images.shape
        shown = np.empty((int(on.sum()), n, c), np.float32)

        def read(j: int) -> None:
            shown[:, j] = picked(self.window(j, rows, columns), on)

        self.each_image(read)
        return shown

    def each_image(self, f: Callable[[int], T]) -> list[T]:
        """``f(j)`` of every image, in order; by as many threads as there are cores."""
        return in_threads(f, range(self.images.shape[0]), cores())

    def map_images(self, f: Callable[[int, Image], T]) -> list[T]:
        """``f(j, image)`` of every image, in order; decoded by as many threads as there are cores."""
        return self.each_image(lambda j: f(j, self.images[j]))


@dataclass(frozen=True)
class Normals:
    """Surface normals of one view.

    Parameters
    ----------
    map : (h, w, 3) float32, unit inside `mask`, zero outside; kept as it is where it is so, else a copy
    mask : (h, w) bool, True where there is a normal; pixels that no light reached are not in it. None: where the map is
        neither zero nor NaN
    expected_error_deg : (h, w) float32, how far each normal is expected to be off, in degrees; NaN outside `mask`. None
        where the method does not estimate it
    """

    map: np.ndarray
    mask: np.ndarray = None  # pyright: ignore[reportAssignmentType]
    expected_error_deg: np.ndarray | None = None

    def __post_init__(self) -> None:
        keep = partial(object.__setattr__, self)
        keep("map", as_array(self.map, "the normals"))
        if self.mask is None:
            nonzero = np.isfinite(self.map) & (self.map != 0)
            keep("mask", nonzero.any(-1) if self.map.ndim == 3 else np.ones((), bool))
        if self.map.shape != (*self.mask.shape, 3) or self.mask.dtype != bool:
            raise InputError(
                f"normals are {self.map.shape} and their mask {self.mask.shape} {self.mask.dtype} "
                "but (h, w, 3) and (h, w) bool are needed; give maps of one size."
            )
        kept, wrong, beside = self.map, 0, False
        for rows in _parts(self.mask):
            part, inside = kept[rows], self.mask[rows]
            length = np.sqrt(np.einsum("hwk,hwk->hw", part, part))
            wrong += np.count_nonzero(inside & ~(np.abs(length - 1) < 1e-3))  # also catches NaN
            beside |= bool(length[~inside].any())
        if kept.dtype != np.float32 or beside:
            kept = np.where(self.mask[..., None], kept, 0).astype(np.float32)
        if wrong:
            raise InputError(
                f"{wrong} normals inside the mask are not unit vectors; "
                "normalise them or leave those pixels out of the mask."
            )
        keep("map", kept)
        expected = self.expected_error_deg
        if expected is not None:
            if expected.shape != self.mask.shape:
                raise InputError(f"expected errors are {expected.shape} but normals {self.map.shape}; give one each.")
            kept = expected.astype(np.float32)
            kept[~self.mask] = np.nan
            keep("expected_error_deg", kept)

    def __repr__(self) -> str:
        h, w = self.mask.shape
        e = self.expected_error_deg
        off = "" if e is None or not self.mask.any() else f", expected to be off by {np.nanmean(e):.1f} degrees"
        return f"Normals({h} x {w}, {int(self.mask.sum())} pixels on the mask{off})"

    def _repr_png_(self) -> bytes:
        return normals_png(self.map, self.mask)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return _array(self.map, dtype, copy)


@dataclass(frozen=True)
class Surface:
    """Depth of one view.

    Parameters
    ----------
    depth : (h, w) float, single precision from `photonormal.integrate`, NaN outside `mask`. Orthographic (`K` None):
        height towards the camera in pixels, up to one constant per connected part. Perspective: distance along the
        optical axis, in units of its mean
    mask : (h, w) bool
    K : (3, 3) camera matrix in pixels (x right, y down) of a perspective view, or None
    """

    depth: np.ndarray
    mask: np.ndarray
    K: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.depth.shape != self.mask.shape or self.mask.dtype != bool:
            raise InputError(
                f"depth is {self.depth.shape} and its mask {self.mask.shape} {self.mask.dtype} but one size and a bool "
                "mask are needed; crop both with the same box."
            )
        if self.K is not None and self.K.shape != (3, 3):
            raise InputError(f"the camera matrix is {self.K.shape} but (3, 3) is needed; give K alone.")

    def heights_px(self) -> Float[np.ndarray, "h w"]:
        """Heights towards the camera in pixels, NaN where there is none; a perspective view's mean depth is at 0."""
        depth = np.where(self.mask, self.depth, np.nan)
        return depth if self.K is None else (1 - depth) * self.K[0, 0]

    def __repr__(self) -> str:
        h, w = self.mask.shape
        known = self.depth[self.mask & np.isfinite(self.depth)]
        span = f", depth from {known.min():.4g} to {known.max():.4g}" if known.size else ""
        view = "orthographic" if self.K is None else "perspective"
        return f"Surface({h} x {w}, {int(self.mask.sum())} pixels on the mask{span}, {view})"

    def _repr_png_(self) -> bytes:
        return surface_png(self.heights_px())

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return _array(self.depth, dtype, copy)


class RowMap(Protocol):
    """A map, read and set by rows: an array, or `photonormal.files.rows.Rows` on disk. ``map[:]`` is an array."""

    @property
    def shape(self) -> tuple[int, ...]: ...

    def __getitem__(self, part: Any, /) -> np.ndarray: ...

    def __setitem__(self, rows: slice, values: Any, /) -> None: ...


@dataclass(frozen=True)
class Materials:
    """What the surface is made of, by the highlights that the photographs show.

    The maps are arrays; those of a frame that is large for the memory allowed lie on disk.

    Parameters
    ----------
    albedo : (h, w, 3) float32, of the matt part alone: without highlights, in the unit of the images, zero outside
    specular : (h, w, 3) float32, what the surface reflects at right angles, F0, in the same unit; zero where unknown
    roughness : (h, w) float32, GGX's, squared it is the facets' alpha; NaN where no light shows a highlight
    metalness : (h, w) float32, 1 for metals and 0 for others; NaN where it is unknown
    """

    albedo: RowMap
    specular: RowMap
    roughness: RowMap
    metalness: RowMap


@dataclass(frozen=True)
class Result:
    """What was measured of one capture, before anything is written (`photonormal.measure`).

    Parameters
    ----------
    capture : what was measured
    normals : with how far each is expected to be off, where that is known
    albedo : (h, w, 3) linear, in the unit of the images, zero outside the normals' mask. None: not asked for
    surface : None: not asked for
    lights, intensities : (n, 3) unit and (n,), where they were found from the photographs
    report : how it was done: method, options, images, seconds, warnings ..., in JSON's kinds of values
    materials : None: not asked for
    """

    capture: Capture
    normals: Normals
    albedo: np.ndarray | None
    surface: Surface | None
    lights: np.ndarray | None
    intensities: np.ndarray | None
    report: dict[str, Any] = field(repr=False)
    materials: Materials | None = None

    def __repr__(self) -> str:
        method = self.report.get("method", "")
        return f"Result({self.capture.name!r} by {method}: {self.normals!r}, report: {', '.join(self.report)})"

    def _repr_png_(self) -> bytes:
        return self.normals._repr_png_()


def _array(values: np.ndarray, dtype: Any, copy: bool | None) -> np.ndarray:
    """What ``numpy.asarray`` asks for."""
    return np.array(values, dtype) if copy else np.asarray(values, dtype)


def _parts(mask: Mask) -> Iterator[slice]:
    """Some rows after the other, to bound the memory."""
    return (slice(y, y + 256) for y in range(0, len(mask), 256))


def as_normals(value: Any, what: str = "normals") -> Normals:
    """Normals as they are, or those of an array (h, w, 3)."""
    if isinstance(value, Normals):
        return value
    if value is None or isinstance(value, str):
        raise InputError(
            f"the {what} are {value!r} but Normals or an array (h, w, 3) is needed; solve a capture, or read a file by "
            "photonormal.load_normals."
        )
    return Normals(as_array(value, f"the {what}"))


def as_capture(value: Any) -> Capture:
    """A capture as it is; InputError for anything else."""
    if isinstance(value, Capture):
        return value
    shown = repr(value) if isinstance(value, str) else f"{type(value).__name__}"
    raise InputError(
        f"{shown} came but a Capture is needed; give photonormal.load(folder), or "
        "Capture(images, mask, lights) of arrays."
    )
