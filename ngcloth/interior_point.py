"""Interior point: barrier loop around a filter line search along primal-dual Newton steps.

The method of Wächter and Biegler (2006) with two changes. Slacks are functions of ψ, not unknowns:
every iterate is strictly feasible. And the matrix is regularised by the pseudo-time term, 1/Δt
times the flow's inner product, raised until the step has positive curvature (Chiang and Zavala,
2016), so that each step is one of backward Euler along the gradient flow.
"""

import numpy as np

from .errors import InputError
from .history import Reason

FIRST_MU = 1.0
# 1/Δt. Above the largest, the barrier's Hessian no longer bends steps away from the boundary.
LEAST_RATE, LARGEST_RATE = 1e-9, 1e2
TO_BOUNDARY = 0.99  # a step may use up this fraction of a slack or a multiplier
STRETCHED = 10.0  # energy per area over kc above which a start is dilated
SHORTEST = 1e-6
REFUSALS = 12


def interior_point(problem, recorder, last_mu):
    """Minimise E under the scene's limits and equilibrium, by ever weaker barriers.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved; it is strictly feasible throughout.
    recorder : Recorder
    last_mu : float
        The barrier weight, relative to kc, at which to stop.

    Returns
    -------
    Reason
    """
    problem.set_mu(FIRST_MU)
    slacks = feasible_start(problem, recorder)
    for z, c in zip(problem.multipliers(), slacks, strict=True):
        z[:] = problem.mu / c
    steps = FilterSteps(problem, slacks)
    while not recorder.exhausted:
        error = steps.error()
        while error <= (10 * problem.mu if problem.mu > last_mu else problem.mu):
            if problem.mu <= last_mu:
                return Reason.CONVERGED
            problem.set_mu(max(min(0.2 * problem.mu, problem.mu**1.5), last_mu))
            steps.forget()
            error = steps.error()
        rate, accepted = steps.step(recorder)
        if accepted:
            recorder.record(problem, "barrier", 1 / rate, error)
        elif steps.refusals > REFUSALS:
            return Reason.BLOCKED
    return Reason.STEP_BUDGET


def feasible_start(problem, recorder):
    """Scale the start until it is feasible; dilate one that is stretched many times over.

    Dilation ψ → s ψ is the direction along which such a start loses energy fastest; Newton steps
    would take off a quarter of the stretch at a time.

    Returns
    -------
    list of ndarray
        The slacks at the start.

    Raises
    ------
    InputError
        If no multiple of the start is feasible.
    """
    psi = problem.state.vec
    given = psi.CreateVector()
    given.data = psi

    def least_slacks():
        folded = not problem.least_jacobian() > 0
        return np.array([-np.inf if folded else c.min() for c in problem.slacks_here()])

    for scale in sorted(1.25 ** np.arange(-30.0, 31.0), key=lambda s: abs(np.log(s))):
        psi.data = scale * given
        if (least_slacks() > 0).all():
            break
    else:
        psi.data = given
        worst = problem.slack_names[int(np.argmin(least_slacks()))]
        allowed = f"a map of which some multiple respects the limit of {worst}"
        raise InputError("start", problem.scene.start, allowed)
    room = np.minimum(0.1, least_slacks() / 2)
    while problem.cost() > STRETCHED * problem.area:
        psi.data *= 1.1
        if not (least_slacks() >= room).all():
            psi.data *= 1 / 1.1
            break
        scale *= 1.1
    if scale != 1 and recorder.log:
        recorder.log(f"start multiplied by {scale:.3g}")
    return problem.slacks_here()


class FilterSteps:
    """Primal-dual Newton steps, accepted by a filter on objective and imbalance.

    Parameters
    ----------
    problem : ConstrainedLagrangian
    slacks : list of ndarray
        Values of its slacks at the current state.
    """

    def __init__(self, problem, slacks):
        self.problem, self.slacks = problem, slacks
        self.rate, self.refusals = 1.0, 0
        self._filter = []
        problem.freeze(slacks)
        vector = problem.state.vec
        self._before, self._gradient, self._barrier_gradient, self._psi_step = (
            vector.CreateVector() for _ in range(4)
        )
        self._largest_imbalance = 1e4 * max(1.0, problem.imbalance())

    def forget(self):
        """Empty the filter: the objective has changed."""
        self._filter = []

    def error(self):
        """The largest of stationarity, imbalance and complementarity, per area."""
        problem = self.problem
        gaps = zip(self.slacks, problem.multipliers(), strict=True)
        gap = max(np.abs(c * z - problem.mu).max() for c, z in gaps)
        return max(problem.dual_residual(), problem.imbalance() / np.sqrt(problem.area), gap)

    def step(self, recorder):
        """Try one step. Returns its 1/Δt and whether the state has moved."""
        problem = self.problem
        self._compute_direction(recorder)
        changes = problem.slack_changes()
        used = self.rate
        self._before.data = problem.state.vec
        length, slacks = self._line_search()
        if length == 0:
            problem.state.vec.data = self._before
            self.rate = min(max(8 * self.rate, 1e-3), 1e6)
            self.refusals += 1
            return used, False
        self._move_multipliers(changes)
        self.slacks, self.refusals = slacks, 0
        problem.freeze(slacks)
        problem.bound_multipliers(slacks)
        if length > 0.5:
            self.rate *= 0.1
        elif length < 0.1:
            self.rate = max(4 * self.rate, 1e-4)
        self.rate = min(max(self.rate, LEAST_RATE), LARGEST_RATE)
        return used, True

    def _compute_direction(self, recorder):
        """Solve for the step, with a rate at which its part in ψ has positive curvature."""
        problem = self.problem
        problem.gradient(self._gradient)
        problem.objective_gradient(self._barrier_gradient)
        direction, psi_step = problem.direction.vec, self._psi_step
        matrix = problem.hessian()
        added = 0.0
        while True:
            matrix.AsVector().data += (self.rate - added) * problem.flow.AsVector()
            added = self.rate
            inverse = matrix.Inverse(problem.free, inverse=problem.inverse)
            direction.data = -inverse * self._gradient
            recorder.newton += 1
            psi_step.data = direction
            psi_step.FV().NumPy()[problem.psi_dofs.stop :] = 0
            curvature = psi_step.InnerProduct((matrix * psi_step).Evaluate())
            size = psi_step.InnerProduct((problem.flow * psi_step).Evaluate())
            if curvature > 1e-8 * size or recorder.exhausted:
                return
            self.rate = max(4 * self.rate, 1e-4)

    def _line_search(self):
        problem = self.problem
        objective, imbalance = problem.objective(), problem.imbalance()
        slope = self._barrier_gradient.InnerProduct(self._psi_step)
        length = 1.0
        while length > SHORTEST:
            problem.state.vec.data = self._before + length * problem.direction.vec
            slacks = problem.slacks_here()
            if problem.least_jacobian() > 0 and all(
                (new >= (1 - TO_BOUNDARY) * old).all()
                for new, old in zip(slacks, self.slacks, strict=True)
            ):
                new = problem.objective(), problem.imbalance()
                if self._acceptable(length, slope, (objective, imbalance), new):
                    return length, slacks
            length /= 2
        return 0.0, None

    def _acceptable(self, length, slope, old, new):
        """The filter's test; it takes in the old point where feasibility was the gain."""
        (objective, imbalance), (new_objective, new_imbalance) = old, new
        if not (np.isfinite(new_objective) and new_imbalance < self._largest_imbalance):
            return False
        if any(
            new_imbalance >= (1 - 1e-5) * i and new_objective >= o - 1e-5 * i
            for o, i in self._filter
        ):
            return False
        descent = slope < 0 and (-slope) ** 2.3 * length > imbalance**1.1
        if descent and new_objective <= objective + 1e-4 * length * slope + 1e-13 * abs(objective):
            return True
        if descent and imbalance < 1e-4:
            return False
        if new_imbalance <= (1 - 1e-5) * imbalance or new_objective <= objective - 1e-5 * imbalance:
            self._filter.append((objective - 1e-5 * imbalance, (1 - 1e-5) * imbalance))
            return True
        return False

    def _move_multipliers(self, changes):
        """z + α dz, α short of the first z that would vanish."""
        problem, length = self.problem, 1.0
        multipliers, steps = problem.multipliers(), []
        for z, c, dc in zip(multipliers, self.slacks, changes, strict=True):
            dz = problem.mu / c - z - z / c * dc
            falling = dz < 0
            if falling.any():
                length = min(length, (TO_BOUNDARY * z[falling] / -dz[falling]).min())
            steps.append(dz)
        for z, dz in zip(multipliers, steps, strict=True):
            z += length * dz
