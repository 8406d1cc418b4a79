"""A certificate for a result: what its ψ is worth, recomputed from ψ alone.

The formulas are those of the solver; forms, rules and spaces are not. Derivatives are symbolic
where the solver differentiates automatically, and no multiplier of the solver is used.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import comb

import ngsolve as ngs
import numpy as np

from .constraints import Obstacle, ShearLimit
from .kinematics import Kinematics, gradient, virtual_strain

LIMIT = 2e-3  # by which λ, |γ| and, over its largest value, τ may miss their limits
AT_REST = 1e-2  # of the stress: what may be unbalanced in a scene without limits
RESOLVED = 0.1  # of the stress, or of kc: what a richer space may find unbalanced
EQUILIBRIUM = 0.1  # `Result.equilibrium_residual`
BARRIER = 1e-2  # of the stress: weight of a barrier that does not spoil the optimum
FLAT = 1e-2  # of the stress: curvature that counts as zero
ROUND_OFF = 1e-9  # stress over kc that counts as none
HALVINGS = 3  # of an element's edges, to prove J > 0 in it
KRYLOV = 30


@dataclass(frozen=True)
class LimitCheck:
    """One slack of one limit, on a lattice much finer than the points where it was imposed.

    Attributes
    ----------
    name : str
        Name of the limit.
    slack : float
        Its least value.
    tolerance : float
        The limit holds if ``slack >= -tolerance``.
    theta : (float, float)
        Where the slack is least.
    """

    name: str
    slack: float
    tolerance: float
    theta: tuple

    @property
    def holds(self):
        """Whether the slack is within its tolerance."""
        return self.slack >= -self.tolerance


@dataclass(frozen=True)
class Certificate:
    """What `verify` found; `str` is one line.

    Stresses and curvatures are over kc. "The stress" is the root mean square over the surface of
    the derivative of the energy density by ∇ψ.

    Attributes
    ----------
    limits : tuple of LimitCheck
        One per slack of the scene's constraints.
    jacobian : float
        The least J on the lattice.
    unfolded : bool
        Whether J > 0 is proven on every element, by Bernstein coefficients.
    overlap : (float, float) or None
        A point X of the patch where its rim meets itself. With J > 0 and none, ψ is injective.
    equilibrium : float or None
        `Result.equilibrium_residual`; None without limits, where stationarity implies it.
    stress : float
        The scale of `stationarity`, and of `curvature`.
    stationarity : float
        What is left of dL with the best multipliers: its norm over all ψ of the mesh, over the
        stress; infinite where a limit is violated at the points at which it is imposed.
    stationarity_tolerance : float
        What of it is accepted: with limits, what a barrier of weight `barrier` can achieve.
    stationarity_richer : float
        Likewise over all ψ one order richer: the error of the discretisation. It may be a tenth of
        the stress, or of kc where that is more: a Chebyshev net has no stress but this error.
    barrier : float
        The weight μ for which stationarity was tested, 0 without limits: at most 1 % of the stress.
    curvature : float
        Smallest eigenvalue of the Hessian of L on changes of ψ that keep the equilibrium, in the
        H¹ seminorm of the surface. Negative beyond `curvature_tolerance`: a saddle, or, without
        symmetry on a surface of revolution, the turning named below.
    curvature_tolerance : float
    asymmetric_curvature : float or None
        In a symmetric scene, likewise for the changes that break the symmetry, for information. On
        a surface of revolution one of them turns the cloth and costs nothing: expect 0 up to the
        error of the mesh, of either sign.
    """

    limits: tuple
    jacobian: float
    unfolded: bool
    overlap: tuple | None
    equilibrium: float | None
    stress: float
    stationarity: float
    stationarity_tolerance: float
    stationarity_richer: float
    barrier: float
    curvature: float
    curvature_tolerance: float
    asymmetric_curvature: float | None

    @property
    def certified(self):
        """Whether every check holds."""
        return not self.faults

    @property
    def faults(self):
        """What does not hold, a list of phrases."""
        faults = [
            f"{check.name} missed by {-check.slack:.2g} at θ = {_point(check.theta)}"
            for check in self.limits
            if not check.holds
        ]
        if not self.jacobian > 0:
            faults.append(f"folded, J = {self.jacobian:.2g}")
        elif not self.unfolded:
            faults.append("J > 0 not proven between the points")
        if self.overlap is not None:
            faults.append(f"the rim meets itself at X = {_point(self.overlap)}")
        if self.equilibrium is not None and not self.equilibrium <= EQUILIBRIUM:
            faults.append(f"{self.equilibrium:.2g} of the force is not in equilibrium")
        if not self.barrier <= BARRIER * self.stress:
            faults.append(f"the barrier's weight is {self.barrier / self.stress:.2g} of the stress")
        if not self.stationarity <= self.stationarity_tolerance:
            faults.append(f"not stationary, {self.stationarity:.2g} of the stress")
        elif not self.stationarity_richer <= RESOLVED * max(1.0, 1 / self.stress):
            faults.append(
                f"the mesh leaves {self.stationarity_richer:.2g} of the stress unbalanced"
            )
        elif not self.curvature >= -self.curvature_tolerance:
            faults.append(f"a saddle, curvature {self.curvature:.2g}")
        return faults

    def __str__(self):
        if self.faults:
            return "not certified: " + "; ".join(self.faults)
        parts = [f"J ≥ {self.jacobian:.2g}", "no overlap"]
        if self.limits:
            worst = min(self.limits, key=lambda check: check.slack / check.tolerance)
            parts = [f"limits within {max(-worst.slack, 0):.1g}", *parts]
            parts.append(f"equilibrium to {self.equilibrium:.1g}")
        parts.append(f"stationary to {self.stationarity:.1g} of the stress")
        minimum = f"a minimum, curvature {self.curvature:.2g}"
        if self.asymmetric_curvature is not None:
            minimum += f" within the symmetry, {self.asymmetric_curvature:.2g} across it"
        return "certified: " + ", ".join([*parts, minimum])


def verify(result):
    """Check a result from its ψ alone, on finer rules and richer spaces than the solver's.

    Parameters
    ----------
    result : Result
        Of any reason: one that has not converged tells here what is missing.

    Returns
    -------
    Certificate
        `certified` if the limits hold between the sampling points too, ψ folds and overlaps
        nowhere, the pinned cloth is in equilibrium, and ψ is a (local) minimum: stationary, with
        multipliers found from ψ, and of no negative curvature. In a symmetric scene, a minimum
        among symmetric patches. The domain is taken to be simply connected.
    """
    limits, jacobian = _limits(result)
    fine = _unfolded(result) if jacobian > 0 else False
    tests = {"stationarity": np.inf, "stationarity_richer": np.inf, "curvature": np.nan}
    tests |= {"asymmetric_curvature": np.nan if result.scene.symmetric else None}
    point = _StationaryPoint(result)
    if jacobian > 0 and point.interior:
        tests = point.tests()
    return Certificate(
        limits=limits,
        jacobian=jacobian,
        unfolded=fine,
        overlap=_crossing(result.outline(_rim_points(result))),
        equilibrium=result.equilibrium_residual if limits else None,
        stress=point.stress,
        stationarity_tolerance=point.tolerance,
        barrier=point.mu,
        curvature_tolerance=FLAT * point.stress,
        **tests,
    )


# Between the points -----------------------------------------------------------------------------


def _cloth(result):
    surface = result.scene.surface
    slope = gradient(*result.state.components[:2])
    return Kinematics(slope, surface.metric, result.scene.fabric, lambda: surface.curvature)


def _on_lattice(result, points):
    """Mesh points at reference points (n, 2) of each element."""
    rule = ngs.IntegrationRule([tuple(p) for p in points.tolist()], [0.0] * len(points))
    return result.state.space.mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)


def _limits(result):
    """A `LimitCheck` for every slack, and the least J."""
    points = _on_lattice(result, _lattice(2 * result.settings["quadrature"]))
    cloth, theta = _cloth(result), ngs.CF((ngs.x, ngs.y))(points)
    checks = []
    for limit in result.scene.constraints:
        for slack in limit.slacks(cloth):
            values = slack.Compile()(points).ravel()
            worst = int(np.argmin(values))  # a NaN, if there is one
            tolerance = LIMIT
            if isinstance(limit, ShearLimit):
                tolerance *= 2 * limit.maximum  # its slack is γmax² − γ²
            elif isinstance(limit, Obstacle):
                tolerance *= float(np.abs(values).max())
            checks.append(
                LimitCheck(
                    limit.name, float(values[worst]), tolerance, tuple(theta[worst].tolist())
                )
            )
    return tuple(checks), float(cloth.jacobian.Compile()(points).min())


def _lattice(n):
    """Points (i, j)/n of the reference triangle, edges and vertices included."""
    return np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]) / n


def _unfolded(result):
    """Whether J > 0 on all of every element.

    On the reference triangle J times the Jacobian of the element is a polynomial of degree
    2(order − 1), curved or not, and lies above the least of its Bernstein coefficients. Parts of
    an element have closer ones.
    """
    degree = max(2 * (result.settings["order"] - 1), 1)
    lattice = _lattice(degree)
    i, j = np.rint(degree * lattice).astype(int).T
    s, t = lattice.T[:, :, None]
    count = np.array([comb(degree, a) * comb(degree - a, b) for a, b in zip(i, j, strict=True)])
    basis = np.linalg.inv(count * s**i * t**j * (1 - s - t) ** (degree - i - j))

    element = ngs.Det(ngs.specialcf.JacobianMatrix(2))
    density = (_cloth(result).jacobian * element).Compile()
    parts = [np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])]
    for _ in range(HALVINGS + 1):
        points = np.concatenate([p[0] + lattice @ (p[1:] - p[0]) for p in parts])
        values = density(_on_lattice(result, points)).reshape(-1, len(lattice))
        if (values @ basis.T).min() > 0:
            return True
        parts = [part for whole in parts for part in _quartered(whole)]
    return False


def _quartered(triangle):
    middles = (triangle + np.roll(triangle, -1, axis=0)) / 2
    corners = [np.array([triangle[k], middles[k], middles[k - 1]]) for k in range(3)]
    return [*corners, middles]


def _rim_points(result):
    """How many points to take along the rim: eight for each element there."""
    edges = result.state.space.mesh.Boundaries("rim").Elements()
    return int(np.clip(8 * result.scene.copies * sum(1 for _ in edges), 400, 2000))


def _crossing(curve):
    """A point where a closed polyline (n, 2) meets itself, or None."""
    a, b = curve, np.roll(curve, -1, axis=0)
    low, high = np.minimum(a, b), np.maximum(a, b)
    near = np.all((low[:, None] <= high) & (high[:, None] >= low), axis=-1)
    near = np.triu(near, 2)
    near[0, -1] = False
    i, j = np.nonzero(near)

    def apart(p, q, r):
        """Whether two points r lie on one side of the line through p and q."""
        (u, v), (w, x) = (q - p).T, np.stack([(point - p).T for point in r], axis=1)
        sides = u * x - v * w
        return sides[0] * sides[1] > 0

    met = ~apart(a[i], b[i], (a[j], b[j])) & ~apart(a[j], b[j], (a[i], b[i]))
    return tuple(a[i[met][0]].tolist()) if met.any() else None


# Stationary, and a minimum ----------------------------------------------------------------------


class _StationaryPoint:
    """L(ψ, η) = ∫ J W + ∫ J S : L_η a − μ Σ ∫ log c dA over kc near the ψ of a result.

    Integrals are taken at the solver's own points, where alone the barrier exists.
    """

    def __init__(self, result):
        self.scene, self.settings = result.scene, result.settings
        self.psi, self.mesh = result.state.components[:2], result.state.space.mesh
        self.order = self.settings["order"]
        self.inverse = "umfpack" if self.scene.constraints else "sparsecholesky"
        self.mu = self.settings["barrier_end"] if self.scene.constraints else 0.0
        rule = ngs.IntegrationRule(ngs.TRIG, 2 * ((self.settings["quadrature"] + 1) // 2))
        self.dx = ngs.dx(intrules={ngs.TRIG: rule})
        self.cloth, self.metric = _cloth(result), self.scene.surface.metric
        self.slope, self.kc = self.cloth.gradient, self.scene.fabric.stiffness
        self.root = ngs.sqrt(ngs.Det(self.metric))
        self.slacks = [c for limit in self.scene.constraints for c in limit.slacks(self.cloth)]
        invariants = self.cloth.I4, self.cloth.I6, self.cloth.I8
        self.energy = self.cloth.jacobian * self.scene.fabric.energy(*invariants) / self.kc
        points = self.mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)
        self.interior = all((c.Compile()(points) > 0).all() for c in self.slacks)

    @cached_property
    def area(self):
        return ngs.Integrate(self.root * self.dx, self.mesh)

    @cached_property
    def stress(self):
        flux = self.energy.Diff(self.slope)
        square = ngs.InnerProduct(flux * self.metric, flux) / self.root
        mean = ngs.Integrate(square.Compile() * self.dx, self.mesh) / self.area
        return max(float(np.sqrt(mean)), ROUND_OFF)

    @property
    def tolerance(self):
        """An interior point ends with stationarity and all c z − μ below μ, per area."""
        if not self.slacks:
            return AT_REST
        return float(np.sqrt(1 + len(self.slacks)) * self.mu / self.stress)

    def tests(self):
        """The fields of the `Certificate` that are found here."""
        residual, eta = self.remainder(self.order)
        richer, _ = self.remainder(self.order + 1)
        hessian, norm = self.pencil(eta)
        flips = [(0, 0), (1, 0), (0, 1), (1, 1)] if self.scene.symmetric else [(0, 0)]
        own, *others = (
            least_eigenvalue(hessian, norm, self.free(self.order, each), self.inverse)
            for each in flips
        )
        return {
            "stationarity": residual / self.stress,
            "stationarity_richer": richer / self.stress,
            "curvature": own,
            "asymmetric_curvature": min(others, default=None),
        }

    def space(self, order, flips=(0, 0)):
        """ψ and, with limits, η; the mirrors hold what is odd across them.

        Component i is odd across mirror i and even across the other; a flip turns both round. The
        four pairs of flips are the four symmetries of a change of a symmetric patch, and the
        Hessian does not mix them.
        """

        def held(i, rim=()):
            odd = [f"mirror{j + 1}" for j in (0, 1) if (i == j) != bool(flips[j])]
            return "|".join([*rim, *(odd if self.scene.symmetric else [])])

        spaces = [ngs.H1(self.mesh, order=order, dirichlet=held(i)) for i in (0, 1)]
        if self.slacks:
            eta = self.settings["multiplier_order"]
            spaces += [ngs.H1(self.mesh, order=eta, dirichlet=held(i, ["rim"])) for i in (0, 1)]
        return ngs.FESpace(spaces)

    def free(self, order, flips=(0, 0)):
        """Degrees of freedom to solve for; of a component held nowhere, all but one vertex."""
        space = self.space(order, flips)
        free = ngs.BitArray(space.FreeDofs())
        for i in (0, 1):
            if space.components[i].FreeDofs().NumSet() == space.components[i].ndof:
                free.Clear(space.Range(i).start)
        return free

    def remainder(self, order):
        """The least of |dL|² + Σ ∫ (c z − μ)² dA over all η and z, its root per √area; and η.

        The first norm is dual to the H¹ seminorm over ψ of that order. With z = μ/c + ∇c·w/c² the
        solution w is what would have to be gained: c z alone may be off by μ at the solver's end.
        """
        space = self.space(order)
        trial, test = space.TnT()
        here, there = gradient(*trial[:2]), gradient(*test[:2])
        matrix, force = ngs.BilinearForm(space), ngs.LinearForm(space)
        density = self.energy.Diff(self.slope, there)
        for c in self.slacks:
            along, across = c.Diff(self.slope, here), c.Diff(self.slope, there)
            density -= self.mu * self.root / c * across
            matrix += (self.root / c**2 * along * across).Compile() * self.dx
        force += density.Compile() * self.dx
        for u, v, psi in zip(trial, test, self.psi, strict=False):
            matrix += self.seminorm(u, v)
            if self.scene.tie_break:
                force += self.bending(psi, v)
        if self.slacks:
            matrix += self.equilibrium(trial, test)
        force.Assemble(), matrix.Assemble()
        solution = ngs.GridFunction(space)
        solution.vec.data = matrix.mat.Inverse(self.free(order), inverse=self.inverse) * force.vec
        square = ngs.InnerProduct(force.vec, solution.vec) / self.area
        solution.vec.data = -1 * solution.vec
        return float(np.sqrt(max(square, 0.0))), solution.components[2:]

    def pencil(self, eta):
        """The matrices [[H, Aᵀ], [A, 0]] and [[M, 0], [0, 0]]: H Hessian of L, A equilibrium."""
        space = self.space(self.order)
        trial, test = space.TnT()
        hessian, norm = ngs.BilinearForm(space), ngs.BilinearForm(space)
        density = self.energy
        for c in self.slacks:
            density -= self.mu * self.root * ngs.log(c)
        if self.slacks:
            density += self.work(eta)
            hessian += self.equilibrium(trial, test)
        change = density.Diff(self.slope, gradient(*trial[:2]))
        hessian += change.Diff(self.slope, gradient(*test[:2])).Compile() * self.dx
        for u, v in zip(trial[:2], test[:2], strict=True):
            norm += self.seminorm(u, v)
            if self.scene.tie_break:
                hessian += self.bending(u, v)
        return hessian.Assemble().mat, norm.Assemble().mat

    def seminorm(self, u, v):
        """The H¹ seminorm on the surface, ∫ √det a a^{αβ} ∂αu ∂βv."""
        weight = ngs.Cof(self.metric) / self.root
        return (weight * ngs.grad(u)) * ngs.grad(v) * self.dx

    def bending(self, u, v):
        """The derivative of the scene's tie-break, ε ∫ ∇∇u : ∇∇v."""
        twice = ngs.InnerProduct(u.Operator("hesse"), v.Operator("hesse"))
        return self.scene.tie_break * twice * ngs.dx

    def work(self, eta):
        """J S : L_η a over kc."""
        derivatives = self.scene.surface.metric_derivatives
        strain = virtual_strain(ngs.CF(tuple(eta)), gradient(*eta), self.metric, derivatives)
        stress = self.cloth.contravariant_stress / self.kc
        return self.cloth.jacobian * ngs.InnerProduct(stress, strain)

    def equilibrium(self, trial, test):
        """The derivative of the work by ψ and η, both ways round."""
        upper = self.work(trial[2:]).Diff(self.slope, gradient(*test[:2]))
        lower = self.work(test[2:]).Diff(self.slope, gradient(*trial[:2]))
        return (upper + lower).Compile() * self.dx


def least_eigenvalue(hessian, norm, free, inverse):
    """The smallest finite eigenvalue of a pencil, by Lanczos iteration about a shift below it.

    NGSolve's own Arnoldi solver returns the eigenvalues nearest to a shift and would not tell
    that there are others below it. Here they show, and the shift moves down.
    """
    shift = -1.0
    while True:
        shifted = hessian.CreateMatrix()
        shifted.AsVector().data = hessian.AsVector() - shift * norm.AsVector()
        ritz = _lanczos(shifted.Inverse(free, inverse=inverse), norm)
        if not ritz[0] < -ROUND_OFF * np.abs(ritz).max():
            return float(shift + 1 / ritz[-1])
        shift = 4 * min(shift, shift + 1 / ritz[0])


def _lanczos(inverse, norm):
    """Eigenvalues, ascending, of inverse · norm on a Krylov space."""
    given, image = norm.CreateRowVector(), norm.CreateRowVector()

    def times(matrix, vector):
        given.FV().NumPy()[:] = vector
        image.data = matrix * given
        return image.FV().NumPy().copy()

    vector = times(inverse, times(norm, np.random.default_rng(0).standard_normal(len(given))))
    basis, duals, diagonal, beside = [], [], [], []
    for _ in range(KRYLOV):
        dual = times(norm, vector)
        size = np.sqrt(max(vector @ dual, 0.0))
        if size <= 1e-13 * (beside[0] if beside else 0.0) or not np.isfinite(size):
            break
        beside.append(size)
        basis.append(vector / size), duals.append(dual / size)
        vector = times(inverse, duals[-1])
        diagonal.append(vector @ duals[-1])
        for _ in range(2):
            vector = vector - np.array(basis).T @ (np.array(duals) @ vector)
    matrix = np.diag(diagonal)
    for k, (_, size) in enumerate(pairwise(beside)):
        matrix[k, k + 1] = matrix[k + 1, k] = size
    return np.linalg.eigvalsh(matrix)


def _point(values):
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"
