"""At which points limits are to be asked next: where the patch misses them between the points.

The exchange of semi-infinite programming (Blankenship and Falk, 1976): a limit holds everywhere
once it holds at a few points that are found on the way.
"""

import numpy as np

from ..geometry.sheet import lattice
from ..problem.constraints import Elongation, LimitPoints, ShearLimit
from ..result.certificate import FINE

# Of a slack, over its scale: what is left between the points, and below what a limit is near. At a
# weak barrier a point that is added late leaves hardly any room for a step.
MISSED, NEAR = 1e-3, 0.05


def missed_points(problem):
    """The worst point of each triangle for each slack, where a limit is missed or will be.

    That is where a limit is near, and nearer than at all points at which it is asked.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Looked at on a lattice of twice its order, edges and corners included; on that of the
        certificate where limits are more than ratios of squares of ∇ψ. With the curvature, a
        reaction may be missed by 1e-2 between the points of a coarser one.

    Returns
    -------
    LimitPoints
    """
    simple = all(type(limit) in (Elongation, ShearLimit) for limit in problem.scene.constraints)
    nodes = lattice(2 * problem.order if simple else max(2 * problem.order, FINE))
    triangles = np.arange(problem.sheet.mesh.ne)
    everywhere = LimitPoints(np.repeat(triangles, len(nodes)), np.tile(nodes, (len(triangles), 1)))
    slacks, sizes = (
        values.reshape(-1, len(triangles), len(nodes)) for values in problem.slacks_at(everywhere)
    )
    dips = (slacks < NEAR * sizes) & (slacks < _least_asked(problem)[..., None] - MISSED * sizes)
    missed = ((slacks < -MISSED * sizes) | dips).any(axis=2)
    worst = nodes[slacks.argmin(axis=2)]
    there = np.broadcast_to(triangles, missed.shape)
    return LimitPoints(there[missed], worst[missed])


def _least_asked(problem):
    """The least of each slack at the points of each triangle, (slacks, triangles)."""
    asked = problem.slacks()
    inside, _, added = problem.parts
    least = asked[:, inside].reshape(len(asked), problem.sheet.mesh.ne, -1).min(axis=2)
    for row, values in zip(least, asked[:, added], strict=True):
        np.minimum.at(row, problem.limit_points.triangles, values)
    return least
