"""The paper's own schedule (its Fig. 3): nested loops of barrier, pseudo-time and Newton."""

import numpy as np

from ..result.history import Reason
from .saddle_system import SaddleSystem
from .start import feasible_start

FIRST_MU = 10.0
TIME_STEP = 0.1
NEWTON = 30  # steps to solve one backward Euler equation
RESIDUAL = 1e-6  # of the first one at which it counts as solved
SHORTEST = 2.0**-20


def saddle_flow(problem, recorder, last_mu, tolerance):
    """Flow to rest under ever weaker barriers, by backward Euler steps of one size.

    With the first barrier weight v flows as well, upwards (eq. 24); later ones keep equilibrium
    exactly (eq. 23). Weights are halved, from 10 on; barriers are primal, z = μ/c.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved; the slacks stay positive.
    recorder : Recorder
        Takes each accepted step, and keeps the budget.
    last_mu : float
        The barrier weight, relative to kc, at which to stop.
    tolerance : float
        Rest is where |∂t L|/(2π kc) is below it.

    Returns
    -------
    Reason
    """
    problem.mu, relaxed = FIRST_MU, True
    if recorder.memory:
        problem.mu, relaxed = (recorder.memory[name].item() for name in ("mu", "relaxed"))
    else:
        feasible_start(problem)
    anchor, system = problem.state.vec.CreateVector(), SaddleSystem(problem)
    while not recorder.exhausted:
        anchor.data = problem.state.vec
        before = _lagrangian(problem)
        length = _euler_step(problem, system, recorder, anchor, relaxed)
        if length == 0:
            return recorder.why if recorder.exhausted else Reason.STALLED
        now = _lagrangian(problem)
        slope = recorder.unit * abs(now - before) / TIME_STEP
        phase, memory = "saddle" if relaxed else "flow", {"mu": problem.mu, "relaxed": relaxed}
        told = {"length": length, "active": int((problem.slacks() ** 2 < problem.mu).sum())}
        recorder.record(problem, phase, TIME_STEP, now, slope, **told, **memory)
        if slope <= tolerance:
            if problem.mu <= last_mu:
                return Reason.CONVERGED
            problem.mu, relaxed = max(problem.mu / 2, last_mu), False
    return recorder.why


def _lagrangian(problem):
    barrier = (problem.weights * np.log(problem.slacks())).sum()
    return problem.cost() + problem.work() - problem.mu * barrier


def _euler_step(problem, system, recorder, anchor, relaxed):
    """Solve one backward Euler equation by damped Newton steps.

    Returns the least accepted length of these; 0 if they did not succeed.
    """
    state = problem.state.vec
    residual, before, pull = (state.CreateVector() for _ in range(3))
    inertia = [(problem.flow, 1.0)] + ([(problem.multiplier_flow, -1.0)] if relaxed else [])

    def size():
        """Residual of the equation, and its norm; infinite off the feasible set."""
        c = problem.slacks()
        if not (problem.least_jacobian() > 0 and c.min() > 0):
            return np.inf
        problem.gradient(problem.mu / c, residual)
        for matrix, sign in inertia:
            pull.data = state - anchor
            residual.data += sign / TIME_STEP * (matrix * pull)
        return problem.dual_norm(residual)

    first = error = size()
    least = 1.0
    for _ in range(NEWTON):
        if error <= RESIDUAL * first or recorder.exhausted:
            break
        c = problem.slacks()
        matrix = problem.hessian(problem.mu / c, problem.mu / c**2)
        for added, sign in inertia:
            matrix.AsVector().data += sign / TIME_STEP * added.AsVector()
        system.solver(matrix)(residual, problem.direction.vec)
        recorder.newton += 1
        before.data, length = state, 1.0
        while length > SHORTEST:
            state.data = before - length * problem.direction.vec
            new = size()
            if new < error:
                break
            length /= 2
        else:
            state.data = before
            size()
            return 0.0
        error, least = new, min(least, length)
    return least if error <= 1e-2 * first else 0.0
