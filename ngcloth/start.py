"""The start of a solve: made feasible, and of a size from which Newton steps are few."""

import numpy as np

from .errors import InputError

STRETCHED = 10.0  # cost per area over kc above which a start is dilated
DISTORTED = 3.0  # ratio of mean stretches above which a start is undistorted


def feasible_start(problem, recorder):
    """Scale the start until it is feasible; undistort and dilate one that is stretched far.

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
    given = psi.CreateVector()
    given.data = psi
    undistorted = undistort(problem)
    sizes = _sizes(problem)
    if not _scale(problem):
        psi.data, undistorted = given, False
        sizes = _sizes(problem)
        if not _scale(problem):
            raise _infeasible(problem)
    room = np.minimum(0.1, _least_slacks(problem) / 2)
    dilate(problem, lambda: (_least_slacks(problem) >= room).all())
    factors = _sizes(problem) / sizes
    if recorder.log and undistorted:
        recorder.log("start followed by the linear map that makes C one in the mean")
    if recorder.log and (factors != 1).any():
        recorder.log("start multiplied by " + " and ".join(f"{factor:.3g}" for factor in factors))


def undistort(problem):
    """Let a distorted start be followed by the linear map that makes C one in the mean.

    Where the coordinates of a chart are sheared or of different scales, a start that is simple in
    them is far from any answer, along a curved valley that Newton steps take ever so slowly.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved if the mean C is far from isotropic, and the map lowers the cost.

    Returns
    -------
    bool
        Whether it was.
    """
    given = problem.cost()
    if not (problem.least_jacobian() > 0 and np.isfinite(given)):
        return False
    squares, axes = np.linalg.eigh(problem.mean_strain())
    if not squares[1] > DISTORTED**2 * squares[0] > 0:
        return False
    rows = [psi.vec.FV().NumPy() for psi in problem.state.components[:2]]
    kept = np.array(rows)
    rows[0][:], rows[1][:] = axes * np.sqrt(squares) @ axes.T @ kept
    if problem.cost() < given:
        return True
    rows[0][:], rows[1][:] = kept
    return False


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
        if (_least_slacks(problem) > 0).all() and np.isfinite(problem.cost()):
            return True
    psi.data = given
    return False


def _infeasible(problem):
    allowed = "a map of which some multiple has finite energy"
    if problem.slack_names:
        worst = problem.slack_names[int(np.argmin(_least_slacks(problem)))]
        allowed += f" and respects the limit of {worst}"
    return InputError("start", problem.scene.start, allowed)


def _least_slacks(problem):
    folded = not problem.least_jacobian() > 0
    return np.array([-np.inf if folded else c.min() for c in problem.slacks()])


def _multiply(components, factor):
    for component in components:
        component.vec.data *= factor


def _sizes(problem):
    return np.array([component.vec.Norm() for component in problem.state.components[:2]])
