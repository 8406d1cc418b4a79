"""Interior point: barrier loop around a filter line search along primal-dual Newton steps.

The method of Wächter and Biegler (2006), slack variables included, with all norms taken in the
function spaces, and the correctors of Mehrotra (1992) and Gondzio (1996). The matrix is regularised
by the pseudo-time term, 1/Δt times the flow's inner product, raised until the matrix is that of a
minimum, by its inertia, and the step has positive curvature (Chiang and Zavala, 2016), so that each
step is one of backward Euler along the gradient flow.
"""

import numpy as np

from ..result.history import Reason
from .saddle_system import SaddleSystem
from .start import near_start

FIRST_MU, WARM_MU = 1.0, 0.2  # of a solve from the scene's start, and from a coarser mesh
# A start of more energy per area over kc begins at this fraction of that energy as μ, but at no
# more than the last.
STRESSED, STRESSED_MU, LARGEST_FIRST_MU = 200.0, 0.02, 200.0
# 1/Δt. A rate that negative curvature or a refused step asks for is at least the second; above the
# third, v is given up, and rates do not last: the barrier's Hessian would no longer bend steps from
# the boundary.
LEAST_RATE, FIRST_RATE, LASTING_RATE, LARGEST_RATE = 1e-9, 3.0, 1e3, 1e6
HIGHER = 16  # times the rate that was too low
TO_BOUNDARY = 0.97  # a step may use up this fraction of a slack variable or a multiplier
# μ falls once the error of the equations is below so many μ; but below the second, while 1/Δt is
# above the third: a patch that slides slowly is far from where it will be.
NEARLY, NEARER, SLIDING = 30.0, 10.0, 10.0
# The first corrector takes off ds dz, up to so many μ, if that leaves this fraction of the length.
SECOND, SHORTENED = 3.0, 0.7
# A step that the boundary cuts to less than `CUT` gets at most so many correctors. Each aims for a
# step longer by `LONGER`, and for products s z within this factor of μ.
CORRECTORS, CUT, LONGER, CENTRED = 5, 0.9, 0.4, 10.0
CRUSHED = 0.3  # a step may not shrink the least J by more than this factor
LEAST_SLACK = 1e-2  # of slack variables at the start, times √μ below 1
SHORT, SHORT_STEPS, RAISE = 0.1, 3, 5.0  # after so many such steps in a row μ is raised
SLOW_STEPS = 8  # in a row at a 1/Δt that does not last, after which s and z begin anew
FAR = -0.1  # a patch from a coarser mesh that misses limits by more is no start
DUAL_RANGE = 1e10  # multipliers z are kept within this factor of μ/s, the value they tend to
SHORTEST = 1e-8
FORGET, REFUSALS = 4, 12  # refused steps in a row until the filter is emptied, until the end


def interior_point(problem, recorder, last_mu, phase="barrier", warm=False):
    """Minimise E under the scene's limits and equilibrium, by ever weaker barriers.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved.
    recorder : Recorder
        Keeps budget and history, and the memory of an earlier run to go on from.
    last_mu : float
        The barrier weight, relative to kc, at which to stop; in a scene without limits the
        tolerance.
    phase : str, optional
        The name of the rows of history.
    warm : bool, optional
        Whether `state` nearly is the solution at μ = `WARM_MU`, and not the scene's start.

    Returns
    -------
    Reason
    """
    if not (warm or recorder.memory):
        near_start(problem, recorder)
    stress = problem.cost() / problem.area
    if not problem.slack_names:  # no barrier to weaken
        iterate = Iterate(problem, last_mu)
    elif warm:
        iterate = Iterate(problem, max(WARM_MU, last_mu), rim_may_yield=True)
    elif stress > STRESSED:
        first_mu = min(STRESSED_MU * stress, LARGEST_FIRST_MU)
        iterate = Iterate(problem, first_mu)
    else:
        iterate = Iterate(problem, FIRST_MU)
    if recorder.memory:
        iterate.recall(recorder.memory)
    while not recorder.exhausted:
        error = iterate.error()
        near = error <= (NEARLY if iterate.rate < SLIDING else NEARER) * iterate.mu
        if iterate.mu > last_mu and near:
            iterate.lower_mu(last_mu)
            continue
        if iterate.mu <= last_mu and error <= iterate.mu and iterate.c.min(initial=1) > 0:
            return Reason.CONVERGED
        rate, length = iterate.step(recorder)
        if length > 0:
            told = {"length": length, "active": int((iterate.z > iterate.s).sum())}
            value = iterate.lagrangian()
            recorder.record(problem, phase, 1 / rate, value, error, **told, **iterate.memory())
        elif iterate.refusals > REFUSALS:
            return Reason.BLOCKED
    return recorder.why


class Iterate:
    """ψ, v, slack variables s and multipliers z, moved by primal-dual Newton steps.

    The slack variables stay positive all the way; c(ψ) = s, like equilibrium, holds at the end.
    Steps that keep c itself positive are cut by its curvature, and stall.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` holds ψ and v.
    mu : float
        The first barrier weight.
    rim_may_yield : bool, optional
        Whether to try, where the inertia is wrong, if that is the curvature of limits on the rim.
    """

    def __init__(self, problem, mu, rim_may_yield=False):
        self.problem, self.rim_may_yield, self.rim_yields = problem, rim_may_yield, False
        self.system = SaddleSystem(problem)
        self.largest_mu = max(mu, FIRST_MU)
        self.set_mu(mu)
        self._begin()
        self.rate, self.refusals = mu if problem.slack_names else 1.0, 0
        self.short_steps = self.slow_steps = 0
        vector = problem.state.vec
        self._before, self._force, self._cost_gradient, self._psi_step = (
            vector.CreateVector() for _ in range(4)
        )

    def _begin(self):
        """Set s and z to what the slacks c of the current ψ suggest."""
        self.c = self.problem.slacks()
        self.s = np.maximum(self.c, LEAST_SLACK * min(np.sqrt(self.mu), 1))
        self.z = self.mu / self.s
        self._largest_violation = 1e4 * max(1.0, self._violation())

    def set_mu(self, mu):
        """Set the barrier's weight, and empty the filter: the objective has changed."""
        self.mu = self.problem.mu = mu
        self._filter = []

    def lower_mu(self, last_mu):
        """Weaken the barrier; the weight so far is the largest to which it may be raised again."""
        self.largest_mu = self.mu
        lower = min(0.2 * self.mu, self.mu**1.5)
        self.set_mu(lower if lower >= 2 * last_mu else last_mu)

    def memory(self):
        """What a later process needs to go on from here, beside the state."""
        return {
            "mu": self.mu,
            "s": self.s,
            "z": self.z,
            "rate": self.rate,
            "rim_may_yield": self.rim_may_yield,
            "rim_yields": self.rim_yields,
            "largest_mu": self.largest_mu,
            "filter": np.reshape(self._filter, (-1, 2)),
            "largest_violation": self._largest_violation,
        }

    def recall(self, memory):
        """Go on from where `memory` was taken."""
        self.set_mu(float(memory["mu"]))
        self.s, self.z, self.rate = memory["s"], memory["z"], float(memory["rate"])
        self.rim_may_yield = bool(memory["rim_may_yield"])
        self.rim_yields = bool(memory["rim_yields"])
        self.largest_mu = float(memory["largest_mu"])
        self._filter = [tuple(pair) for pair in memory["filter"]]
        self._largest_violation = float(memory["largest_violation"])

    def lagrangian(self):
        """The Lagrangian, barrier included, over kc, over the meshed domain."""
        return self._objective() + self.problem.work()

    def error(self):
        """The largest of stationarity, imbalance, c − s and complementarity, per area."""
        problem = self.problem
        forces = problem.stationarity(self.z), problem.imbalance()
        # A multiplier is known to the rounding of its slack, times z/s.
        noise = np.finfo(float).eps * (self.z / self.s).max(initial=0)
        return max(
            max(forces) / np.sqrt(problem.area) - noise,
            np.abs(self.c - self.s).max(initial=0),
            np.abs(self.s * self.z - self.mu).max(initial=0),
        )

    def step(self, recorder):
        """Try one step. Returns its 1/Δt and its accepted length, 0 if it was refused."""
        ds, dz = self._direction(recorder)
        dual_length = _to_boundary(self.z, dz)
        used, length = self.rate, self._line_search(ds, dual_length)
        if length == 0:
            self.rate = min(max(HIGHER * self.rate, FIRST_RATE), LARGEST_RATE)
            self.refusals += 1
            if self.refusals == FORGET:  # pairs left long ago may shut in the iterate
                self._filter, self.rate = [], 1.0
            return used, 0.0
        self.refusals = 0
        self.z += dual_length * dz
        target = self.mu / self.s
        np.clip(self.z, target / DUAL_RANGE, target * DUAL_RANGE, out=self.z)
        if length > 0.5:
            self.rate /= 2
        self.rate = min(max(self.rate, LEAST_RATE), LASTING_RATE)
        self._retreat_if_stuck(used, length)
        return used, length

    def _retreat_if_stuck(self, rate, length):
        """Return to a stronger barrier after steps in a row that were cut short, or slow."""
        self.short_steps = self.short_steps + 1 if length < SHORT else 0
        self.slow_steps = self.slow_steps + 1 if rate > LASTING_RATE else 0
        short = self.short_steps == SHORT_STEPS and self.mu < self.largest_mu / 2
        slow = self.slow_steps == SLOW_STEPS
        if not (self.problem.slack_names and (short or slow)):
            return
        self.set_mu(min(RAISE * self.mu, self.largest_mu))
        self.rate, self.short_steps = min(self.rate, 1.0), 0
        if slow:
            # Where limits leave hardly any room between them, z has grown beyond what any 1/Δt
            # makes up for.
            self.problem.unknowns[self.problem.psi_dofs.stop :] = 0
            self._begin()
            self.slow_steps = 0

    def _direction(self, recorder):
        """Solve for the step in ψ and v, and return that of s and z."""
        self.problem.cost_gradient(self._cost_gradient)
        solve = self._regularised(recorder)
        ds, dz = self._slack_step(self.mu)
        if ds.size and np.isfinite(ds).all():
            ds, dz = self._corrected(solve, ds, dz)
        self._project(self.problem.direction.vec)
        return ds, dz

    def _force_toward(self, products):
        """Set the force whose Newton step takes s z to `products`, with ds and dz eliminated."""
        pressure = products / self.s - self.z / self.s * (self.c - self.s)
        self.problem.gradient(pressure, self._force)

    def _slack_step(self, products):
        ds = self.problem.slack_changes() + self.c - self.s
        return ds, products / self.s - self.z - self.z / self.s * ds

    def _project(self, direction):
        self._psi_step.data = direction
        self._psi_step.FV().NumPy()[self.problem.psi_dofs.stop :] = 0

    def _regularised(self, recorder):
        """Solve with a rate at which ψ tends to a minimum; return the solver."""
        problem, given = self.problem, self.rate
        v = problem.unknowns[problem.psi_dofs.stop :]
        matrix, added = self._linearised(), 0.0
        while True:
            matrix.AsVector().data += (self.rate - added) * problem.flow.AsVector()
            added = self.rate
            solve = self.system.solver(matrix)
            solve(self._force, problem.direction.vec)
            problem.direction.vec.data *= -1
            recorder.newton += 1
            tends = self._tends_to_minimum(matrix)
            if tends or recorder.exhausted or self.rate > LARGEST_RATE:
                return solve
            if self.rim_may_yield and not self.rim_yields:
                # New triangles at the rim, where threads touch it, bend by the limits there, each
                # by itself; a 1/Δt that makes up for that would slow down the whole cloth.
                self.rim_yields = True
                matrix, added = self._linearised(), 0.0
                continue
            if self.rim_yields:  # it is not the rim, or no longer
                self.rim_may_yield = self.rim_yields = False
                matrix, added = self._linearised(), 0.0
            self.rate = max(HIGHER * self.rate, FIRST_RATE)
            if self.rate > LASTING_RATE and v.any():
                # Far from equilibrium v can bend the Lagrangian by more than E does, and no rate
                # makes up for it. The filter does not see v, so that it may begin again.
                v[:] = 0
                matrix, added, self.rate = self._linearised(), 0.0, given

    def _linearised(self):
        """Set the force toward μ, and return the matrix without the pseudo-time term."""
        self._force_toward(self.mu)
        bending = self.problem.inside * self.z if self.rim_yields else self.z
        return self.problem.hessian(bending, self.z / self.s)

    def _tends_to_minimum(self, matrix):
        """Whether the step in ψ has positive curvature, and what keeps equilibrium has it too."""
        problem, psi_step = self.problem, self._psi_step
        self._project(problem.direction.vec)
        curvature = psi_step.InnerProduct((matrix * psi_step).Evaluate())
        size = psi_step.InnerProduct((problem.flow * psi_step).Evaluate())
        return curvature > 1e-8 * size and self.system.is_minimum()

    def _corrected(self, solve, ds, dz):
        """Correct a step for what its products s z miss: solve again with the same matrix.

        First for their second order, ds dz (Mehrotra, 1992). Then, if few slack variables cut the
        step short, for what takes s z far from μ on a longer one (Gondzio, 1996), on top of what
        was corrected before.
        """
        length, products = _to_boundary(self.s, ds), self.mu
        missing = np.clip(-ds * dz, -SECOND * self.mu, SECOND * self.mu)
        corrected = self._step_toward(solve, products + missing, SHORTENED * length)
        if corrected:
            (ds, dz, length), products = corrected, products + missing
        for _ in range(CORRECTORS):
            if length >= CUT:
                break
            aim = min(1.0, length + LONGER)
            reached = (self.s + aim * ds) * (self.z + aim * dz)
            centred = np.clip(reached, self.mu / CENTRED, self.mu * CENTRED)
            missing = np.maximum(centred - reached, -self.mu * CENTRED)
            corrected = self._step_toward(solve, products + missing, length)
            if not corrected:
                break
            (ds, dz, length), products = corrected, products + missing
        return ds, dz

    def _step_toward(self, solve, products, length):
        """The step to other products, as ds, dz and length, if it is longer than `length`.

        Else None, and `direction` is as it was.
        """
        direction = self.problem.direction.vec
        kept = direction.CreateVector()
        kept.data = direction
        self._force_toward(products)
        solve(self._force, direction)
        direction.data *= -1
        ds, dz = self._slack_step(products)
        new_length = _to_boundary(self.s, ds)
        if new_length > length:
            return ds, dz, new_length
        direction.data = kept
        return None

    def _line_search(self, ds, dual_length):
        """Move ψ and s by the first acceptable length, by halves; 0 if there is none.

        v goes as far as the other multipliers, z: forces of both are in balance along a step.
        """
        problem, state = self.problem, self.problem.state.vec
        old, least_jacobian = (self._objective(), self._violation()), problem.least_jacobian()
        slope = self._cost_gradient.InnerProduct(self._psi_step)
        slope -= self.mu * (problem.weights * ds / self.s).sum()
        self._before.data = state
        before, length = (self.s, self.c), _to_boundary(self.s, ds)
        while length > SHORTEST:
            state.data = self._before + dual_length * problem.direction.vec
            state.data += (length - dual_length) * self._psi_step
            if problem.least_jacobian() > CRUSHED * least_jacobian:
                self.s, self.c = before[0] + length * ds, problem.slacks()
                if self._acceptable(length, slope, old, (self._objective(), self._violation())):
                    # A slack variable below its slack may grow to it: everything gains.
                    self.s = np.maximum(self.s, self.c)
                    return length
            length /= 2
        state.data = self._before
        self.s, self.c = before
        return 0.0

    def _objective(self):
        return self.problem.cost() - self.mu * (self.problem.weights * np.log(self.s)).sum()

    def _violation(self):
        """Size of what must vanish: imbalance, and c − s."""
        gap = np.sqrt((self.problem.weights * (self.c - self.s) ** 2).sum())
        return self.problem.imbalance() + gap

    def _acceptable(self, length, slope, old, new):
        """The filter's test; it takes in the old point where feasibility was the gain."""
        (objective, violation), (new_objective, new_violation) = old, new
        if not (np.isfinite(new_objective) and new_violation < self._largest_violation):
            return False
        if any(
            new_violation >= (1 - 1e-5) * v and new_objective >= o - 1e-5 * v
            for o, v in self._filter
        ):
            return False
        descent = slope < 0 and (-slope) ** 2.3 * length > violation**1.1
        if descent and new_objective <= objective + 1e-4 * length * slope + 1e-13 * abs(objective):
            return True
        if descent and violation < 1e-4:
            return False
        if new_violation <= (1 - 1e-5) * violation or new_objective <= objective - 1e-5 * violation:
            self._filter.append((objective - 1e-5 * violation, (1 - 1e-5) * violation))
            return True
        return False


def _to_boundary(values, changes):
    """The longest step, at most 1, along which no value loses more than `TO_BOUNDARY` of itself."""
    falling = changes < 0
    ratios = TO_BOUNDARY * values[falling] / -changes[falling]
    # A Python number: NumPy's does not multiply a vector of NGSolve as one would think.
    return float(ratios.min(initial=1.0))
