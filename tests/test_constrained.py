"""Equilibrium, limits and the interior point: derivatives, closed forms, answers, refusals."""

from functools import cache

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import (
    Disk,
    Elongation,
    InputError,
    Net,
    Obstacle,
    Rectangle,
    Scene,
    ShearLimit,
    Surface,
    solve,
)
from ngcloth.energy.constrained import ConstrainedLagrangian
from ngcloth.problem.constraints import RIM_SHARE
from ngcloth.problem.kinematics import Kinematics, virtual_strain
from ngcloth.result.history import Reason
from ngcloth.scenes import hemicatenoid, hemisphere, sphere
from ngcloth.solver.interior_point import Iterate
from ngcloth.solver.recorder import Recorder
from ngcloth.solver.saddle_system import ACCURACY, SaddleSystem, _pivots
from ngcloth.solver.solve import make_mesh
from ngcloth.solver.start import feasible_start

# Directions in the quarter of a symmetric disk.
ROUND = [(np.cos(a), np.sin(a)) for a in np.radians((10, 30, 45, 70))]


def discretised(scene, maxh=0.4, order=2, quadrature=None):
    quadrature = 2 * order + 2 if quadrature is None else quadrature
    mesh = make_mesh(scene, maxh, order)
    return ConstrainedLagrangian(scene, mesh, order, quadrature, "umfpack", order)


def vector(problem):
    """The coefficients of the state, a NumPy view to read and write."""
    return problem.state.vec.FV().NumPy()


def derivative(problem, z):
    out = problem.state.vec.CreateVector()
    problem.gradient(z, out)
    return out.FV().NumPy().copy()


def times(matrix, direction):
    given, out = matrix.CreateColVector(), matrix.CreateColVector()
    given.FV().NumPy()[:] = direction
    out.data = matrix * given
    return out.FV().NumPy().copy()


def skew_surface(domain=None):
    def chart(t1, t2):
        return t1 + 0.2 * t1 * t2, 1.1 * t2 + 0.1 * t1, 0.3 * t1 * t1 + 0.2 * ngs.sin(t2)

    return Surface(chart, domain or Disk(1))


def bent(x, y):
    return 0.55 * x + 0.06 * x * y * y, 0.5 * y + 0.07 * y * x * x


# Derivatives --------------------------------------------------------------------------------

TAYLOR = {
    "sphere": lambda: Scene(
        sphere(0.6).surface, Net(ks=2.0), (Elongation(), ShearLimit(0.9)), bent, symmetric=True
    ),
    "skew chart": lambda: Scene(
        skew_surface(), Net(kc=(2.0, 0.5), ks=0.3), (Elongation(), ShearLimit(0.8)), start=bent
    ),
    "obstacle": lambda: hemicatenoid(10.0, obstacle=True),
}


@pytest.fixture(params=TAYLOR)
def displaced(request):
    """A strictly feasible state with η ≠ 0, and a direction in all free unknowns."""
    problem = discretised(TAYLOR[request.param]())
    problem.mu = 0.1
    random = np.random.default_rng(5)
    free = np.array(list(problem.free))
    state = vector(problem)
    size = 0.1 * np.abs(state).max()
    eta = slice(problem.psi_dofs.stop, None)
    state[eta] = size * random.uniform(-1, 1, len(state))[eta] * free[eta]
    assert problem.least_jacobian() > 0 and problem.slacks().min() > 0
    return problem, size * random.uniform(-1, 1, len(state)) * free


def barrier_value(problem):
    """E + work − μ Σ ∫ log c dA."""
    barrier = (problem.weights * np.log(problem.slacks())).sum()
    return problem.cost() + problem.work() - problem.mu * barrier


def barrier_slope(problem):
    return derivative(problem, problem.mu / problem.slacks())


def remainders(problem, direction, curved):
    """|value|, first and second order of the value, first order of the gradient, for falling t."""
    state = vector(problem)
    base, value, slope = state.copy(), barrier_value(problem), barrier_slope(problem)
    rows = []
    for t in 2.0 ** -np.arange(7, 12):
        state[:] = base + t * direction
        change, turned = barrier_value(problem) - value, barrier_slope(problem) - slope
        first = change - t * slope @ direction
        second = first - t * t * curved @ direction / 2
        rows.append([abs(first), abs(second), np.linalg.norm(turned - t * curved)])
    state[:] = base
    return np.array(rows).T


def rates(values):
    values = np.asarray(values)
    return np.log2(values[:-1] / values[1:])


def test_taylor(displaced):
    """ψ, η and barrier: gradient of the value, and the primal-dual matrix at z = μ/c, which is
    the Hessian there and nowhere else."""
    problem, direction = displaced
    c = problem.slacks()
    z = problem.mu / c
    curved = times(problem.hessian(z, z / c), direction)
    first, second, gradients = remainders(problem, direction, curved)
    assert rates(first) == pytest.approx(2, abs=0.2)
    assert rates(second)[1:] == pytest.approx(3, abs=0.3)
    assert rates(gradients)[1:] == pytest.approx(2, abs=0.2)
    assert second[-1] < 0.1 * first[-1]

    curved = times(problem.hessian(3 * z, 3 * z / c), direction)
    _, second, gradients = remainders(problem, direction, curved)
    assert rates(second)[-1] < 2.3 and rates(gradients)[-1] < 1.3


def test_linear_solver_with_and_without_pivoting(displaced):
    """LDLᵀ of the softened matrix, refined, and LU of the matrix itself."""
    problem, direction = displaced
    c = problem.slacks()
    matrix = problem.hessian(problem.mu / c, problem.mu / c**2)
    matrix.AsVector().data += problem.flow.AsVector()
    load, found = (problem.state.vec.CreateVector() for _ in range(2))
    load.FV().NumPy()[:] = times(matrix, direction)
    for inverse, accuracy in (("sparsecholesky", ACCURACY), ("umfpack", 1e-7)):
        problem.inverse = inverse
        system = SaddleSystem(problem)
        for scale in (1.0, 2.0):  # the same system again, with other entries
            matrix.AsVector().data *= scale
            system.solver(matrix)(load, found)
            missed = times(matrix, found.FV().NumPy()) - load.FV().NumPy()
            assert np.linalg.norm(missed[list(problem.free)]) < accuracy * load.Norm()
        matrix.AsVector().data *= 0.5


def test_minimum_is_told_from_other_saddles(displaced):
    """By the pivots, as by the eigenvalues: as many negative ones as η."""
    problem, _ = displaced
    c, free = problem.slacks(), list(problem.free)
    matrix = problem.hessian(problem.mu / c, problem.mu / c**2)
    multipliers = sum(free[problem.psi_dofs.stop :])
    problem.inverse = "sparsecholesky"
    system = SaddleSystem(problem)
    told, added = [], 0.0
    for rate in (-100.0, -10.0, -1.0, 0.0, 1.0, 10.0, 100.0, 1000.0):
        matrix.AsVector().data += (rate - added) * problem.flow.AsVector()
        added = rate
        system.solver(matrix)
        dense = matrix.ToDense().NumPy()[free][:, free]
        told.append(system.is_minimum())
        assert told[-1] == ((np.linalg.eigvalsh(dense) < 0).sum() == multipliers)
    assert told == sorted(told) and not told[0] and told[-1]
    factors = matrix.Inverse(problem.free, inverse="sparsecholesky")
    assert _pivots(factors, sum(free) - 1) is None  # as it would be in another layout


def test_slack_changes(displaced):
    problem, direction = displaced
    problem.direction.vec.FV().NumPy()[:] = direction
    changes, state = problem.slack_changes(), vector(problem)
    base, t = state.copy(), 1e-4
    state[:] = base + t * direction
    ahead = problem.slacks()
    state[:] = base - t * direction
    behind = problem.slacks()
    for change, plus, minus in zip(changes, ahead, behind, strict=True):
        scale = np.abs(change).max()
        assert scale > 1e-3
        assert (plus - minus) / (2 * t) == pytest.approx(change, abs=1e-4 * scale)


def test_barrier_of_a_uniform_stretch():
    """ψ = cθ: −μ ∫ log(1 − 1/λ) dA of λ = 2/(c (1 + ρ²)), by a quadrature in ρ alone.

    The rim, where λ = 1/c, counts as a part `RIM_SHARE` of the area.
    """
    c, mu = 0.5, 0.3
    scene = Scene(hemisphere().surface, Net(), (Elongation(),), start=(c, c), symmetric=True)
    problem = discretised(scene, maxh=0.25, order=4, quadrature=12)
    iterate = Iterate(problem, mu)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    rho = (nodes + 1) / 2
    conformal = 4 / (1 + rho**2) ** 2
    integrand = 2 * np.log(1 - c * (1 + rho**2) / 2) * conformal * 2 * np.pi * rho
    rim = RIM_SHARE * 2 * np.pi * 2 * np.log(1 - c)
    expected = -mu * ((weights / 2) @ integrand + rim)
    assert 4 * (iterate.lagrangian() - problem.cost()) == pytest.approx(expected, rel=1e-6)


# Equilibrium and reaction, by symbols alone -------------------------------------------------


def cap(radius=1.0, domain=None):
    def chart(t1, t2):
        square = t1 * t1 + t2 * t2
        return [radius * q / (1 + square) for q in (2 * t1, 2 * t2, square - 1)]

    return Surface(chart, domain or Disk(1), side=-1)


SQUARE = Rectangle((-1, 1), (-0.5, 0.5))
SURFACES = {
    "cap": lambda: cap(domain=SQUARE),
    "skew": lambda: skew_surface(SQUARE),
    "catenoid": lambda: Surface(
        lambda u, v: (ngs.cosh(v) * ngs.cos(u), ngs.cosh(v) * ngs.sin(u), v), SQUARE
    ),
}
FABRIC = Net(kc=(2.0, 0.5), ks=0.7)


def wavy(x, y):
    return 0.8 * x + 0.1 * x * y + 0.1 * ngs.sin(y), 0.7 * y + 0.1 * ngs.sin(x) * y + 0.1 * x


def jacobi(pair):
    entries = [f.Diff(t) for f in pair for t in (ngs.x, ngs.y)]
    return ngs.CF(tuple(entries), dims=(len(pair), 2))


@pytest.mark.parametrize("name", SURFACES)
def test_equilibrium_term_is_minus_the_work_of_sliding(name):
    """∫ J S : L_η a = −dE[∇ψ·η] for η that vanishes on the rim, dE by finite differences."""
    surface = SURFACES[name]()
    scene = Scene(surface, FABRIC, (Elongation(),), start=wavy)
    mesh, rule = make_mesh(scene, 0.25, 1), ngs.dx(bonus_intorder=12)
    x, y = ngs.x, ngs.y
    bubble = (1 - x * x) * (0.25 - y * y)
    eta = bubble * (1 + x - 2 * y), bubble * (0.5 + x * y + y)
    psi = wavy(x, y)
    slope = jacobi(psi)
    cloth = Kinematics(slope, surface.metric, FABRIC)
    strain = virtual_strain(ngs.CF(eta), jacobi(eta), surface.metric, surface.metric_derivatives)
    density = cloth.jacobian * ngs.InnerProduct(cloth.contravariant_stress, strain)
    work = ngs.Integrate(density.Compile() * rule, mesh)

    slid = [slope[i, 0] * eta[0] + slope[i, 1] * eta[1] for i in (0, 1)]
    turned = jacobi(slid)

    def energy(t):
        moved = Kinematics(slope + t * turned, surface.metric)
        strain_energy = FABRIC.energy(moved.I4, moved.I6, moved.I8)
        return ngs.Integrate((moved.jacobian * strain_energy).Compile() * rule, mesh)

    t = 1e-3
    change = (8 * (energy(t) - energy(-t)) - (energy(2 * t) - energy(-2 * t))) / (12 * t)
    assert abs(work) > 1e-2
    assert work == pytest.approx(-change, rel=1e-6)


def test_reaction_of_a_balloon():
    """ψ = cθ on a sphere of radius R, Λ = λ²: τ = 8 kc Λ (Λ − 1)/R per flat area, outward.

    Laplace: both tensions per current length are 4 kc (Λ − 1), the sum of both over R is the
    pressure per current area, and flat area grows by Λ.
    """
    radius, c = 2.5, 3.5
    surface, points = cap(radius), np.array([[0.0, 0.0], [0.3, -0.2], [0.6, 0.7]])
    fabric = Net(kc=3.0, ks=5.0)
    cloth = Kinematics(
        ngs.CF((c, 0, 0, c), dims=(2, 2)), surface.metric, fabric, lambda: surface.curvature
    )
    square = (2 * radius / (1 + (points**2).sum(axis=1)) / c) ** 2
    assert (square > 1).any() and (square < 1).any()  # pushed where taut, pulled where slack
    expected = 8 * 3.0 * square * (square - 1) / radius
    assert surface.evaluate(cloth.reaction, points) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("name", SURFACES)
def test_reaction_agrees_with_the_weak_formula(name):
    """Eq. (17): ∫ J (P ∇ψ⁻ᵀ : ∇(v n) − τ v) = 0, with P = dW/dF and F = ∇φ ∇ψ⁻¹."""
    surface = SURFACES[name]()
    scene = Scene(surface, FABRIC, start=wavy)
    mesh, rule = make_mesh(scene, 0.25, 1), ngs.dx(bonus_intorder=12)
    slope = jacobi(wavy(ngs.x, ngs.y))
    cloth = Kinematics(slope, surface.metric, FABRIC, lambda: surface.curvature)
    deformation = jacobi([surface.position[i] for i in range(3)]) * ngs.Inv(slope)
    green = deformation.trans * deformation
    stress = FABRIC.energy(green[0, 0], green[1, 1], green[0, 1]).Diff(deformation)
    traction = stress * ngs.Inv(slope).trans
    for v in (ngs.CF(1), ngs.exp(ngs.x) + ngs.y, ngs.cos(3 * ngs.x) * (1 + ngs.y)):
        pushed = [v * surface.normal[i] for i in range(3)]
        inner = cloth.jacobian * ngs.InnerProduct(traction, jacobi(pushed))
        left = ngs.Integrate(inner.Compile() * rule, mesh)
        right = ngs.Integrate((cloth.jacobian * cloth.reaction * v).Compile() * rule, mesh)
        assert abs(right) > 1e-2
        assert left == pytest.approx(right, rel=1e-9)


# Solves -------------------------------------------------------------------------------------


class Never:
    """A limit that never binds."""

    name = "never"

    def slacks(self, cloth):
        return (cloth.stretch1 + 1,)


@cache
def solved(ks, maxh, **settings):
    return solve(hemisphere(ks), maxh=maxh, **settings)


def largest_eta(result):
    return max(np.abs(c.vec.FV().NumPy()).max() for c in result.state.components[2:])


def test_without_active_limit_equilibrium_costs_nothing():
    """η is discretisation error alone, and the energy that of the scene without limits."""
    surface = hemisphere().surface

    def never(maxh):
        scene = Scene(surface, Net(ks=1.0), (Never(),), symmetric=True)
        return solve(scene, maxh=maxh, barrier_end=1e-7)

    free = solve(Scene(surface, Net(ks=1.0), symmetric=True), maxh=0.3, tolerance=1e-12)
    coarse, fine = never(0.3), never(0.15)
    assert coarse.converged and fine.converged and free.converged
    assert coarse.normalized_energy == pytest.approx(free.normalized_energy, rel=1e-4)
    assert coarse.normalized_energy >= free.normalized_energy * (1 - 1e-9)  # one condition more
    assert solved(1.0, 0.3).normalized_energy > 1.5 * free.normalized_energy
    assert largest_eta(coarse) < 0.05 * largest_eta(solved(1.0, 0.3))
    assert largest_eta(fine) < 0.6 * largest_eta(coarse)


def test_barrier_bias_falls_like_mu():
    ends = [1e-2, 1e-3, 1e-4, 1e-6]
    energies = np.array([solved(1.0, 0.3, barrier_end=mu).normalized_energy for mu in ends])
    assert (np.diff(energies) < 0).all()
    bias = energies[:-1] - energies[-1]
    order = np.log10(bias[:-1] / bias[1:])
    assert ((0.7 < order) & (order < 1.3)).all()
    assert bias[1] < 1e-3 * energies[-1]


def assert_solved(result, slack=1e-2, shear=1.0, steps=60):
    """Converged swiftly, not folded, and feasible between the sampling points up to `slack`."""
    assert result.converged and result.newton_iterations <= steps
    extrema = result.extrema
    assert extrema["jacobian"][0] > 0
    assert min(extrema["stretch1"][0], extrema["stretch2"][0]) >= 1 - slack
    assert max(np.abs(extrema["shear"])) <= shear + 1e-2


@pytest.mark.parametrize(
    "ks, energy, stretch, slack",
    [
        (1.0, (0.18417, 0.001), (1.231, 0.005), 0.01),
        (10.0, (0.8984, 0.006), (1.625, 0.006), 0.01),
        (100.0, (1.4087, 0.008), (1.821, 0.006), 0.015),
    ],
)
def test_hemisphere(ks, energy, stretch, slack):
    """Energies are the limits of orders 4 and 6; stretches those of maxh 0.05."""
    coarse, fine = solved(ks, 0.3), solved(ks, 0.15)
    assert_solved(coarse, 3 * slack)
    assert_solved(fine, slack)
    assert fine.normalized_energy == pytest.approx(energy[0], abs=energy[1])
    for thread in ("stretch1", "stretch2"):
        assert fine.extrema[thread][1] == pytest.approx(stretch[0], abs=stretch[1])
    assert fine.equilibrium_residual < 0.3 * coarse.equilibrium_residual < 0.1


def test_linear_multiplier_leaves_the_rim_unbalanced():
    """A poorer η asks for less: less energy, and more force left."""
    poor, rich = solved(1.0, 0.15, multiplier_order=1), solved(1.0, 0.15)
    assert_solved(poor)
    assert poor.normalized_energy < 0.95 * rich.normalized_energy
    assert poor.equilibrium_residual > 3 * rich.equilibrium_residual


def test_eta_falls_to_zero_within_the_last_triangles_before_the_rim():
    inside, seminorm = [], []
    for maxh in (0.1, 0.05):
        result = solve(hemisphere(1), maxh=maxh)
        eta, mesh = result.state.components[2:], result.state.space.mesh
        inside.append([component(mesh(0.5 * x, 0.5 * y)) for component in eta for x, y in ROUND])
        square = sum(ngs.InnerProduct(ngs.grad(c), ngs.grad(c)) for c in eta)
        seminorm.append(np.sqrt(ngs.Integrate(square, mesh)))
    np.testing.assert_allclose(*inside, rtol=0.03)
    assert seminorm[1] > 1.4 * seminorm[0]  # of a jump it grows like h^-1/2


def test_hemicatenoid():
    result = solve(hemicatenoid(10.0), maxh=0.2)
    assert_solved(result)
    assert result.normalized_energy == pytest.approx(0.235, abs=0.006)
    assert result.equilibrium_residual < 0.05


def test_sphere_with_shear_limit():
    """All energy that is left is the limit's: a barrier of 1e-3 would cost three times as much."""
    limit = float(np.cos(np.pi / 6))
    result = solve(sphere(0.6, shear_limit=limit), maxh=0.15, barrier_end=1e-5)
    assert_solved(result, shear=limit)
    assert result.normalized_energy == pytest.approx(4.598e-4, rel=5e-3)
    assert result.extrema["shear"][1] > 0.98 * limit  # it binds


def test_quarter_and_whole_agree():
    """Two meshes, one of them with mirror lines: the same patch."""
    quarter = solved(10.0, 0.25)
    whole = solve(hemisphere(10.0, symmetric=False), maxh=0.25)
    assert_solved(whole, 0.03)
    assert whole.normalized_energy == pytest.approx(quarter.normalized_energy, rel=1e-2)
    assert whole.area == pytest.approx(quarter.area, rel=1e-2)


def test_shear_a_million_times_as_stiff_as_threads():
    """Cloth that can hardly shear: IPOPT finds the same patch, in 339 steps.

    On finer meshes there are several minima, and rounding decides how soon which one is found.
    """
    result = solve(hemicatenoid(1e6), maxh=0.35, max_steps=250)
    assert result.converged
    assert result.normalized_energy == pytest.approx(0.3051, abs=2e-4)
    assert result.extrema["shear"][1] < 0.002


def test_obstacle():
    """Unless τ ≥ 0 is asked for, the surface pulls the cloth somewhere; asking costs energy."""
    free = solve(hemicatenoid(10.0), maxh=0.4)
    result = solve(hemicatenoid(10.0, obstacle=True), maxh=0.4)
    assert_solved(result, 0.05, steps=90)
    assert_strictly_feasible(result)
    assert free.extrema["reaction"][0] < -5 and result.extrema["reaction"][0] > -1
    assert result.normalized_energy > 1.1 * free.normalized_energy


# What users bring ---------------------------------------------------------------------------


class Longest:
    """No thread is stretched beyond `largest`."""

    name = "longest thread"

    def __init__(self, largest):
        self.largest = largest

    def slacks(self, cloth):
        return self.largest - cloth.stretch1, self.largest - cloth.stretch2


def test_a_limit_from_outside():
    """λ ≤ 1.05 where the scene with a limit that never binds stretches threads to 1.16."""
    surface, fabric = hemisphere().surface, Net(ks=10.0)
    results = []
    for limit in (Never(), Longest(1.05)):
        scene = Scene(surface, fabric, (limit,), start=(2.0, 2.0), symmetric=True)
        results.append(solve(scene, maxh=0.25))
        assert results[-1].converged
    free, short = results
    assert_strictly_feasible(short)
    for thread in ("stretch1", "stretch2"):
        assert free.extrema[thread][1] > 1.15
        assert 1.03 < short.extrema[thread][1] < 1.05 + 1e-2
    assert short.normalized_energy > 1.2 * free.normalized_energy


def nearly_inextensible(factor):
    """Odd polynomials near the Chebyshev net of the hemisphere, times `factor`."""
    net = solve(hemisphere(), maxh=0.3)
    t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
    x, y = (np.outer(np.linspace(0.1, 1, 8), f(t)).ravel() for f in (np.cos, np.sin))
    powers = [(i, j) for i in (1, 3, 5, 7) for j in (0, 2, 4, 6) if i + j <= 7]
    basis = np.stack([x**i * y**j for i, j in powers], axis=-1)
    weights = factor * np.linalg.lstsq(basis, net.psi(x, y)[:, 0], rcond=None)[0]

    def odd(x, y):
        return sum(
            float(w) * x**i * (y**j if j else 1) for w, (i, j) in zip(weights, powers, strict=True)
        )

    return lambda x, y: (odd(x, y), odd(y, x))


def test_limits_that_leave_no_equilibrium_are_not_called_solved():
    """1 ≤ λ ≤ 1.35 where the patch in equilibrium needs 1.6 at the pole.

    The start respects both limits, out of equilibrium. The solve has to give up, well within the
    budget, with a patch that is not folded.
    """
    scene = Scene(
        hemisphere().surface,
        Net(ks=10.0),
        (Elongation(), Longest(1.35)),
        start=nearly_inextensible(0.85),
        symmetric=True,
    )
    result = solve(scene, maxh=0.3, max_steps=200)
    assert result.reason is Reason.BLOCKED
    assert result.extrema["jacobian"][0] > 0


class Locking:
    """Threads that lock: (exp(b (I − 1)²) − 1)/b, which for small strains is (I − 1)²."""

    stiffness = 1.0
    b = 0.5

    def energy(self, I4, I6, I8):
        threads = sum((ngs.exp(self.b * (i - 1) ** 2) - 1) / self.b for i in (I4, I6))
        return threads + 10 * I8**2


def test_a_fabric_from_outside():
    """Threads that lock are stretched less than the net's, at the same shear stiffness."""
    net = solved(10.0, 0.25)
    scene = Scene(net.scene.surface, Locking(), (Elongation(),), start=(0.9, 0.9), symmetric=True)
    result = solve(scene, maxh=0.25)
    assert_solved(result, 0.03)
    assert result.extrema["stretch1"][1] < net.extrema["stretch1"][1] - 0.05
    assert result.normalized_energy > net.normalized_energy  # its energy is never below the net's
    assert result.extrema["shear"][1] > net.extrema["shear"][1]  # it shears instead


@pytest.mark.parametrize("kc", [1e-6, 1e6])
def test_patch_does_not_depend_on_the_unit_of_stiffness(kc):
    one = solved(10.0, 0.3)
    scene = Scene(
        one.scene.surface, Net(kc=kc, ks=10 * kc), (Elongation(),), start=(0.5, 0.5), symmetric=True
    )
    result = solve(scene, maxh=0.3)
    assert result.converged
    assert result.area == pytest.approx(one.area, rel=1e-6)
    assert result.energy == pytest.approx(kc * one.energy, rel=1e-6)
    assert result.extrema["reaction"][1] == pytest.approx(kc * one.extrema["reaction"][1], rel=1e-4)
    assert result.equilibrium_residual == pytest.approx(one.equilibrium_residual, rel=1e-3)


def test_exchange_of_warp_and_weft():
    """Unlike threads, turned by a quarter: warp and weft change places, shear its sign."""
    surface = hemisphere().surface
    one = solve(Scene(surface, Net((2.0, 0.5), 1.0), (Elongation(),), start=(0.5, 0.4)), maxh=0.5)
    turned = Scene(
        surface, Net((0.5, 2.0), 1.0), (Elongation(),), start=lambda x, y: (0.4 * y, -0.5 * x)
    )
    other = solve(turned, maxh=0.5)
    assert one.converged and other.converged
    assert other.energy == pytest.approx(one.energy, rel=1e-6)
    assert other.area == pytest.approx(one.area, rel=1e-6)
    here, there = one.extrema, other.extrema
    assert abs(here["stretch1"][1] - here["stretch2"][1]) > 0.05
    for mine, its in (("stretch1", "stretch2"), ("stretch2", "stretch1")):
        assert there[its] == pytest.approx(here[mine], rel=1e-5)
    low, high = here["shear"]
    assert there["shear"] == pytest.approx((-high, -low), abs=1e-5)


# Steps, budgets, starts, refusals -----------------------------------------------------------


def test_refused_step_leaves_the_state_whole(monkeypatch):
    problem = discretised(hemisphere(10.0))
    iterate, recorder = Iterate(problem, 1.0), Recorder(1.0, 100, None)
    before = [vector(problem).copy(), iterate.c.copy(), iterate.s.copy(), iterate.z.copy()]
    with monkeypatch.context() as patch:
        patch.setattr(problem, "cost", lambda: np.nan)
        rate, accepted = iterate.step(recorder)
    assert not accepted and iterate.refusals == 1
    after = [vector(problem), iterate.c, iterate.s, iterate.z]
    assert all(map(np.array_equal, after, before))
    assert iterate.rate > rate > 0  # the next one is shorter
    rate, accepted = iterate.step(recorder)
    assert accepted and not np.array_equal(vector(problem), before[0])


def assert_strictly_feasible(result):
    settings = result.settings
    problem = ConstrainedLagrangian(
        result.scene,
        result.state.space.mesh,
        settings["order"],
        settings["quadrature"],
        settings["inverse"],
        settings["multiplier_order"],
    )
    vector(problem)[:] = result.state.vec.FV().NumPy()
    assert problem.least_jacobian() > 0
    assert problem.slacks().min() > 0


def test_budget_of_steps_leaves_a_feasible_iterate():
    result = solved(10.0, 0.3, max_steps=5)
    assert result.reason is Reason.STEP_BUDGET and not result.converged
    assert result.newton_iterations == 5
    assert_strictly_feasible(result)
    with pytest.raises(ngcloth.SolveError) as caught:
        solve(result.scene, maxh=0.3, max_steps=5, throw=True)
    assert caught.value.result.reason is Reason.STEP_BUDGET


def test_limits_hold_strictly_at_the_sampling_points():
    for result in (solved(1.0, 0.15), solved(100.0, 0.3)):
        assert_strictly_feasible(result)


def test_slack_start_is_pulled_taut():
    """ψ = 3θ leaves threads at a third of their length; the answer does not depend on it."""
    scene = Scene(
        hemisphere().surface, Net(ks=10.0), (Elongation(),), start=(3.0, 3.0), symmetric=True
    )
    lines = []
    result = solve(scene, maxh=0.3, log=lines.append)
    (line,) = [line for line in lines if "start" in line]
    assert float(line.split()[-1]) < 1 / 3
    assert result.converged
    assert result.energy == pytest.approx(solved(10.0, 0.3).energy, rel=1e-4)


def test_hopeless_start_is_refused():
    """Shear does not change with scale, and what is flattened has some: none respects the limit."""
    scene = Scene(
        hemisphere().surface,
        Net(ks=10.0),
        (Elongation(), ShearLimit(0.05)),
        start=lambda x, y: (x + y, y),
    )
    with pytest.raises(InputError, match="start.*shear limit") as caught:
        solve(scene, maxh=0.4)
    assert caught.value.argument == "start"


@pytest.mark.parametrize(
    "setting, value",
    [
        ("multiplier_order", 0),
        ("multiplier_order", 1.5),
        ("multiplier_order", True),
        ("barrier_end", 0.0),
        ("barrier_end", 10.0),
        ("barrier_end", -1e-3),
        ("barrier_end", np.nan),
        ("barrier_end", "small"),
        ("schedule", "fast"),
    ],
)
def test_bad_settings(setting, value):
    with pytest.raises(InputError) as caught:
        solve(hemisphere(1.0), maxh=0.5, **{setting: value})
    assert caught.value.argument == setting


@pytest.mark.parametrize("limit", [1.2, 1.0, 0.0, -0.5, np.nan, "0.5", True])
def test_bad_shear_limit(limit):
    for make in (ShearLimit, lambda limit: sphere(0.6, shear_limit=limit)):
        with pytest.raises(InputError) as caught:
            make(limit)
        assert caught.value.argument == "shear_limit"


@pytest.mark.parametrize("limits", [Elongation(), (Elongation,), ("taut",), 1.0])
def test_bad_constraints(limits):
    with pytest.raises(InputError) as caught:
        Scene(hemisphere().surface, Net(ks=1.0), limits)
    assert caught.value.argument == "constraints"


def test_obstacle_needs_stress():
    with pytest.raises(InputError):
        hemicatenoid(0.0, obstacle=True)
    assert any(
        isinstance(limit, Obstacle) for limit in hemicatenoid(1.0, obstacle=True).constraints
    )


def test_a_start_beyond_a_limit_from_above_is_dilated():
    """ψ = θ/2 stretches threads up to 4, and 1.5 is allowed: a larger multiple is feasible."""
    scene = Scene(hemisphere().surface, Net(ks=10.0), (Longest(1.5),), (0.5, 0.5), symmetric=True)
    mesh = make_mesh(scene, 0.3, order=2)
    problem = ConstrainedLagrangian(scene, mesh, 2, 6, "sparsecholesky", multiplier_order=2)
    size = problem.state.vec.Norm()
    feasible_start(problem)
    assert problem.slacks().min() > 0
    assert problem.state.vec.Norm() > 4 / 1.5 * size
    result = ngcloth.solve(scene, maxh=0.3)
    assert result.converged and result.extrema["stretch1"][1] < 1.5 + 1e-2


def test_half_finished_classes_are_refused():
    """A limit without a name, and a fabric without a stiffness."""
    surface = hemisphere().surface
    nameless = type("Nameless", (), {"slacks": lambda self, cloth: (cloth.stretch1,)})()
    with pytest.raises(InputError, match="constraints"):
        Scene(surface, Net(ks=1.0), (nameless,))
    bare = type("Bare", (), {"energy": lambda self, I4, I6, I8: (I4 - 1) ** 2})()
    with pytest.raises(InputError, match="stiffness"):
        Scene(surface, bare)


def test_tie_break_is_for_scenes_without_limits():
    """Its term would be missing from the objective of the line search."""
    with pytest.raises(InputError, match="tie_break"):
        Scene(hemisphere().surface, Net(ks=1.0), hemisphere(1.0).constraints, tie_break=1e-8)


@pytest.mark.parametrize("unit", [1e-6, 1e3])
def test_unit_of_length_changes_nothing(unit):
    """Not the steps either; norms in parameters of η took 10, 13 and 19 at 1, 1e3 and 1e6."""

    def dome(length):
        def chart(x, y):
            scale = length / (1 + x * x + y * y)
            return 2 * scale * x, 2 * scale * y, scale * (x * x + y * y - 1)

        return Scene(Surface(chart, Disk(), side=-1), Net(ks=1.0), (Elongation(),), symmetric=True)

    here, there = (solve(dome(length), maxh=0.3) for length in (1.0, unit))
    assert there.converged
    assert there.newton_iterations == here.newton_iterations
    assert there.energy == pytest.approx(unit**2 * here.energy, rel=1e-8)


def test_short_steps_raise_the_barrier_to_what_it_was():
    """However many follow, μ returns to its weight before it was lowered, and no further."""
    scene = hemisphere(1.0)
    problem = discretised(scene, 0.6)
    feasible_start(problem)
    iterate = Iterate(problem, 1.0)
    iterate.lower_mu(1e-3)
    iterate.lower_mu(1e-3)
    assert iterate.mu == pytest.approx(0.04)
    for mu in (0.04, 0.04, 0.2, *[0.2] * 6):
        iterate._retreat_if_stuck(1.0, 0.05)
        assert iterate.mu == problem.mu == pytest.approx(mu)
    iterate.lower_mu(1e-3)
    assert iterate.mu == pytest.approx(0.04)


def test_multipliers_begin_anew_after_steps_at_large_rates():
    """A multiplier that has run away from its slack keeps every later step from moving."""
    problem = discretised(hemisphere(1.0), 0.6)
    feasible_start(problem)
    iterate = Iterate(problem, 1.0)
    iterate.lower_mu(1e-3)
    iterate.s[0, 0], iterate.z[0, 0] = 1e-7, 1e6
    problem.unknowns[problem.psi_dofs.stop :] = 1.0
    for _ in range(7):
        iterate._retreat_if_stuck(1e4, 1.0)
    assert iterate.z[0, 0] == 1e6 and iterate.mu == pytest.approx(0.2)
    iterate._retreat_if_stuck(1e4, 1.0)
    assert iterate.mu == pytest.approx(1.0)
    assert iterate.s == pytest.approx(np.maximum(problem.slacks(), 0.01))
    assert iterate.s * iterate.z == pytest.approx(1.0)
    assert not problem.unknowns[problem.psi_dofs.stop :].any()


@pytest.mark.slow
def test_fine_mesh_of_a_large_portion():
    """At the start on the fine mesh limits leave no room; 400 steps along them do not end."""
    result = solve(sphere(0.85, shear_limit=float(np.cos(np.pi / 6))), maxh=0.025, max_steps=300)
    assert result.converged
    assert result.normalized_energy == pytest.approx(0.992, abs=2e-3)
