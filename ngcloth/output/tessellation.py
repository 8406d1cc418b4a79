"""The cloth as few flat triangles, on its surface and on the patch, within a tolerance of both."""

import numpy as np

from ..problem.domain import MeshDomain
from .plot import sample

RINGS = 6  # of the triangles that are refined, for charts
SIDES = np.array([[0, 1], [1, 2], [2, 0]])


def tessellation(result, tolerance):
    """Triangles whose sides leave neither the surface nor the patch by more than a tolerance.

    Sides are halved where their middle is farther than that from its place on the surface, or on
    the patch; and, as in Rivara's refinement by longest edges, the longest side of any triangle
    with a halved one, so that angles stay away from 0. The middles of the rim go onto the rim.

    Parameters
    ----------
    result : Result
        All of its cloth, mirror images included.
    tolerance : float
        In units of length.

    Returns
    -------
    theta : ndarray, (n, 2)
        Parameter points.
    triangles : ndarray of int, (m, 3)
        Counter-clockwise.
    """
    if isinstance(result.domain, MeshDomain):
        theta, triangles = result.domain.divided(1)
    else:
        theta, triangles = sample(result, RINGS)
    places = _places(result, theta)
    while True:
        ends, sides = _sides(triangles)
        middles = _middles(result, theta, ends, sides)
        there = _places(result, middles)
        gaps = (there - places[ends].mean(axis=1)).reshape(-1, 2, 3)
        halved = np.linalg.norm(gaps, axis=-1).max(axis=1) > tolerance
        if not halved.any():
            return theta, triangles
        lengths = np.linalg.norm(np.diff(places[ends], axis=1)[:, 0, :3], axis=-1)
        longest = lengths[sides].argmax(axis=1)
        _with_longest(halved, sides, longest)
        number = np.full(len(ends), -1)
        number[halved] = len(theta) + np.arange(halved.sum())
        triangles = _halved(triangles, number[sides], longest)
        theta = np.concatenate([theta, middles[halved]])
        places = np.concatenate([places, there[halved]])


def _places(result, theta):
    """Where points are on the surface and on the patch, (n, 6), the last component 0."""
    flat = result.psi(*theta.T)
    position = result.evaluate(result.whole.position, theta)
    return np.column_stack([position, flat, np.zeros(len(flat))])


def _sides(triangles):
    """The sides of all triangles by their ends, (k, 2), and the three of each by number, (m, 3)."""
    ends = np.sort(triangles[:, SIDES].reshape(-1, 2), axis=1)
    ends, sides = np.unique(ends, axis=0, return_inverse=True)
    return ends, sides.reshape(-1, 3)


def _middles(result, theta, ends, sides):
    """The middles of sides as parameter points; those of a chart's rim are moved onto it."""
    middles, domain = theta[ends].mean(axis=1), result.domain
    if not isinstance(domain, MeshDomain):
        rim = np.bincount(sides.ravel()) == 1
        beyond = 2 * middles[rim] - domain.centre
        middles[rim] = domain.brought_in(beyond)
    return middles


def _with_longest(halved, sides, longest):
    """Have the longest side of every triangle with a halved one halved, too."""
    own = sides[np.arange(len(sides)), longest]
    count = -1
    while count != halved.sum():
        count = halved.sum()
        halved[own[halved[sides].any(axis=1)]] = True


def _halved(triangles, middles, longest):
    """The parts of triangles: through the middle of the longest side, then of the others.

    `middles` are the points in the middle of the three sides, or -1 where they are not halved.
    """
    whole = (middles < 0).all(axis=1)
    order = (longest[~whole, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles[~whole], order, axis=1).T
    ab, bc, ca = np.take_along_axis(middles[~whole], order, axis=1).T
    parts = [triangles[whole]]
    for first, second, middle in ((c, a, ca), (b, c, bc)):
        cut = middle >= 0
        parts.append(np.stack([first, second, ab], axis=-1)[~cut])
        parts.append(np.stack([first, middle, ab], axis=-1)[cut])
        parts.append(np.stack([middle, second, ab], axis=-1)[cut])
    return np.concatenate(parts)
