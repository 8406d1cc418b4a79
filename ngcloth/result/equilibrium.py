"""Is the pinned cloth in equilibrium? Asked with richer test functions than the solver's."""

import numpy as np

from ..problem.fabric import of_place
from . import changes
from .elements import Space, assembled, factorised

LITTLE = 1e-2  # of the mean square of ψ, over the area, in the norm
FINER = 4  # degrees by which the integration rule is richer than the solver's


def equilibrium_residual(patch):
    """The force on the cloth inside the rim over that with the rim included, in a dual norm.

    Parameters
    ----------
    patch : Patch
        Of a result that has converged or not.

    Returns
    -------
    float
        See `Result.equilibrium_residual`.
    """
    inside, whole = forces(patch)
    floor = 1e-9 * np.sqrt(patch.inside.flat_areas().sum())
    return float(inside / max(whole, floor))


def forces(patch):
    """Dual norms of the force over kc, on the cloth inside the rim and with the rim included."""
    points, order = patch.by_rule(patch.degree + FINER), patch.order + 1
    space, flat = Space(patch.triangles, order), points.flat_areas()
    density, slopes, bends, _ = points.law()
    firsts, seconds = (
        np.concatenate([change(tensor) for tensor in points.pushed_tensors], axis=1)
        for change in (changes.first, changes.second)
    )
    n = firsts.shape[1]
    by_z = changes.chained(slopes[:, :n], bends[:, :n, :n], firsts, seconds)
    stress, _ = changes.with_area(density, *by_z)
    loads = points.loads(order, flat.reshape(-1, 1) * stress)
    if of_place(patch.scene.fabric):
        by_place = flat[:, :, None] * slopes[:, n:].reshape(*points.shape, 2)
        pulls = by_place.swapaxes(1, 2) @ points.functions_of(order)
        loads += pulls.reshape(loads.shape)
    force = np.bincount(space.pairs.ravel(), loads.ravel(), 2 * space.ndof)

    blocks = points.blocks(order, order, flat.reshape(-1, 1, 1) * points.seminorm())
    functions, areas = points.functions_of(order), points.areas()
    weighted = (LITTLE / areas.sum() * areas)[:, :, None] * functions
    mass = functions.swapaxes(1, 2) @ weighted
    n = space.dofs.shape[1]
    for part in (slice(0, n), slice(n, 2 * n)):
        blocks[:, part, part] += mass
    rows, columns = np.repeat(space.pairs, 2 * n, axis=1), np.tile(space.pairs, (1, 2 * n))
    norm = assembled(2 * space.ndof, rows.ravel(), columns.ravel(), blocks.ravel())

    mirrors = [("mirror1",), ("mirror2",)] if patch.scene.symmetric else [(), ()]
    free = [~space.on(*mirror) for mirror in mirrors]
    inside = [~space.on("rim", *mirror) for mirror in mirrors]

    def dual_norm(free):
        free = np.flatnonzero(np.concatenate(free))
        free = free[np.argsort(np.tile(space.ranks, 2)[free], kind="stable")]
        square = force[free] @ factorised(norm[free][:, free]).solve(force[free])
        return np.sqrt(max(square, 0.0))

    return dual_norm(inside), dual_norm(free)
