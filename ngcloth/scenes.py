"""The paper's scenes, by name."""

import ngsolve as ngs
import numpy as np

from .domain import Disk, Rectangle
from .errors import check_number
from .fabric import Net
from .scene import Scene
from .surface import Surface


def sphere(portion=0.85, ks=0.0, *, symmetric=True):
    """A portion of the unit sphere (§5.1, §5.3), in stereographic projection of the unit disk.

    Parameters
    ----------
    portion : float
        Area covered over area of the sphere, p = r²/(1 + r²), 0 < p < 1.
    ks : float
        Shear stiffness over thread stiffness, kc being 1.
    symmetric : bool
        Solve on a quarter. Default True.
    """
    check_number("portion", portion, 0, 1, open_low=True, open_high=True)
    r = np.sqrt(portion / (1 - portion))

    def chart(theta1, theta2):
        square = r**2 * (theta1**2 + theta2**2)
        return [q / (1 + square) for q in (2 * r * theta1, 2 * r * theta2, square - 1)]

    # The stereographic chart seen from the north pole turns ∂1φ × ∂2φ inward.
    surface = Surface(chart, Disk(), side=-1)
    return Scene(
        surface=surface,
        fabric=Net(ks=ks),
        start=(0.5, 0.5) if portion == 0.5 else (0.1, 0.1),
        symmetric=symmetric,
        name=f"sphere, portion {portion:g}, ks/kc = {ks:g}",
    )


def hemisphere(ks=0.0, *, symmetric=True):
    """The unit hemisphere (§5.1, §5.2): `sphere` with ``portion=0.5``."""
    return sphere(0.5, ks, symmetric=symmetric)


def hemicatenoid(ks=0.0, *, symmetric=True):
    """Half a catenoid (§5.1, §5.2), on (0, π) × (−1, 1), cloth on its convex side along θ1.

    Parameters
    ----------
    ks : float
        Shear stiffness over thread stiffness, kc being 1. At ``ks=0`` Chebyshev nets are not
        unique beyond the threads through the rim's axis points: the scene takes the one that
        bends least (`Scene.tie_break`).
    symmetric : bool
        Solve on a quarter. Default True.
    """

    def chart(theta1, theta2):
        radius = ngs.cosh(theta2)
        return radius * ngs.cos(theta1), radius * ngs.sin(theta1), theta2

    return Scene(
        surface=Surface(chart, Rectangle((0, np.pi), (-1, 1))),
        fabric=Net(ks=ks),
        start=(0.5, 0.5),
        symmetric=symmetric,
        tie_break=1e-8 if ks == 0 else 0.0,
        name=f"hemicatenoid, ks/kc = {ks:g}",
    )
