"""From the surface to the flat patch and back."""

import ngsolve as ngs
import numpy as np

from ..errors import InputError, check_points
from ..output.plot import sample

STEPS = 60
SETTLED = 1e-13  # of the size: of steps on the surface or the patch
OUTLINE, MARGIN = 800, 1e-2  # points of a polygon around the patch; of the size, to be beside it
FOUND = 1e-9  # of the size: from the patch, where a point lies on it


def flatten(result, points):
    """See `Result.flatten`."""
    points, sheet = check_points("points", points, 3), result.whole
    slopes = ngs.CF(sheet.tangents, dims=(2, 3))

    def place(theta):
        return result.evaluate(sheet.position, theta)

    def tangents(theta):
        return result.evaluate(slopes, theta).swapaxes(1, 2)

    theta, _ = _nearest(result, points.reshape(-1, 3), place, tangents)
    return result.psi(*theta.T).reshape(points.shape[:-1] + (2,))


def lay(result, flat):
    """See `Result.lay`."""
    from matplotlib.path import Path  # takes time

    flat = check_points("flat", flat, 2)
    targets, outline = flat.reshape(-1, 2), result.outline(OUTLINE)
    size = np.ptp(outline, axis=0).max()
    # Most points outside are told by a polygon, and need no search.
    polygon = Path(np.concatenate([outline, outline[:1]]), closed=True)
    here = polygon.contains_points(targets, radius=MARGIN * size)
    here |= polygon.contains_points(targets, radius=-MARGIN * size)
    points = np.full((len(targets), 3), np.nan)
    theta, distance = _nearest(
        result, targets[here], lambda theta: result.psi(*theta.T), result.slopes
    )
    found = result.evaluate(result.whole.position, theta)
    found[distance > FOUND * size] = np.nan
    points[here] = found
    return points.reshape(flat.shape[:-1] + (3,))


def _nearest(result, targets, place, slopes):
    """Parameters of the points of the domain whose places are nearest, and how far these are.

    By the steps of Gauss and Newton from the nearest of many samples; those that come no nearer
    are halved.
    """
    from scipy.spatial import cKDTree  # takes time, and sets filters of warnings

    samples, _ = sample(result)
    there = place(samples)
    away, first = cKDTree(there).query(targets)
    size = np.ptp(there, axis=0).max()
    for far in np.flatnonzero(away > size)[:1]:
        allowed = f"near the surface, whose size is {size:.3g}; this is {away[far]:.3g} from it"
        raise InputError("points", tuple(targets[far].tolist()), allowed)
    theta = samples[first]
    distance = np.linalg.norm(place(theta) - targets, axis=1)
    damping, moving = np.ones(len(theta)), np.arange(len(theta))
    for _ in range(STEPS):
        at = theta[moving]
        gap, matrix = targets[moving] - place(at), slopes(at)
        step = (np.linalg.pinv(matrix) @ gap[..., None])[..., 0]
        length = np.linalg.norm((matrix @ step[..., None])[..., 0], axis=1) * damping[moving]
        trial = result.domain.brought_in(at + damping[moving, None] * step)
        now = np.linalg.norm(place(trial) - targets[moving], axis=1)
        better = now < distance[moving]
        theta[moving[better]], distance[moving[better]] = trial[better], now[better]
        damping[moving] = np.where(better, 1.0, damping[moving] / 2)
        moving = moving[length > SETTLED * size]
        if not len(moving):
            break
    return theta, distance
