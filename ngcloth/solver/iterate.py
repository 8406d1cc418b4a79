"""An iterate of the interior point, moved by a filter line search along primal-dual Newton steps.

The method of Wächter and Biegler (2006), slack variables included, with all norms taken in the
function spaces, and the correctors of Mehrotra (1992) and Gondzio (1996). The matrix is regularised
by the pseudo-time term, 1/Δt times the flow's inner product, raised until the matrix is that of a
minimum, by its inertia, and the step has positive curvature (Chiang and Zavala, 2016), so that each
step is one of backward Euler along the gradient flow.
"""

import numpy as np

from .barrier import lower_weight
from .exchange import missed_points
from .line_search import Filter, to_boundary
from .saddle_exit import leave_saddle
from .saddle_system import SaddleSystem

HIGHER = 16  # times the 1/Δt that was too low
# Above this 1/Δt v is given up, and rates do not last: the barrier's Hessian would no longer bend
# steps from the boundary.
LASTING_RATE = 1e3
# μ falls once the error of the equations is below so many μ; but below `CENTRED` μ, while 1/Δt is
# above `HIGHER`: a patch that slides slowly is far from where it will be.
NEARLY = 30.0
# Correctors of products s z: one for their second order, by at most μ, since a larger one could
# keep products for ever where multipliers are not unique; then at most so many for a step longer
# by `LONGER`, to within `CENTRED` times μ.
CORRECTORS, LONGER, CENTRED = 5, 0.4, 10.0
SETTLED, ROUND_OFF = 1e-2, 1e-18  # of a cost: how far it may still fall; and per area
LEAST_SLACK = 1e-2  # of slack variables at the start, times √μ below 1
PATIENCE = 8  # steps in a row above `LASTING_RATE`, then s and z begin anew; refused ones, the end


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
    """

    kept = "mu", "mu_before", "rate", "s", "z"  # in checkpoints

    def __init__(self, problem, mu):
        self.problem = problem
        self.system = SaddleSystem(problem)
        self.mu_before, self.rate, self.refusals, self.slow_steps = mu, 1.0, 0, 0
        self._curvature, self._in_sight = np.nan, np.inf  # along the last step; see `at_rest`
        self._begin(mu)
        vectors = (problem.state.vec.CreateVector() for _ in range(5))
        self._before, self._load, self._cost_gradient, self._psi_step, self._missed = vectors

    def _begin(self, mu):
        """Set s and z to what c(ψ) suggests, for a barrier of this weight."""
        self.mu = self.problem.mu = mu
        self.c = self.problem.slacks()
        self.s = self._slack_variables(self.c)
        self.z = self.mu / self.s
        self.filter = Filter(self._violation())

    def _slack_variables(self, slacks):
        return np.maximum(slacks, LEAST_SLACK * min(np.sqrt(self.mu), 1))

    def exchange(self):
        """Ask limits where they are missed between the points; whether there are such places."""
        if not self.problem.slack_names:
            return False
        self.problem.add_limit_points(missed_points(self.problem))
        known, self.c = self.c.shape[1], self.problem.slacks()
        added = self._slack_variables(self.c[:, known:])
        self.s = np.concatenate([self.s, added], axis=1)
        self.z = np.concatenate([self.z, self.mu / added], axis=1)
        self.filter = Filter(self._violation())
        return added.size > 0

    def lower_mu(self, last_mu):
        """Weaken the barrier."""
        self.mu_before = self.mu
        self.mu = self.problem.mu = lower_weight(self.problem, last_mu)
        self.filter.pairs = []  # the objective has changed

    def memory(self):
        """What a later process needs to go on from here, beside the state."""
        pairs = np.reshape(self.filter.pairs, (-1, 2))
        memory = {name: getattr(self, name) for name in self.kept} | {"filter": pairs}
        memory |= self.problem.limit_points._asdict()
        return memory | {"largest_violation": self.filter.largest}

    def recall(self, memory):
        """Go on from where `memory` was taken."""
        for name in self.kept:
            setattr(self, name, memory[name] if memory[name].ndim else memory[name].item())
        self.problem.mu = self.mu
        self.filter.pairs = [tuple(pair) for pair in memory["filter"]]
        self.filter.largest = memory["largest_violation"].item()

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

    def missed(self):
        """Size of what is not fulfilled: imbalance, and limits that are missed."""
        below = np.minimum(self.c, 0.0)
        return self.problem.imbalance() + np.sqrt((self.problem.weights * below**2).sum())

    def is_near(self, error):
        """Whether an error is small enough for a weaker barrier."""
        return error <= (NEARLY if self.rate < HIGHER else CENTRED) * self.mu

    @property
    def is_stuck(self):
        """Whether too many steps in a row have been refused."""
        return self.refusals > PATIENCE

    @property
    def at_rest(self):
        """Whether limits hold; without any, whether a cost that falls has come to an end.

        Forces alone would not tell: they vanish where a patch shrinks for ever.
        """
        if self.c.size:
            return self.c.min() > 0
        left = SETTLED * abs(self.problem.cost()) + ROUND_OFF * self.problem.area
        return self._in_sight <= left

    def leave(self):
        """Move off a saddle, to begin anew at the same barrier; whether it is one."""
        matrix = self.problem.hessian(self.z, self.z / self.s)
        left = leave_saddle(self.problem, self.system, matrix)
        if left:
            self._begin(self.mu)
            self.rate, self.slow_steps = 1.0, 0
        return left

    def step(self, recorder):
        """Try one step. Returns its 1/Δt and its accepted length, 0 if it was refused."""
        ds, dz = self._direction(recorder)
        dual_length = to_boundary(self.z, dz)
        used, length = self.rate, self._line_search(ds, dual_length)
        if length == 0:
            self.rate = min(HIGHER * self.rate, HIGHER * LASTING_RATE)
            self.refusals += 1
            return used, 0.0
        self.refusals = 0
        self.z += dual_length * dz
        if length > 0.5:
            self.rate /= 2
        self.rate = min(self.rate, LASTING_RATE)
        self.slow_steps = self.slow_steps + 1 if used > LASTING_RATE else 0
        if self.slow_steps == PATIENCE and self.problem.slack_names:
            self.begin_anew()
        return used, length

    def begin_anew(self):
        """Give up s, z and v, at the barrier before.

        Where limits leave hardly any room between them, z has grown beyond what any 1/Δt makes up
        for.
        """
        self.problem.unknowns[self.problem.psi_dofs.stop :] = 0
        self._begin(self.mu_before)
        self.rate, self.refusals, self.slow_steps = 1.0, 0, 0

    def _direction(self, recorder):
        """Solve for the step in ψ and v, and return that of s and z."""
        self.problem.cost_gradient(self._cost_gradient)
        self._solve, self._products = self._regularised(recorder), self.mu
        ds, dz = self._slack_step(self.mu)
        if ds.size and np.isfinite(ds).all():
            ds, dz = self._corrected(self._solve, ds, dz)
        self._project(self.problem.direction.vec)
        slope = self._cost_gradient.InnerProduct(self._psi_step)
        # To the lowest point along the step, were it not shortened by 1/Δt.
        self._in_sight = slope * slope / self._curvature if self._curvature > 0 else np.inf
        return ds, dz

    def _linearised(self):
        """Set the load toward μ, and return the matrix without the pseudo-time term."""
        self._load_toward(self.mu, self.c - self.s)
        return self.problem.hessian(self.z, self.z / self.s)

    def _load_toward(self, products, gap):
        """Set the load whose Newton step takes s z to `products` and closes a gap c − s.

        With ds and dz eliminated.
        """
        pressure = products / self.s - self.z / self.s * gap
        self.problem.gradient(pressure, self._load)
        self._load.data *= -1

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
            solve(self._load, problem.direction.vec)
            recorder.newton += 1
            tends = self._tends_to_minimum(matrix)
            if tends or recorder.exhausted or self.rate > HIGHER**2 * LASTING_RATE:
                return solve
            self.rate *= HIGHER
            if self.rate > LASTING_RATE and v.any():
                # Far from equilibrium v can bend the Lagrangian by more than E does, and no rate
                # makes up for it. The filter does not see v, so that it may begin again.
                v[:] = 0
                matrix, added, self.rate = self._linearised(), 0.0, given

    def _tends_to_minimum(self, matrix):
        """Whether the step in ψ has positive curvature, and what keeps equilibrium has it too."""
        problem, psi_step = self.problem, self._psi_step
        self._project(problem.direction.vec)
        curvature = psi_step.InnerProduct((matrix * psi_step).Evaluate())
        size = psi_step.InnerProduct((problem.flow * psi_step).Evaluate())
        self._curvature = curvature - self.rate * size
        return curvature > 1e-8 * size and self.system.is_minimum()

    def _corrected(self, solve, ds, dz):
        """Correct a step for what its products s z miss: solve again with the same matrix.

        First for their second order, ds dz (Mehrotra, 1992). Then, as long as that lengthens the
        step, for what takes s z far from μ on a longer one (Gondzio, 1996), on top of what was
        corrected before.
        """
        length, products = to_boundary(self.s, ds), self.mu
        missing = np.clip(-ds * dz, -self.mu, self.mu)
        corrected = self._step_toward(solve, products + missing, 0.0)
        if corrected:
            (ds, dz, length), products = corrected, products + missing
        for _ in range(CORRECTORS):
            if length == 1:
                break
            aim = min(1.0, length + LONGER)
            reached = (self.s + aim * ds) * (self.z + aim * dz)
            centred = np.clip(reached, self.mu / CENTRED, self.mu * CENTRED)
            missing = np.maximum(centred - reached, -self.mu * CENTRED)
            corrected = self._step_toward(solve, products + missing, length)
            if not corrected:
                break
            (ds, dz, length), products = corrected, products + missing
        self._products = products
        return ds, dz

    def _step_toward(self, solve, products, length):
        """The step to other products, as ds, dz and length, if it is longer than `length`.

        Else None, and `direction` is as it was.
        """
        direction = self.problem.direction.vec
        kept = direction.CreateVector()
        kept.data = direction
        self._load_toward(products, self.c - self.s)
        solve(self._load, direction)
        ds, dz = self._slack_step(products)
        new_length = to_boundary(self.s, ds)
        if new_length > length:
            return ds, dz, new_length
        direction.data = kept
        return None

    def _line_search(self, ds, dual_length):
        """Move ψ and s by the first acceptable length, by halves; 0 if there is none.

        v goes as far as the other multipliers, z: forces of both are in balance along a step. A
        whole step that is refused is tried again, bent.
        """
        problem, state = self.problem, self.problem.state.vec
        old = self._objective(), self._violation()
        slope = self._cost_gradient.InnerProduct(self._psi_step)
        slope -= self.mu * (problem.weights * ds / self.s).sum()
        self._before.data = state
        before, length = (self.s, self.c), to_boundary(self.s, ds)

        def accepted(length, ds):
            state.data = self._before + dual_length * problem.direction.vec
            state.data += (length - dual_length) * self._psi_step
            if not problem.least_jacobian() > 0:
                return False
            self.s, self.c = before[0] + length * ds, problem.slacks()
            if not self.filter.accepts(length, slope, old, (self._objective(), self._violation())):
                return False
            # A slack variable below its slack may grow to it: everything gains.
            self.s = np.maximum(self.s, self.c)
            return True

        while length > 1e-8:
            if accepted(length, ds):
                return length
            if length == 1 and self._bends(old[1]):
                straight = problem.direction.vec.CreateVector()
                straight.data = problem.direction.vec
                bent = self._bent_step(before)
                bent_length = to_boundary(before[0], bent)
                if accepted(bent_length, bent):
                    return bent_length
                problem.direction.vec.data = straight
                self._project(straight)
            length /= 2
        state.data = self._before
        self.s, self.c = before
        return 0.0

    def _bends(self, violation):
        """Whether what is here, after a step, violates more than before, but can be corrected."""
        return self.problem.least_jacobian() > 0 and self._violation() >= violation

    def _bent_step(self, before):
        """Bend the whole step from `before` toward limits and equilibrium; return the new ds.

        The second-order correction of Wächter and Biegler (2006, eq. 27): what the step leaves of
        c − s and imbalance is taken off as well. Down a narrow valley, as that of cloth that hardly
        resists shear, all but short steps would be refused for it.
        """
        problem = self.problem
        problem.multiplier_force(self._missed)
        gap = self.c - self.s
        problem.state.vec.data = self._before
        self.s, self.c = before
        gap += self.c - self.s
        self._load_toward(self._products, gap)
        v = slice(problem.psi_dofs.stop, None)
        self._load.FV().NumPy()[v] -= self._missed.FV().NumPy()[v]
        self._solve(self._load, problem.direction.vec)
        self._project(problem.direction.vec)
        return problem.slack_changes() + gap

    def _objective(self):
        return self.problem.cost() - self.mu * (self.problem.weights * np.log(self.s)).sum()

    def _violation(self):
        """Size of what must vanish: imbalance, and c − s."""
        gap = np.sqrt((self.problem.weights * (self.c - self.s) ** 2).sum())
        return self.problem.imbalance() + gap
