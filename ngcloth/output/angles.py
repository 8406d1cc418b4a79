"""Shear angles as a person judges them: fine, to be looked at, too much; and how much of each."""

import ngsolve as ngs
import numpy as np

from ..errors import InputError, check_number
from ..problem.domain import divided_triangle
from ..problem.kinematics import Kinematics, gradient

LIMITS = (15.0, 30.0)  # degrees
BANDS = ("#3b9a6d", "#f4cf55", "#c2382e")  # below the first limit, between, beyond the second
DIVISIONS = 8  # of the sides of elements, for areas to 1e-4 on coarse meshes


def checked_limits(limits, field="angle"):
    """The limits of the three colours, `LIMITS` if None; `InputError` if they are none.

    Parameters
    ----------
    limits : (float, float) or None
        In degrees, 0 < first < second < 90.
    field : str, optional
        What is drawn; all but "angle" has no limits.

    Returns
    -------
    (float, float)
    """
    if limits is None:
        return LIMITS
    if field != "angle":
        raise InputError("limits", limits, f"None where the field is {field!r}, not 'angle'")
    try:
        first, second = limits
    except (TypeError, ValueError):
        raise InputError("limits", limits, "two angles in degrees") from None
    first = check_number("limits", first, 0, 90, open_low=True, open_high=True)
    return first, check_number("limits", second, first, 90, open_low=True, open_high=True)


def on_bands(angles, limits):
    """Shear angles as places on the three colours of one width: 0 to 1, 1 to 2, 2 to 3.

    Parameters
    ----------
    angles : array_like, (...)
        In degrees, of either sign.
    limits : (float, float)
        In degrees.

    Returns
    -------
    places : ndarray, (...)
    greatest : float
        The end of the third, in degrees: the largest angle, or a little beyond the second limit.
    """
    size = np.abs(angles)
    greatest = max(float(size.max()), 1.1 * limits[1])
    return np.interp(size, [0, *limits, greatest], range(4)), greatest


def area_beyond(result, limits=None):
    """How much of the surface is under cloth that is sheared by more than each limit.

    Parameters
    ----------
    result : Result
        Its whole cloth counts, mirror images included.
    limits : (float, float), optional
        In degrees, 15 and 30 by default. Angles of either sign count.

    Returns
    -------
    dict
        For each limit the area, and its share of the surface, 0 to 1.

    Raises
    ------
    InputError
        If the limits are not two angles in degrees, 0 < first < second < 90.

    Notes
    -----
    The angle is taken for linear, and the area for constant, on each of the 64 parts of an element.
    """
    limits = checked_limits(limits)
    sheet, mesh = result.sheet, result.state.space.mesh
    cloth = Kinematics(gradient(*result.state.components[:2]), sheet.metric)
    density = ngs.sqrt(ngs.Det(sheet.metric)) * ngs.Det(ngs.specialcf.JacobianMatrix(2))
    lattice, parts = divided_triangle(DIVISIONS)
    rule = ngs.IntegrationRule(lattice.tolist(), [0.0] * len(lattice))
    points = mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)
    angles, densities = (
        np.asarray(each.Compile()(points)).reshape(mesh.ne, -1)[:, parts].reshape(-1, 3)
        for each in (cloth.angle, density)
    )
    areas = result.scene.copies * densities.mean(axis=1) / 2 / len(parts)
    beyond = {limit: float(areas @ _share_above(np.abs(angles), limit)) for limit in limits}
    return {limit: (area, area / float(areas.sum())) for limit, area in beyond.items()}


def _share_above(corners, level):
    """The share of triangles in which what is linear, (n, 3) at the corners, exceeds a level."""
    low, middle, high = np.sort(corners, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        tip = (high - level) ** 2 / ((high - low) * (high - middle))
        base = 1 - (level - low) ** 2 / ((high - low) * (middle - low))
    inside = np.where(level >= middle, tip, base)
    return np.where(level <= low, 1.0, np.where(level >= high, 0.0, inside))
