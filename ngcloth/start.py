"""The start of a solve: made feasible, and of a size from which Newton steps are few."""

import numpy as np

from .errors import InputError

STRETCHED = 10.0  # cost per area over kc above which a start is dilated


def feasible_start(problem, recorder):
    """Scale the start until it is feasible; dilate one that is stretched many times over.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved.
    recorder : Recorder
        Logs by how much.

    Raises
    ------
    InputError
        If no multiple of the start is feasible.
    """
    psi, sizes = problem.state.vec, _sizes(problem)
    given = psi.CreateVector()
    given.data = psi

    def least_slacks():
        folded = not problem.least_jacobian() > 0
        return np.array([-np.inf if folded else c.min() for c in problem.slacks()])

    for scale in sorted(1.25 ** np.arange(-30.0, 31.0), key=lambda s: abs(np.log(s))):
        psi.data = float(scale) * given
        if (least_slacks() > 0).all() and np.isfinite(problem.cost()):
            break
    else:
        psi.data = given
        allowed = "a map of which some multiple has finite energy"
        if problem.slack_names:
            worst = problem.slack_names[int(np.argmin(least_slacks()))]
            allowed += f" and respects the limit of {worst}"
        raise InputError("start", problem.scene.start, allowed)
    room = np.minimum(0.1, least_slacks() / 2)
    dilate(problem, lambda: (least_slacks() >= room).all())
    factors = _sizes(problem) / sizes
    if recorder.log and (factors != 1).any():
        recorder.log("start multiplied by " + " and ".join(f"{factor:.3g}" for factor in factors))


def dilate(problem, allowed=lambda: True):
    """Dilate or shrink a stretched ψ, then ψ1 or ψ2 alone, as long as the cost falls.

    ψ → s ψ is the direction along which a far start loses energy fastest; Newton steps would take
    off a quarter of the stretch at a time.

    Parameters
    ----------
    problem : Lagrangian
        Its `state` is moved.
    allowed : callable, optional
        Whether the state is.
    """
    both = problem.state.components[:2]
    for components in (both, both[:1], both[1:]):
        for factor in (1.1, 1 / 1.1):
            while (cost := problem.cost()) > STRETCHED * problem.area:
                _multiply(components, factor)
                if not (problem.cost() < cost and allowed()):
                    _multiply(components, 1 / factor)
                    break


def _multiply(components, factor):
    for component in components:
        component.vec.data *= factor


def _sizes(problem):
    return np.array([component.vec.Norm() for component in problem.state.components[:2]])
