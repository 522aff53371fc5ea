"""photonormal: surface normals, depth and meshes from photographs under known lights.

Importing it loads neither torch nor OpenCV; each is loaded by the first call that needs it.
"""

__version__ = "0.1.0"

from photonormal.capture import load
from photonormal.check import check
from photonormal.export import load_normals, save
from photonormal.integrate import integrate
from photonormal.measure import measure
from photonormal.rig import calibrate
from photonormal.score import score
from photonormal.solve import solve
from photonormal.types import Capture, InputError, Normals, Result, Surface

__all__ = [
    "Capture",
    "InputError",
    "Normals",
    "Result",
    "Surface",
    "__version__",
    "calibrate",
    "check",
    "integrate",
    "load",
    "load_normals",
    "measure",
    "save",
    "score",
    "solve",
]
