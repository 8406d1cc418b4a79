"""How large is what a scene minimises? The unit of a cost of the user's own decides nothing."""

from copy import copy

import ngsolve as ngs
import numpy as np

from ..errors import InputError
from .kinematics import Kinematics

STRAIN = 0.1
STRAINS = [(STRAIN, 0, 0), (0, 0, STRAIN), (0, STRAIN, 0)]  # of the flat cloth: 11, 12, 22


def cost_size(scene):
    """What a cost gains in undeformed cloth that is then strained, over what threads of kc would.

    Parameters
    ----------
    scene : Scene
        One without a cost of its own has the size 1.

    Returns
    -------
    float
        The greatest over strains and places.

    Raises
    ------
    InputError
        If the cost does not change.
    """
    if scene.cost is None:
        return 1.0
    surface = scene.tried_on
    metric, area = surface.metric, ngs.sqrt(ngs.Det(surface.metric))
    root = (metric + area * ngs.Id(2)) / ngs.sqrt(ngs.Trace(metric) + 2 * area)
    values = []
    for a, b, c in [(0, 0, 0), *STRAINS]:
        slope = ngs.CF((1 - a, -b, -b, 1 - c), dims=(2, 2)) * root
        tensors = metric, scene.fabric, lambda: surface.curvature
        cloth = Kinematics(slope, *tensors, scene.start_expression())
        values.append(cloth.jacobian / area * scene.cost(cloth))
    values = surface.evaluate(ngs.CF(tuple(values)), surface.domain.sample(5))
    gains = np.abs(values[:, 1:] - values[:, :1])
    size = np.max(gains, initial=0.0, where=np.isfinite(gains))
    if not size > 0:
        raise InputError("cost", scene.cost, "a density that changes as the cloth is strained")
    return float(size / (4 * STRAIN**2 * scene.fabric.stiffness))


def normalised(scene):
    """The same scene with a cost of size 1: what a solver minimises, whatever the user's unit.

    Parameters
    ----------
    scene : Scene
        Left as it is.

    Returns
    -------
    solved : Scene
    size : float
        By which the cost was divided.
    """
    size = cost_size(scene)
    if scene.cost is None:
        return scene, size
    solved = copy(scene)
    object.__setattr__(solved, "cost", lambda cloth: scene.cost(cloth) / size)
    return solved, size
