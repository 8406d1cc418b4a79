"""ngcloth: which flat piece of woven cloth best covers a given curved surface?"""

from . import scenes
from .certificate import verify
from .constraints import Elongation, Obstacle, ShearLimit
from .domain import Disk, Domain, Rectangle
from .errors import InputError, SolveError
from .fabric import Net
from .history import Reason
from .load import load
from .report import report
from .result import Result
from .scene import Scene
from .solve import minima, solve
from .surface import Surface

__version__ = "0.1.0"

__all__ = [
    "Disk",
    "Domain",
    "Elongation",
    "InputError",
    "Net",
    "Obstacle",
    "Reason",
    "Rectangle",
    "Result",
    "Scene",
    "ShearLimit",
    "SolveError",
    "Surface",
    "load",
    "minima",
    "report",
    "scenes",
    "solve",
    "verify",
]
