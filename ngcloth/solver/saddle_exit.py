"""A way out of a saddle: along the change of the patch, in equilibrium, by which it falls most."""

from functools import partial

import numpy as np

from ..result.lanczos import lanczos

# Curvature that counts as zero: of the root of cost per area, about 1 % of the stress; without
# limits of the cost per area, by which turning the cloth changes it.
FLAT, FLAT_WITHOUT_LIMITS = 0.04, 0.02
LEAST_FLAT, STEEPEST = 1e-6, 1e6
FAR = 0.1  # the change of ∇ψ, root mean square, of a step off a saddle


def leave_saddle(problem, system, matrix):
    """Move ψ off a saddle, to the side on which the cost is lower.

    Parameters
    ----------
    problem : ConstrainedLagrangian or Lagrangian
        At a stationary point. Its `state` is moved if that is a saddle.
    system : SaddleSystem
        Of the problem.
    matrix : BaseMatrix
        The Hessian of the Lagrangian, without pseudo-time; it is changed.

    Returns
    -------
    bool
        Whether it was a saddle and has been left.
    """
    direction = _falling(problem, system, matrix)
    if direction is None:
        return False
    state, best = problem.state.vec, np.inf
    before, found = state.CreateVector(), None
    before.data = state
    for length in (FAR, -FAR):
        state.data = before + length * float(np.sqrt(problem.area)) * direction
        if problem.least_jacobian() > 0 and problem.cost() < best:
            best, found = problem.cost(), problem.unknowns.copy()
    if found is None:
        state.data = before
        return False
    problem.unknowns[:] = found
    problem.unknowns[problem.psi_dofs.stop :] = 0
    return True


def _falling(problem, system, matrix):
    """The change of ψ, of norm 1, of least curvature; None where that is not negative."""
    cost = abs(problem.cost()) / problem.area
    flat = FLAT * np.sqrt(cost) if problem.slack_names else FLAT_WITHOUT_LIMITS * cost
    shift, added = max(flat, LEAST_FLAT), 0.0
    while shift < STEEPEST:
        matrix.AsVector().data += (shift - added) * problem.flow.AsVector()
        solve = system.solver(matrix)
        if system.is_minimum():
            break
        shift, added = 4 * shift, shift
    if added == 0 or shift >= STEEPEST:
        return None
    # About a shift below all eigenvalues, the least is the one that the inverse makes greatest.
    direction = problem.state.vec.CreateVector()
    given, image = direction.CreateVector(), direction.CreateVector()

    def times(multiply, vector):
        given.FV().NumPy()[:] = vector
        multiply(given, image)
        return image.FV().NumPy().copy()

    solved, norm = partial(times, solve), partial(times, problem.flow.Mult)
    direction.FV().NumPy()[:] = lanczos(solved, norm, direction.size)[1]
    direction.FV().NumPy()[problem.psi_dofs.stop :] = 0
    size = np.sqrt(direction.InnerProduct((problem.flow * direction).Evaluate()))
    direction.data *= float(1 / size)
    return direction
