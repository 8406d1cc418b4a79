"""The start of a solve: as rigid as it gets, feasible, and of a size from which steps are few."""

from operator import itemgetter

import numpy as np

from ..errors import InputError

STRETCHED = 10.0  # cost per area over kc above which a start is dilated
# Rigid steps go on while each lowers the cost to less than this fraction; but no more of them.
WORTHWHILE, RIGID_STEPS = 0.99, 30


def near_start(problem, recorder):
    """Make the start feasible, or what comes of flattening it, whichever is nearer to the answer.

    Nearer is where cost per area and imbalance, both over kc, have the smaller sum.

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
    psi = problem.state.vec
    given, flat = psi.CreateVector(), psi.CreateVector()
    given.data = psi
    flatten(problem)
    flat.data = psi
    candidates = [_feasible_multiple(problem, start) for start in (given, flat)]
    distance, nearest, factors = min(candidates, key=itemgetter(0))
    if distance == np.inf:
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
    if not _make_feasible(problem):
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
        if not (problem.least_jacobian() > 0 and cost < WORTHWHILE * last):
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
    """Set the state to the nearest multiple that is feasible, if there is one; whether there is."""
    psi = problem.state.vec
    given = psi.CreateVector()
    given.data = psi
    for scale in sorted(1.25 ** np.arange(-30.0, 31.0), key=lambda s: abs(np.log(s))):
        psi.data = float(scale) * given
        if _feasible(problem):
            return True
    psi.data = given
    return False


def _make_feasible(problem):
    """Scale and dilate the state; whether some multiple of it is feasible."""
    if not _scale(problem):
        return False
    room = np.minimum(0.1, _least_slacks(problem) / 2)
    dilate(problem, lambda: (_least_slacks(problem) >= room).all())
    return True


def _feasible_multiple(problem, start):
    """How far from the answer a start is once it is feasible, what it is then, by which factors.

    The distance is infinite for one that cannot be made feasible.
    """
    psi = problem.state.vec
    psi.data = start
    sizes, distance = _sizes(problem), np.inf
    if _make_feasible(problem):
        distance = problem.cost() / problem.area + problem.imbalance() / np.sqrt(problem.area)
    multiple = psi.CreateVector()
    multiple.data = psi
    return distance, multiple, _sizes(problem) / sizes


def _infeasible(problem):
    allowed = "a map of which some multiple has finite energy"
    if problem.slack_names:
        worst = problem.slack_names[int(np.argmin(_least_slacks(problem)))]
        allowed += f" and respects the limit of {worst}"
    return InputError("start", problem.scene.start, allowed)


def _feasible(problem):
    return (_least_slacks(problem) > 0).all() and np.isfinite(problem.cost())


def _least_slacks(problem):
    folded = not problem.least_jacobian() > 0
    return np.array([-np.inf if folded else c.min() for c in problem.slacks()])


def _multiply(components, factor):
    for component in components:
        component.vec.data *= factor


def _sizes(problem):
    return np.array([component.vec.Norm() for component in problem.state.components[:2]])
