"""photonormal: surface normals, depth and meshes from photographs under known lights.

Importing it loads neither torch nor OpenCV nor SciPy; each is loaded by the first call that needs it.
"""

__version__ = "0.1.0"

from photonormal.capture import load
from photonormal.examination import check
from photonormal.export import load_normals, save
from photonormal.integration import integrate
from photonormal.measurement import measure
from photonormal.methods import solve
from photonormal.rig.spheres import calibrate
from photonormal.scoring import score
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
