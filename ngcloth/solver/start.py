"""The start of a solve: as rigid as it gets, feasible if it can be, of a size that saves steps."""

from operator import itemgetter

import numpy as np

from ..errors import InputError

STRETCHED = 10.0  # cost per area over kc above which a start is dilated
RIGID_STEPS = 30  # at most; they go on while each lowers the cost


def near_start(problem, recorder):
    """Scale the start, or what comes of flattening it, whichever is then nearer to the answer.

    Nearer is what misses limits by less; of two that are feasible, the one where cost per area and
    imbalance, both over kc, have the smaller sum. Slack variables lead on where neither is.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved.
    recorder : Recorder
        Logs by how much.

    Raises
    ------
    InputError
        If no multiple of the start has finite energy and slacks.
    """
    psi = problem.state.vec
    given, flat = psi.CreateVector(), psi.CreateVector()
    given.data = psi
    flatten(problem)
    flat.data = psi
    candidates = [_best_multiple(problem, start) for start in (given, flat)]
    (missed, _), nearest, factors = min(candidates, key=itemgetter(0))
    if missed == np.inf:
        psi.data = given
        raise _infeasible(problem)
    psi.data = nearest
    if recorder.log and nearest is candidates[1][1]:
        recorder.log("start made as rigid as possible")
    if recorder.log and (factors != 1).any():
        recorder.log("start multiplied by " + " and ".join(f"{factor:.3g}" for factor in factors))


def feasible_start(problem):
    """Scale the start until it is feasible, and dilate it if it is stretched far.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved.

    Raises
    ------
    InputError
        If no multiple of the start is feasible.
    """
    if _scale(problem) > 0:
        raise _infeasible(problem)


def flatten(problem):
    """Take rigid steps from the start, and go on as long as the cost falls.

    They come near an isometry along which Newton steps would have to follow a curved valley, be it
    from a stretched start or one on sheared or uneven coordinates.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved.
    """
    psi, last = problem.state.vec, np.inf
    before = psi.CreateVector()
    for _ in range(RIGID_STEPS):
        before.data = psi
        problem.rigid_step()
        cost = problem.cost()
        if not (problem.least_jacobian() > 0 and cost < last):
            psi.data = before
            break
        last = cost


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


def _scale(problem):
    """Scale the state to miss limits by as little as it can, and dilate it; by how much it does.

    Of multiples that are feasible the nearest is taken. What is missed is infinite if there is none
    with J > 0 and finite numbers; then the state is as it was.
    """
    psi = problem.state.vec
    given, best, least = psi.CreateVector(), psi.CreateVector(), np.inf
    given.data = best.data = psi
    for scale in sorted(1.25 ** np.arange(-30.0, 31.0), key=lambda s: abs(np.log(s))):
        psi.data = float(scale) * given
        missed = _missed(problem)
        if missed < least:
            best.data, least = psi, missed
        if least == 0:
            break
    psi.data = best
    if least < np.inf:
        slacks = _least_slacks(problem)
        room = np.minimum(0.1, np.where(slacks > 0, slacks / 2, slacks))
        dilate(problem, lambda: (_least_slacks(problem) >= room).all())
    return least


def _best_multiple(problem, start):
    """How far from the answer the best multiple of a start is, what it is, and by which factors.

    The distance is a pair: by how much limits are missed, and cost and imbalance.
    """
    psi = problem.state.vec
    psi.data = start
    sizes, distance = _sizes(problem), np.inf
    missed = _scale(problem)
    if missed < np.inf:
        distance = problem.cost() / problem.area + problem.imbalance() / np.sqrt(problem.area)
    multiple = psi.CreateVector()
    multiple.data = psi
    return (missed, distance), multiple, _sizes(problem) / sizes


def _infeasible(problem):
    allowed = "a map of which some multiple has finite energy"
    if problem.slack_names:
        worst = problem.slack_names[int(np.argmin(_least_slacks(problem)))]
        allowed += f" and respects the limit of {worst}"
    return InputError("start", problem.scene.start, allowed)


def _missed(problem):
    """By how much limits are missed: 0 if all slacks are positive, infinite for a folded cloth."""
    least = _least_slacks(problem).min(initial=np.inf)
    known = np.isfinite(problem.cost()) and np.isfinite(problem.slacks()).all()
    if not (known and problem.least_jacobian() > 0):
        return np.inf
    return 0.0 if least > 0 else -least + np.finfo(float).tiny


def _least_slacks(problem):
    folded = not problem.least_jacobian() > 0
    return np.array([-np.inf if folded else c.min() for c in problem.slacks()])


def _multiply(components, factor):
    for component in components:
        component.vec.data *= factor


def _sizes(problem):
    return np.array([component.vec.Norm() for component in problem.state.components[:2]])
