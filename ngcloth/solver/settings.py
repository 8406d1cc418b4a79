"""Settings of a solve: checked, with defaults, and none that the scene at hand does not use."""

import ngsolve as ngs

from ..energy.automatic import AutomaticLagrangian
from ..energy.closed_form import ClosedFormLagrangian
from ..errors import InputError, check_integer, check_number
from ..problem.fabric import of_strain_alone
from .barrier import LEAST_MU
from .gradient_flow import adaptive_flow, fixed_flow

LINEARISATIONS = {"closed form": ClosedFormLagrangian, "automatic": AutomaticLagrangian}
FLOWS = {"adaptive": adaptive_flow, "paper": fixed_flow}
INVERSES = ("sparsecholesky", "umfpack")
FINEST = 1e-8  # accuracy: what energies that are sums over a fine mesh tell apart
HIGHEST = 14  # order of ψ: NGSolve ends the process at rules for orders beyond
HIGHEST_DEGREE = 2 * HIGHEST + 2  # of rules
KNOWN = (
    "maxh, order, accuracy, multiplier_order, quadrature, barrier_end, tolerance, max_steps, "
    "max_seconds, schedule, linearisation, inverse, log, callback, checkpoint, throw"
)


def checked_settings(
    scene,
    *,
    maxh,
    order,
    accuracy,
    multiplier_order,
    quadrature,
    barrier_end,
    tolerance,
    max_steps,
    schedule,
    linearisation,
    inverse,
):
    """The settings of `solve` that a scene uses, and the version of NGSolve, as a dict.

    Raises
    ------
    InputError
        If one is out of bounds, whether the scene uses it or not.
    """
    limited = bool(scene.constraints)
    maxh = (0.04 if limited else 0.02) * scene.surface.diameter if maxh is None else maxh
    order = (3 if limited else 2) if order is None else order
    order = check_integer("order", order, 1, HIGHEST)
    if quadrature is None:
        quadrature = 2 * order + 2
        if limited and order > 4:
            # Exact for a net. What a rule does not see at the rim's vertices, an obstacle's τ there
            # is rewarded for, and grows without bound.
            quadrature = min(4 * order - 4, HIGHEST_DEGREE)
    settings = {
        "maxh": check_number("maxh", maxh, 0, open_low=True),
        "order": order,
        "quadrature": check_integer("quadrature", quadrature, 2 * order - 2, HIGHEST_DEGREE),
        "max_steps": check_integer("max_steps", max_steps, 1),
        "ngsolve": ngs.__version__,
        "inverse": _one_of("inverse", inverse, INVERSES),
        "schedule": _one_of("schedule", schedule, FLOWS),
    }
    _one_of("linearisation", linearisation, LINEARISATIONS)
    tolerance = check_number("tolerance", tolerance, 0, open_low=True)
    if barrier_end is not None:
        barrier_end = check_number("barrier_end", barrier_end, LEAST_MU, 1)
    if accuracy is not None:
        accuracy = check_number("accuracy", accuracy, FINEST, 1)
    if scene.in_equilibrium:
        # Closed forms are those of energies of strain.
        settings["linearisation"] = linearisation if of_strain_alone(scene.fabric) else "automatic"
        # With more multipliers than unknowns the matrix is singular.
        degree = order if multiplier_order is None else multiplier_order
        settings["multiplier_order"] = check_integer("multiplier_order", degree, 1, order)
    if limited:
        settings["barrier_end"] = barrier_end
        if accuracy is not None:
            settings["accuracy"] = accuracy
    if not limited or schedule == "paper":
        settings["tolerance"] = tolerance
    return settings


def _one_of(argument, value, choices):
    if not isinstance(value, str) or value not in choices:
        raise InputError(argument, value, "one of " + ", ".join(map(repr, choices)))
    return value
