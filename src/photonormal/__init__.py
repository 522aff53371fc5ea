"""photonormal: surface normals, depth and meshes from photographs under known lights.

Importing it loads neither torch nor OpenCV; each is loaded by the first call that needs it.
"""

__version__ = "0.1.0"

from photonormal.capture import load
from photonormal.export import save
from photonormal.integrate import integrate
from photonormal.score import score
from photonormal.solve import solve
from photonormal.types import Capture, InputError, Normals, Surface

__all__ = ["Capture", "InputError", "Normals", "Surface", "__version__", "integrate", "load", "save", "score", "solve"]
