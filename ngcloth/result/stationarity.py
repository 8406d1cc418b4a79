"""Whether a ψ is stationary, and a minimum: what `ngcloth.verify` asks of the Lagrangian."""

from functools import cached_property, partial
from itertools import combinations_with_replacement, pairwise
from math import factorial, prod

import ngsolve as ngs
import numpy as np

from ..problem.constraints import RIM_SHARE
from ..problem.cost_size import cost_size
from ..problem.fabric import Net
from ..problem.kinematics import Kinematics, gradient
from ..problem.warp import HeldDirection, HeldInverse

AT_REST = 1e-2  # of the stress: what may be unbalanced in a scene without limits
ROUND_OFF = 1e-9  # stress over kc that counts as none
RESOLVED = 0.1  # of the stress, or of kc: what a richer space may find unbalanced
KRYLOV = 30


def _cloth(result):
    sheet = result.sheet
    slope = gradient(*result.state.components[:2])
    return Kinematics(slope, sheet.metric, result.scene.fabric, lambda: sheet.curvature)


class _StationaryPoint:
    """L(ψ, v) = E(ψ) + dE(ψ)[v] − μ Σ ∫ log c dA over kc near the ψ of a result.

    Integrals are taken at the solver's own points, where alone the barrier exists. Those of the
    barrier are over the surface, and along the rim with a weight of `RIM_SHARE` in all.
    """

    def __init__(self, result):
        self.scene, self.settings, self.sheet = result.scene, result.settings, result.sheet
        self.psi, self.mesh = result.state.components[:2], result.state.space.mesh
        self.order = self.settings["order"]
        self.inverse = "umfpack" if self.scene.in_equilibrium else "sparsecholesky"
        self.degree = 2 * ((self.settings["quadrature"] + 1) // 2)
        shapes = ngs.TRIG, ngs.SEGM
        self.rules = {shape: ngs.IntegrationRule(shape, self.degree) for shape in shapes}
        self.dx = ngs.dx(intrules=self.rules)
        self.cloth, self.metric = _cloth(result), result.sheet.metric
        self.slope, self.kc = self.cloth.gradient, self.scene.fabric.stiffness
        self.root = ngs.sqrt(ngs.Det(self.metric))
        self.slacks = [c for limit in self.scene.constraints for c in limit.slacks(self.cloth)]
        cloth, cost = self.cloth, self.scene.cost
        self.energy = cloth.jacobian * self.strain_energy()
        self.energy /= self.kc
        self.size = cost_size(self.scene)
        self.mu = self.size * self.settings.get("barrier_end", 0.0)
        self.cost = cloth.jacobian * cost(cloth) / self.kc if cost else self.energy

    def strain_energy(self):
        """W; a user's to third order about the C of ψ, with the same three derivatives by ∇ψ.

        They are short for any law; those of a long law itself take minutes.
        """
        invariants = self.cloth.I4, self.cloth.I6, self.cloth.I8
        if isinstance(self.scene.fabric, Net):
            return self.scene.fabric.energy(*invariants)
        space = ngs.comp.IntegrationRuleSpace(self.mesh, order=self.degree)
        points = self.mesh.MapToAllElements(space.GetIntegrationRules(), ngs.VOL)
        derivatives = {(): self.scene.fabric.energy(*invariants)}
        for order in (1, 2, 3):
            for which in combinations_with_replacement(range(3), order):
                derivatives[which] = derivatives[which[:-1]].Diff(invariants[which[-1]])
        expressions = ngs.CF((*invariants, *derivatives.values())).Compile()
        fields = []
        for values in expressions(points).T:
            fields.append(ngs.GridFunction(space))
            fields[-1].vec.FV().NumPy()[:] = values
        changes = [now - here for now, here in zip(invariants, fields, strict=False)]
        terms = []
        for which, value in zip(derivatives, fields[3:], strict=True):
            for i in which:
                value = value * changes[i]
            terms.append(value / prod(factorial(which.count(i)) for i in range(3)))
        return sum(terms[1:], terms[0])

    @cached_property
    def interior(self):
        """Whether all limits hold at the points where they are imposed."""
        inside = self.mesh.MapToAllElements(self.rules, ngs.VOL)
        on_rim = self.mesh.MapToAllElements(self.rules, self.mesh.Boundaries("rim"))
        return all(
            (c.Compile()(inside) > 0).all() and (ngs.BoundaryFromVolumeCF(c)(on_rim) > 0).all()
            for c in self.slacks
        )

    @cached_property
    def barriers(self):
        """Weights and integrals of the barrier, inside and along the rim."""
        rim = {"definedon": self.mesh.Boundaries("rim"), "intrules": self.rules}
        along = ngs.specialcf.tangential(2)
        length, on_rim = (
            ngs.sqrt(ngs.InnerProduct(metric * along, along))
            for metric in (self.metric, ngs.BoundaryFromVolumeCF(self.metric))
        )
        share = RIM_SHARE * self.area / ngs.Integrate(on_rim * ngs.ds(**rim), self.mesh)
        return (self.root, self.dx), (share * length, ngs.ds(skeleton=True, **rim))

    @cached_property
    def area(self):
        return ngs.Integrate(self.root * self.dx, self.mesh)

    @cached_property
    def stress(self):
        flux = self.cost.Diff(self.slope)
        square = ngs.InnerProduct(flux * self.metric, flux) / self.root
        mean = ngs.Integrate(square.Compile() * self.dx, self.mesh) / self.area
        return max(float(np.sqrt(mean)), ROUND_OFF * self.size)

    @property
    def tolerance(self):
        """An interior point ends with stationarity and all c z − μ below μ, per area."""
        if not self.slacks:
            return AT_REST
        return float(np.sqrt(1 + (1 + RIM_SHARE) * len(self.slacks)) * self.mu / self.stress)

    @property
    def richer_tolerance(self):
        """A Chebyshev net has no stress but the error of the mesh."""
        return RESOLVED * max(1.0, self.size / self.stress)

    def tests(self):
        """The fields of the `Certificate` that are found here."""
        residual, v = self.remainder(self.order)
        richer, _ = self.remainder(self.order + 1)
        hessian, norm = self.pencil(v)
        in_sight = self.in_sight(hessian) if self.scene.cost and not self.slacks else None
        flips = [(0, 0), (1, 0), (0, 1), (1, 1)] if self.scene.symmetric else [(0, 0)]
        own, *others = (
            least_eigenvalue(hessian, norm, partial(self.solver, order=self.order, flips=each))
            for each in flips
        )
        return {
            "stationarity": residual / self.stress,
            "stationarity_richer": richer / self.stress,
            "curvature": own,
            "asymmetric_curvature": min(others, default=None),
            "in_sight": in_sight,
        }

    def space(self, order, flips=(0, 0)):
        """ψ and, with limits, v; the mirrors hold what is odd across them.

        Component i is odd across mirror i and even across the other; a flip turns both round. The
        four pairs of flips are the four symmetries of a change of a symmetric patch, and the
        Hessian does not mix them.
        """

        def held(i, rim=()):
            odd = [f"mirror{j + 1}" for j in (0, 1) if (i == j) != bool(flips[j])]
            return "|".join([*rim, *(odd if self.scene.symmetric else [])])

        spaces = [ngs.H1(self.mesh, order=order, dirichlet=held(i)) for i in (0, 1)]
        if self.scene.in_equilibrium:
            degree = self.settings["multiplier_order"]
            spaces += [ngs.H1(self.mesh, order=degree, dirichlet=held(i, ["rim"])) for i in (0, 1)]
        return ngs.FESpace(spaces)

    def free(self, order, flips=(0, 0)):
        """Degrees of freedom to solve for; of a component held nowhere, all but one vertex."""
        space = self.space(order, flips)
        free = ngs.BitArray(space.FreeDofs())
        for i in (0, 1):
            if space.components[i].FreeDofs().NumSet() == space.components[i].ndof:
                free.Clear(space.Range(i).start)
        return free

    def solver(self, matrix, order, flips=(0, 0)):
        """The inverse of a matrix, for changes of ψ that keep a direction of the warp."""
        inverse = matrix.Inverse(self.free(order, flips), inverse=self.inverse)
        if self.scene.warp is None or self.scene.symmetric:
            return inverse
        given = self.scene.warp, self.scene.at
        return HeldInverse(inverse, HeldDirection(self.space(order), self.sheet, *given).normal)

    def remainder(self, order):
        """The least of |dL|² + Σ ∫ (c z − μ)² dA over all v and z, its root per √area; and v.

        The first norm is dual to the H¹ seminorm over ψ of that order. With z = μ/c + ∇c·w/c² the
        solution w is what would have to be gained: c z alone may be off by μ at the solver's end.
        """
        space = self.space(order)
        trial, test = space.TnT()
        here, there = gradient(*trial[:2]), gradient(*test[:2])
        matrix, force = ngs.BilinearForm(space), ngs.LinearForm(space)
        force += self.cost.Diff(self.slope, there).Compile() * self.dx
        for c in self.slacks:
            along, across = c.Diff(self.slope, here), c.Diff(self.slope, there)
            for weight, integral in self.barriers:
                force += (-self.mu * weight / c * across).Compile() * integral
                matrix += (weight / c**2 * along * across).Compile() * integral
        for u, v in zip(trial[:2], test[:2], strict=True):
            matrix += self.seminorm(u, v)
        if self.scene.in_equilibrium:
            matrix += self.equilibrium(trial, test)
        force.Assemble(), matrix.Assemble()
        solution = ngs.GridFunction(space)
        solution.vec.data = self.solver(matrix.mat, order) * force.vec
        square = ngs.InnerProduct(force.vec, solution.vec) / self.area
        solution.vec.data = -1 * solution.vec
        return float(np.sqrt(max(square, 0.0))), solution.components[2:]

    def pencil(self, v):
        """The matrices [[H, Aᵀ], [A, 0]] and [[M, 0], [0, 0]]: H Hessian of L, A equilibrium."""
        space = self.space(self.order)
        trial, test = space.TnT()
        hessian, norm = ngs.BilinearForm(space), ngs.BilinearForm(space)
        densities = [(self.cost, self.dx)]
        if self.scene.in_equilibrium:
            densities.append((self.work(v), self.dx))
            hessian += self.equilibrium(trial, test)
        for c in self.slacks:
            densities += [(-self.mu * w * ngs.log(c), integral) for w, integral in self.barriers]
        for density, integral in densities:
            change = density.Diff(self.slope, gradient(*trial[:2]))
            hessian += change.Diff(self.slope, gradient(*test[:2])).Compile() * integral
        for u, v in zip(trial[:2], test[:2], strict=True):
            norm += self.seminorm(u, v)
        return hessian.Assemble().mat, norm.Assemble().mat

    def in_sight(self, hessian):
        """What the cost may still fall by, over itself: dᵀHd/2 of the Newton step d in equilibrium.

        A cost that falls for ever, as the patch shrinks, has forces that vanish with it.
        """
        space = self.space(self.order)
        force, step = ngs.LinearForm(space), ngs.GridFunction(space)
        force += self.cost.Diff(self.slope, gradient(*space.TestFunction()[:2])).Compile() * self.dx
        force.Assemble()
        step.vec.data = self.solver(hessian, self.order) * force.vec
        falls = abs(ngs.InnerProduct(force.vec, step.vec)) / 2
        cost = ngs.Integrate(self.cost.Compile() * self.dx, self.mesh)
        return float(falls / (abs(cost) + ROUND_OFF**2 * self.size * self.area))

    def seminorm(self, u, v):
        """The H¹ seminorm on the surface, ∫ √det a a^{αβ} ∂αu ∂βv."""
        weight = ngs.Cof(self.metric) / self.root
        return (weight * ngs.grad(u)) * ngs.grad(v) * self.dx

    def work(self, v):
        """The density of dE[v], over kc."""
        return self.energy.Diff(self.slope, gradient(*v))

    def equilibrium(self, trial, test):
        """The derivative of dE[v] by ψ and v, both ways round."""
        upper = self.work(trial[2:]).Diff(self.slope, gradient(*test[:2]))
        lower = self.work(test[2:]).Diff(self.slope, gradient(*trial[:2]))
        return (upper + lower).Compile() * self.dx


def least_eigenvalue(hessian, norm, solver):
    """The smallest finite eigenvalue of a pencil, by Lanczos iteration about a shift below it.

    `solver` makes the inverse of a matrix.

    NGSolve's own Arnoldi solver returns the eigenvalues nearest to a shift and would not tell
    that there are others below it. Here they show, and the shift moves down.
    """
    shift = -1.0
    while True:
        shifted = hessian.CreateMatrix()
        shifted.AsVector().data = hessian.AsVector() - shift * norm.AsVector()
        ritz, _ = lanczos(solver(shifted).Mult, norm)
        if not ritz[0] < -ROUND_OFF * np.abs(ritz).max():
            return float(shift + 1 / ritz[-1])
        shift = 4 * min(shift, shift + 1 / ritz[0])


def lanczos(solve, norm):
    """Eigenvalues, ascending, of inverse · norm on a Krylov space, and the vector of the last.

    Parameters
    ----------
    solve : callable
        Writes inverse · load to `out`: ``solve(load, out)``.
    norm : BaseMatrix
        Positive semidefinite.

    Returns
    -------
    values, vector : ndarray
    """
    given, image = norm.CreateRowVector(), norm.CreateRowVector()

    def times(multiply, vector):
        given.FV().NumPy()[:] = vector
        multiply(given, image)
        return image.FV().NumPy().copy()

    start = np.random.default_rng(0).standard_normal(len(given))
    vector = times(solve, times(norm.Mult, start))
    basis, duals, diagonal, beside = [], [], [], []
    for _ in range(KRYLOV):
        dual = times(norm.Mult, vector)
        size = np.sqrt(max(vector @ dual, 0.0))
        if size <= 1e-13 * (beside[0] if beside else 0.0) or not np.isfinite(size):
            break
        beside.append(size)
        basis.append(vector / size), duals.append(dual / size)
        vector = times(solve, duals[-1])
        diagonal.append(vector @ duals[-1])
        for _ in range(2):
            vector = vector - np.array(basis).T @ (np.array(duals) @ vector)
    matrix = np.diag(diagonal)
    for k, (_, size) in enumerate(pairwise(beside)):
        matrix[k, k + 1] = matrix[k + 1, k] = size
    values, vectors = np.linalg.eigh(matrix)
    return values, np.array(basis).T @ vectors[:, -1]
