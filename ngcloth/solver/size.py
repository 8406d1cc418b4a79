"""How large a solve will be, told before a mesh is made."""

import os

import numpy as np

from ..errors import InputError
from ..geometry.file_surface import FileSurface

TRIANGLES = 2.3  # of size h in an area h², as Netgen makes them
SECONDS = 1e-4  # to mesh one of them, on a fast machine
GRACE = 1.0  # seconds: a mesh that is made in less is made, and the budget then used up
# Bytes a triangle, for each point of the integration rule and for each pair of shape functions:
# fits to the peaks of solves at orders 2, 6 and 10. Without limits it is a tenth.
PER_POINT, PER_PAIR, WITHOUT = 3500, 1500, 0.1
MEMORY = 16e9  # where the system does not tell what it has


def check_memory(scene, settings):
    """Refuse what the machine cannot hold.

    Parameters
    ----------
    scene : Scene
        What is to be solved.
    settings : dict
        As of `solve`.

    Raises
    ------
    InputError
        With the estimate.
    """
    memory, limit = estimated_memory(scene, settings), _memory()
    if memory > limit:
        order, triangles = settings["order"], _triangles(scene, settings["maxh"])
        unknowns = triangles * order**2 * (2 if scene.in_equilibrium else 1)
        allowed = (
            f"about {triangles:.1e} triangles of order {order}, {unknowns:.1e} unknowns and "
            f"{memory / 1e9:.3g} GB, more than the {limit / 1e9:.3g} GB there are"
        )
        raise InputError("maxh", settings["maxh"], allowed)


def estimated_memory(scene, settings):
    """About how many bytes a solve takes at most.

    Parameters
    ----------
    scene : Scene
        What is to be solved.
    settings : dict
        As of `solve`.

    Returns
    -------
    float
    """
    order = settings["order"]
    points, shapes = (settings["quadrature"] // 2 + 1) ** 2, (order + 1) * (order + 2) / 2
    each = PER_POINT * points + PER_PAIR * shapes**2
    scale = 1 if scene.in_equilibrium else WITHOUT
    return float(_triangles(scene, settings["maxh"]) * each * scale)


def check_seconds(scene, maxh, max_seconds):
    """Refuse a budget of time that not even the mesh can be made in.

    Parameters
    ----------
    scene : Scene
        What is to be solved.
    maxh : float
        The size of the triangles that the mesh generator makes; finer ones come of refinement.
    max_seconds : float
        The budget.

    Raises
    ------
    InputError
        With the estimate.
    """
    triangles = _triangles(scene, maxh)
    seconds = SECONDS * triangles
    if seconds > max_seconds + GRACE:
        allowed = (
            f"more than it takes to make the mesh, {seconds:.2g} s for about {triangles:.1e} "
            f"triangles of size {maxh:g}"
        )
        raise InputError("max_seconds", max_seconds, allowed)


def _triangles(scene, maxh):
    """About how many triangles of a size the meshed domain has, or the surface of a file."""
    if isinstance(scene.surface, FileSurface):
        with np.errstate(over="ignore", divide="ignore"):
            return TRIANGLES * np.divide(scene.surface.area, maxh**2)
    domain = scene.surface.domain
    low, high = np.array(domain.box, dtype=float).T
    points = np.random.default_rng(0).uniform(low, high, (1000, 2))
    share = domain.contains(points).mean() / scene.copies
    with np.errstate(over="ignore", divide="ignore"):
        return TRIANGLES * share * np.prod((high - low) / maxh)


def _memory():
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return MEMORY
