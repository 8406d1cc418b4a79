"""The nearest point of a surface to one in space."""

import ngsolve as ngs
import numpy as np

from ._kernel import lattice

STEPS = 60
SETTLED = 1e-14  # of the distance between places: of a step
SAMPLES = 4  # along each side of a triangle


def nearest_parameters(target, samples, place, tangents, within):
    """Where a surface is nearest to a point, by steps of Gauss and Newton from samples.

    Parameters
    ----------
    target : ndarray, (3,)
        The point.
    samples : ndarray, (n, 2)
        Points of the domain.
    place, tangents : callable
        φ (n, 3) of points (n, 2) of the domain, and ∂φ/∂θ (3, 2) of one point (2,).
    within : callable
        Whether a point (2,) lies in the domain.

    Returns
    -------
    theta : ndarray, (2,)
    """
    distances = np.linalg.norm(place(samples) - target, axis=1)
    theta, distance = samples[np.argmin(distances)], distances.min()
    damping = 1.0
    for _ in range(STEPS):
        gap = target - place(theta[None])[0]
        step = np.linalg.lstsq(tangents(theta), gap, rcond=None)[0]
        trial, now = theta + damping * step, np.inf
        if within(trial):
            now = np.linalg.norm(place(trial[None])[0] - target)
        if now < distance:
            theta, distance, damping = trial, now, 1.0
        else:
            damping /= 2
        if damping * np.linalg.norm(step) <= SETTLED * (1 + np.linalg.norm(theta)):
            break
    return theta


def nearest_on_sheet(sheet, target):
    """The point of a `Sheet` that is nearest to one in space.

    Returns
    -------
    theta : ndarray, (2,)
        In an element of its mesh, or where two meet.
    point : ndarray, (3,)
    tangents : ndarray, (3, 2)
    """
    mesh, slopes = sheet.mesh, ngs.CF(sheet.tangents, dims=(2, 3))
    nodes = (1 - 1e-3) * lattice(SAMPLES) + 1e-3 / 3
    rule = ngs.IntegrationRule(nodes.tolist(), [0.0] * len(nodes))
    samples = ngs.CF((ngs.x, ngs.y))(mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL))

    def place(theta):
        return np.asarray(sheet.position(mesh(*theta.T))).reshape(-1, 3)

    def tangents(theta):
        return np.asarray(slopes(mesh(*theta))).reshape(2, 3).T

    theta = nearest_parameters(
        np.asarray(target), samples, place, tangents, lambda theta: mesh(*theta).nr >= 0
    )
    return theta, place(theta[None])[0], tangents(theta)
