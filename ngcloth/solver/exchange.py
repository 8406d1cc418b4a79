"""At which points limits are to be asked next: where the patch misses them between the points.

The exchange of semi-infinite programming (Blankenship and Falk, 1976): a limit holds everywhere
once it holds at a few points that are found on the way.
"""

import numpy as np

from ..geometry.sheet import lattice
from ..problem.constraints import Elongation, LimitPoints, ShearLimit

MISSED = 1e-3  # of a slack, over its scale: what is left between the points
# Points along a side at which limits are looked at that are more than ratios of squares of ∇ψ: with
# the curvature, a reaction may be missed by 1e-2 between the points of a coarser lattice.
FINE = 24


def missed_points(problem):
    """The worst point of each triangle for each slack, of those where a limit is missed.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Looked at on a lattice of twice its order, edges and corners included; on a finer one where
        there are other limits than those of stretch and shear.

    Returns
    -------
    LimitPoints
    """
    simple = all(type(limit) in (Elongation, ShearLimit) for limit in problem.scene.constraints)
    nodes = lattice(2 * problem.order if simple else max(2 * problem.order, FINE))
    triangles = np.arange(problem.sheet.mesh.ne)
    everywhere = LimitPoints(np.repeat(triangles, len(nodes)), np.tile(nodes, (len(triangles), 1)))
    slacks = problem.relative_slacks(everywhere).reshape(-1, len(triangles), len(nodes))
    missed = slacks.min(axis=2, initial=np.inf) < -MISSED
    worst = nodes[slacks.argmin(axis=2)]
    there = np.broadcast_to(triangles, missed.shape)
    return LimitPoints(there[missed], worst[missed])
