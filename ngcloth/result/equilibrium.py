"""Is the pinned cloth in equilibrium? Asked with richer test functions than the solver's."""

import numpy as np

from . import changes
from .elements import Space, assembled, parts_of_square
from .patch import LITTLE

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
    density, slopes = points.law(1)
    by_change = np.einsum("na,nai->ni", slopes, points.felt.firsts)
    stress, _ = changes.with_area(density, by_change, 0.0)
    loads = points.loads(order, flat.reshape(-1, 1) * stress)
    force = np.bincount(space.pairs.ravel(), loads.ravel(), 2 * space.ndof)

    rim = space.on("rim")
    numbers = np.lexsort((space.ranks, rim))  # what goes before the rim does not feel it
    place = np.argsort(numbers)[space.dofs]
    n = place.shape[1]
    rows, columns = np.repeat(place, n, axis=1), np.tile(place, (1, n))
    norm = assembled(space.ndof, rows.ravel(), columns.ravel(), _norm(points, order).ravel())
    mirrors = [("mirror1",), ("mirror2",)] if patch.scene.symmetric else [(), ()]
    inside = whole = 0.0
    for component, mirror in zip(force.reshape(2, -1), mirrors, strict=True):
        free = np.flatnonzero(~space.on(*mirror)[numbers])
        parts = parts_of_square(norm[free][:, free], component[numbers[free]])
        inside += parts[~rim[numbers[free]]].sum()
        whole += parts.sum()
    return np.sqrt(inside), np.sqrt(whole)


def _norm(points, order):
    """The square of the norm, of each component alike: blocks of the groups, (groups, n, n)."""
    flat, areas = points.flat_areas(), points.areas()
    functions, slopes = points.functions_of(order), points.shapes(order)[:, :, :2]
    tensors = (flat.reshape(-1, 1, 1) * points.norm()[:, :2, :2]).reshape(*flat.shape, 2, 2)
    flux, shape = tensors @ slopes, (len(flat), -1, slopes.shape[-1])
    blocks = slopes.reshape(shape).swapaxes(1, 2) @ flux.reshape(shape)
    weights = LITTLE / areas.sum() * areas
    return blocks + functions.swapaxes(1, 2) @ (weights[:, :, None] * functions)
