"""The paper's scenes, by name."""

import functools
import inspect
from dataclasses import dataclass

import ngsolve as ngs
import numpy as np

from .errors import InputError, check_number
from .geometry.file_surface import FileSurface
from .problem.constraints import Elongation, Obstacle, ShearLimit
from .problem.domain import Disk, Rectangle
from .problem.fabric import Net
from .problem.scene import Scene
from .problem.surface import Surface

NAMED = {}


@dataclass(frozen=True)
class Stereographic:
    """The chart of the unit sphere by which the unit disk covers the portion r²/(1 + r²)."""

    r: float

    def __call__(self, theta1, theta2):
        """The three components of φ."""
        square = self.r**2 * (theta1**2 + theta2**2)
        return [q / (1 + square) for q in (2 * self.r * theta1, 2 * self.r * theta2, square - 1)]


@dataclass(frozen=True)
class Catenoid:
    """The chart of the catenoid: θ1 its angle, θ2 its height."""

    def __call__(self, theta1, theta2):
        """The three components of φ."""
        radius = ngs.cosh(theta2)
        return radius * ngs.cos(theta1), radius * ngs.sin(theta1), theta2


def _named(make):
    """List the scenes of `make` in `NAMED`, and note in each how it was made, as its `recipe`."""
    signature = inspect.signature(make)

    @functools.wraps(make)
    def noted(*args, **kwargs):
        scene = make(*args, **kwargs)
        given = signature.bind(*args, **kwargs)
        given.apply_defaults()
        arguments = {
            name: value if value is None or isinstance(value, bool) else float(value)
            for name, value in given.arguments.items()
        }
        # No field of the scene, and so lost where dataclasses.replace() makes it another one.
        object.__setattr__(scene, "recipe", {"scene": make.__name__, "arguments": arguments})
        return scene

    NAMED[make.__name__] = noted
    return noted


@_named
def sphere(portion=0.85, ks=0.0, shear_limit=None, *, symmetric=True):
    """A portion of the unit sphere (§5.1, §5.3), in stereographic projection of the unit disk.

    Parameters
    ----------
    portion : float
        Area covered over area of the sphere, p = r²/(1 + r²), 0 < p < 1.
    ks : float
        Shear stiffness over thread stiffness, kc being 1.
    shear_limit : float, optional
        γmax, the largest cosine of the angle between the threads (§5.3). With it, or with
        ``ks > 0``, threads are kept taut and the patch in equilibrium; without either the scene
        is a Chebyshev net.
    symmetric : bool
        Solve on a quarter. Default True.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        For a portion outside (0, 1), a shear limit outside (0, 1), or a negative ``ks``.
    """
    portion = check_number("portion", portion, 0, 1, open_low=True, open_high=True)
    # The stereographic chart seen from the north pole turns ∂1φ × ∂2φ inward.
    chart = Stereographic(float(np.sqrt(portion / (1 - portion))))
    surface = Surface(chart, Disk(), side=-1)
    fabric = Net(ks=ks)
    limits = _limits(fabric, shear_limit)
    return Scene(
        surface=surface,
        fabric=fabric,
        constraints=limits,
        start=(0.5, 0.5) if portion == 0.5 else (0.1, 0.1),
        symmetric=symmetric,
        name=f"sphere, portion {portion:g}, ks/kc = {fabric.ks:g}"
        + ("" if shear_limit is None else f", |γ| ≤ {limits[-1].maximum:.4g}"),
    )


@_named
def hemisphere(ks=0.0, *, symmetric=True):
    """The unit hemisphere (§5.1, §5.2): `sphere` with ``portion=0.5``.

    Parameters
    ----------
    ks : float
        Shear stiffness over thread stiffness, kc being 1. With ``ks=0`` the scene is a Chebyshev
        net; else threads are kept taut and the patch in equilibrium.
    symmetric : bool
        Solve on a quarter. Default True.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        For a negative ``ks``.
    """
    return sphere(0.5, ks, symmetric=symmetric)


@_named
def hemicatenoid(ks=0.0, obstacle=False, *, symmetric=None):
    """Half a catenoid (§5.1, §5.2), on (0, π) × (−1, 1), cloth on its convex side along θ1.

    Parameters
    ----------
    ks : float
        Shear stiffness over thread stiffness, kc being 1. At ``ks=0`` Chebyshev nets are not
        unique beyond the threads through the rim's axis points: the scene prefers one that
        bends evenly (`Scene.tie_break`).
    obstacle : bool
        Whether the surface can only push, τ ≥ 0 (§5.4).
    symmetric : bool, optional
        Solve on a quarter. Default True but with an obstacle, which breaks the symmetry.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        For a negative ``ks``; or for an obstacle with ``ks=0``: a cloth without stress is not
        pushed.
    """
    if not isinstance(obstacle, bool):
        raise InputError("obstacle", obstacle, "True or False")
    if obstacle and ks == 0:
        raise InputError(
            "obstacle", obstacle, "False where ks = 0: an unstressed cloth is not pushed"
        )
    fabric = Net(ks=ks)
    return Scene(
        surface=Surface(Catenoid(), Rectangle((0, np.pi), (-1, 1))),
        fabric=fabric,
        constraints=_limits(fabric, None) + ((Obstacle(),) if obstacle else ()),
        start=(0.3, 0.4) if obstacle else (0.5, 0.5),
        symmetric=not obstacle if symmetric is None else symmetric,
        tie_break=1e-9 if ks == 0 else 0.0,
        name=f"hemicatenoid, ks/kc = {fabric.ks:g}" + (", obstacle" if obstacle else ""),
    )


def part(surface, ks=0.0, shear_limit=None, obstacle=False, warp=None, at=None, *, symmetric=False):
    """A surface from a CAD file or from facets.

    Parameters
    ----------
    surface : Surface
        As of `Surface.from_cad` and `Surface.from_mesh`.
    ks : float
        Shear stiffness over thread stiffness, kc being 1.
    shear_limit : float, optional
        γmax, the cosine of the smallest angle between the threads, if that is limited.
    obstacle : bool
        Whether the surface can only push, τ ≥ 0.
    warp : (float, float, float), optional
        A direction in space along which the warp runs at the point `at`. By default the optimum
        chooses.
    at : (float, float, float), optional
        A point of the surface, in space. By default one in its middle.
    symmetric : bool
        Whether the surface is a quarter between mirror lines, named in the file as for `Scene`.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        For a negative ``ks``; for an obstacle with ``ks=0``: a cloth without stress is not pushed;
        and as `Scene` does.
    """
    if not isinstance(obstacle, bool):
        raise InputError("obstacle", obstacle, "True or False")
    if obstacle and ks == 0:
        allowed = "False where ks = 0: an unstressed cloth is not pushed"
        raise InputError("obstacle", obstacle, allowed)
    fabric = Net(ks=ks)
    limits = _limits(fabric, shear_limit) + ((Obstacle(),) if obstacle else ())
    scene = Scene(
        surface,
        fabric,
        limits,
        symmetric=symmetric,
        name=f"part, ks/kc = {fabric.ks:g}",
        warp=warp,
        at=at,
    )
    if isinstance(surface, FileSurface):  # which is saved with the result
        shear_limit = None if shear_limit is None else float(shear_limit)
        arguments = {"ks": fabric.ks, "shear_limit": shear_limit, "obstacle": obstacle}
        arguments |= {"warp": scene.warp, "at": scene.at, "symmetric": symmetric}
        object.__setattr__(scene, "recipe", {"scene": "part", "arguments": arguments})
    return scene


def _limits(fabric, shear_limit):
    if fabric.ks == 0 and shear_limit is None:
        return ()
    return (Elongation(),) if shear_limit is None else (Elongation(), ShearLimit(shear_limit))
