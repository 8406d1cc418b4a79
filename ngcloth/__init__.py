"""ngcloth: which flat piece of woven cloth best covers a given curved surface?"""

from importlib import import_module

from . import scenes
from .errors import InputError, SolveError
from .fabrics import MeasuredFabric
from .output.report import report
from .problem.constraints import Elongation, Obstacle, ShearLimit
from .problem.domain import Disk, Domain, Rectangle
from .problem.fabric import BendingThreads, Families, Net, Swollen, Turned
from .problem.scene import Scene
from .problem.shear_tests import BiasExtension, PictureFrame
from .problem.surface import Surface
from .result.certificate import verify
from .result.history import Reason
from .result.load import load
from .result.result import Result
from .solver.solve import minima, solve
from .studies.study import Study, study
from .version import __version__ as __version__

__all__ = [
    "BendingThreads",
    "BiasExtension",
    "Disk",
    "Domain",
    "Elongation",
    "Families",
    "InputError",
    "MeasuredFabric",
    "Net",
    "Obstacle",
    "PictureFrame",
    "Reason",
    "Rectangle",
    "Result",
    "Scene",
    "ShearLimit",
    "SolveError",
    "Study",
    "Surface",
    "Swollen",
    "Turned",
    "load",
    "minima",
    "report",
    "scenes",
    "solve",
    "study",
    "verify",
]


def __getattr__(name):
    """Modules that plot, loaded when they are asked for: that takes a second."""
    if name in ("fields", "plot", "plot_fabric", "view"):
        return import_module(f".output.{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
