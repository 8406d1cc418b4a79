"""The discrete Lagrangian: derivatives, closed forms, the flow's inner product, safe steps."""

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import Disk, Net, Rectangle, Scene, Surface
from ngcloth.energy.lagrangian import Lagrangian
from ngcloth.problem.kinematics import Kinematics, gradient
from ngcloth.solver.meshes import make_sheets
from ngcloth.solver.newton import newton_step


def discretised(scene, maxh=0.4, order=3, quadrature=None, gauss_newton=False):
    quadrature = 2 * order + 2 if quadrature is None else quadrature
    *_, sheet = make_sheets(scene, maxh, order)
    return Lagrangian(scene, sheet, order, quadrature, "sparsecholesky", gauss_newton)


def vector(problem):
    """The coefficients of the state, a NumPy view to read and write."""
    return problem.state.vec.FV().NumPy()


def dense(matrix):
    rows, columns, entries = matrix.COO()
    full = np.zeros(matrix.shape)
    full[np.array(rows), np.array(columns)] = np.array(entries)
    return full


def derivative(problem):
    out = problem.state.vec.CreateVector()
    problem.gradient(out)
    return out.FV().NumPy().copy()


def bent_start(x, y):
    return 0.9 * x + 0.1 * x * y * y, 0.8 * y + 0.07 * y * x * x


def skew_surface(domain=None):
    def chart(t1, t2):
        return t1 + 0.2 * t1 * t2, 1.1 * t2 + 0.1 * t1, 0.3 * t1 * t1 + 0.2 * ngs.sin(t2)

    return Surface(chart, domain or Disk(1))


SCENES = {
    "hemisphere": lambda: ngcloth.scenes.hemisphere(),
    "hemisphere ks = 3": lambda: ngcloth.scenes.hemisphere(3.0),
    "bent start": lambda: Scene(
        ngcloth.scenes.hemisphere().surface, Net(ks=0.4), start=bent_start, symmetric=True
    ),
    "skew chart, two stiffnesses": lambda: Scene(
        skew_surface(), Net(kc=(2.0, 0.5), ks=0.3), start=bent_start
    ),
    "tie break": lambda: ngcloth.scenes.hemicatenoid(),
    "tie break, whole": lambda: ngcloth.scenes.hemicatenoid(symmetric=False),
}


@pytest.mark.parametrize("name", SCENES)
def test_taylor(name):
    """Remainders of energy, gradient and Hessian fall at the order that Taylor promises."""
    problem = discretised(SCENES[name]())
    problem.mu = 0.7
    state = vector(problem)
    random = np.random.default_rng(3)
    direction = random.standard_normal(len(state)) * (np.abs(state) > 0)
    direction *= np.abs(state).max() / np.abs(direction).max()

    base, value, slope = state.copy(), problem.value(), derivative(problem)
    curved = dense(problem.hessian()) @ direction
    steps = 2.0 ** -np.arange(12, 17)
    zeroth, first, second, gradients = np.array(
        [_remainders(problem, base, t * direction, value, slope, t * curved) for t in steps]
    ).T

    def rates(remainders):
        return np.log2(remainders[:-1] / remainders[1:])

    assert rates(first) == pytest.approx(2, abs=0.15)
    assert rates(second) == pytest.approx(3, abs=0.15)
    assert rates(gradients) == pytest.approx(2, abs=0.15)
    assert zeroth[-1] > 10 * first[-1] > 100 * second[-1]


def _remainders(problem, base, move, value, slope, curved):
    state = vector(problem)
    state[:] = base + move
    change = problem.value() - value
    turned = derivative(problem) - slope - curved
    state[:] = base
    first = change - slope @ move
    return abs(change), abs(first), abs(first - curved @ move / 2), np.linalg.norm(turned)


def tie_broken(start, maxh=0.4):
    """What the tie-break adds to E/kc at μ = 2, on a rectangle of area 2."""
    surface = skew_surface(Rectangle((-1, 1), (-0.5, 0.5)))
    scene = Scene(surface, Net(), start=start, tie_break=1e-3)
    problem = discretised(scene, maxh=maxh, order=3)
    problem.mu = 2.0
    return problem.value() - problem.cost()


def test_tie_break_of_even_bending_is_little_of_its_energy():
    """0.01 ∫ |∇∇ψ|² of a quadratic ψ, in closed form."""
    square = 2 * 0.2**2 + (2 * 0.1) ** 2
    added = tie_broken(lambda x, y: (x + 0.2 * x * y, y + 0.1 * x * x))
    assert added == pytest.approx(0.01 * square * 2, rel=1e-10)


def test_tie_break_of_uneven_bending_does_not_depend_on_the_mesh():
    """Elements of half the size have bending that varies half as much."""

    def cubic(x, y):
        return x + 0.1 * x**3, y + 0.05 * x * y**2

    coarse, fine = (tie_broken(cubic, maxh) for maxh in (0.2, 0.1))
    assert coarse == pytest.approx(fine, rel=0.1)
    bending = (0.6**2 + 0.1**2) * 2 / 3 + 2 * 0.1**2 / 6
    assert fine > 3 * 0.01 * bending


CYLINDER = Surface(lambda t1, t2: (2 * ngs.cos(t1), 2 * ngs.sin(t1), t2), Disk(1))


def test_gauss_newton_is_the_hessian_where_the_energy_vanishes():
    scene = Scene(CYLINDER, Net(kc=(1.0, 3.0)), start=(2.0, 1.0))
    newton, gauss = (discretised(scene, gauss_newton=flag) for flag in (False, True))
    assert newton.value() < 1e-25
    exact, model = dense(newton.hessian()), dense(gauss.hessian())
    assert np.abs(exact).max() > 1
    assert np.abs(exact - model).max() < 1e-10 * np.abs(exact).max()


def test_gauss_newton_is_never_indefinite():
    """Where the Hessian has negative eigenvalues, Gauss-Newton has none."""
    scene = ngcloth.scenes.hemisphere()
    eigenvalues = {}
    for flag in (False, True):
        problem = discretised(scene, gauss_newton=flag)
        vector(problem)[:] *= 3
        free = np.array(list(problem.free))
        matrix = dense(problem.hessian())[np.ix_(free, free)]
        assert np.abs(matrix - matrix.T).max() < 1e-12 * np.abs(matrix).max()
        eigenvalues[flag] = np.linalg.eigvalsh(matrix)
    assert eigenvalues[False][0] < -1e-3 * eigenvalues[False][-1]
    assert eigenvalues[True][0] > -1e-12 * eigenvalues[True][-1]


def test_gauss_newton_keeps_energy_and_gradient():
    newton, gauss = (
        discretised(ngcloth.scenes.hemisphere(), gauss_newton=flag) for flag in (False, True)
    )
    gauss.hessian()
    assert gauss.value() == pytest.approx(newton.value(), rel=1e-13)
    assert derivative(gauss) == pytest.approx(derivative(newton), rel=1e-12, abs=1e-14)


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("c, ks", [(0.5, 0.0), (1.3, 7.0)])
def test_scaled_identity_on_the_hemisphere(c, ks, symmetric):
    """ψ = cθ, a = 4/(1 + ρ²)² I: λ = 2/(c (1 + ρ²)), γ = 0, E/(2π kc) = c² − 4 + 14/(3c²)."""
    surface = ngcloth.scenes.hemisphere().surface
    problem = discretised(
        Scene(surface, Net(ks=ks), start=(c, c), symmetric=symmetric),
        maxh=0.25,
        order=4,
        quadrature=12,
    )
    copies = problem.scene.copies
    assert copies * problem.cost() / (2 * np.pi) == pytest.approx(
        c**2 - 4 + 14 / (3 * c**2), rel=2e-7
    )
    assert copies * problem.area == pytest.approx(2 * np.pi, rel=1e-7)
    cloth = Kinematics(gradient(*problem.state.components), surface.metric)
    points = np.array([[0.1, 0.2], [0.5, 0.5], [0.3, 0.8], [0.0, 0.95]])
    at = problem.fes.mesh(*points.T)
    stretch = (2 / (c * (1 + (points**2).sum(axis=1))))[:, None]
    assert cloth.stretch1(at) == pytest.approx(stretch, rel=1e-11)
    assert cloth.stretch2(at) == pytest.approx(stretch, rel=1e-11)
    assert np.abs(cloth.shear(at)).max() < 1e-11
    assert problem.largest_shear() < 1e-10
    assert problem.least_jacobian() == pytest.approx(c**2, rel=1e-10)


def test_energy_of_a_sheared_plane():
    """ψ = (x + s y, y) on the plane: I4 = 1, I8 = −s, I6 = 1 + s², whatever the stiffnesses."""
    plane = Surface(lambda t1, t2: (t1, t2, 0), Rectangle((0, 2), (0, 1)))
    s = 0.4
    problem = discretised(
        Scene(plane, Net(kc=(3.0, 5.0), ks=2.0), start=lambda x, y: (x + s * y, y))
    )
    density = 5 * s**4 + 2 * s**2
    assert problem.cost() * 4 == pytest.approx(2 * density, rel=1e-12)  # the mean stiffness is 4
    assert problem.largest_shear() == pytest.approx(s / np.sqrt(1 + s * s), rel=1e-12)


def flow_norm(surface, start):
    problem = discretised(Scene(surface, Net(), start=start), maxh=0.35, order=6)
    state = vector(problem)
    return state @ dense(problem.flow) @ state


def test_flow_does_not_depend_on_the_chart():
    """∫ |∇ψ|² over the catenoid, by its conformal chart, by arc length, and by a skewed chart."""

    def catenoid(t1, t2):
        return ngs.cosh(t2) * ngs.cos(t1), ngs.cosh(t2) * ngs.sin(t1), t2

    def asinh(s):
        return ngs.log(s + ngs.sqrt(1 + s * s))

    conformal = Surface(catenoid, Rectangle((0, 2), (-1, 1)))
    end = float(np.sinh(1))
    by_length = Surface(lambda s1, s2: catenoid(2 * s1, asinh(s2)), Rectangle((0, 1), (-end, end)))
    # Dirichlet's integral does not feel a conformal chart: 2 |U| for ψ = θ.
    assert flow_norm(conformal, lambda x, y: (x, y)) == pytest.approx(8, rel=1e-10)
    assert flow_norm(by_length, lambda x, y: (2 * x, asinh(y))) == pytest.approx(8, rel=1e-6)

    def wavy(x, y):
        return x + 0.2 * ngs.sin(x) * y, y + 0.1 * x * y

    one = flow_norm(conformal, wavy)
    assert abs(one - 8) > 0.1
    assert flow_norm(by_length, lambda x, y: wavy(2 * x, asinh(y))) == pytest.approx(one, rel=1e-6)

    shear = Surface(lambda s1, s2: (s1 + 0.7 * s2, s2, 0), Disk(1))
    # The isometry ψ = φ of a plane chart of area π: ∫ |∇ψ|² = 2π.
    assert flow_norm(shear, lambda x, y: (x + 0.7 * y, y)) == pytest.approx(2 * np.pi, rel=1e-8)


def full_step(problem, rate):
    """The undamped Newton step, by dense linear algebra."""
    free = np.array(list(problem.free))
    matrix = dense(problem.hessian()) + rate * dense(problem.flow)
    step = np.zeros(problem.fes.ndof)
    step[free] = np.linalg.solve(matrix[np.ix_(free, free)], -derivative(problem)[free])
    return step


def test_step_that_would_fold_the_cloth_is_shortened():
    """The full Newton step turns elements over, and lowers the energy by it; the one taken does
    not fold: it descends with J > 0."""

    def twisted(x, y):
        return 0.8 * x + 0.75 * x * y * y, 0.8 * y + 0.75 * x * x * y

    surface = ngcloth.scenes.hemisphere().surface
    scene = Scene(surface, Net(), start=twisted, symmetric=True)
    problem = discretised(scene, maxh=0.25, gauss_newton=True)
    before, value = vector(problem).copy(), problem.value()
    assert problem.least_jacobian() > 0
    full = full_step(problem, 1e-6)
    vector(problem)[:] = before + full
    assert problem.least_jacobian() < 0 and problem.value() < -value
    vector(problem)[:] = before

    step = newton_step(problem, 1e-6)
    assert 0 < step.length < 1
    assert problem.least_jacobian() > 0 and problem.value() < value
    moved = vector(problem) - before
    assert moved == pytest.approx(step.length * full, abs=1e-6 * np.abs(moved).max())


def test_refused_step_leaves_the_state_whole(monkeypatch):
    problem = discretised(ngcloth.scenes.hemisphere(), gauss_newton=True)
    before = vector(problem).copy()
    for unacceptable in (-1.0, 0.0, np.nan):
        monkeypatch.setattr(problem, "least_jacobian", lambda value=unacceptable: value)
        step = newton_step(problem, 1.0)
        assert step.length == 0 and step.decrement > 0
        assert np.array_equal(vector(problem), before)


def test_uphill_step_leaves_the_state_whole():
    """Where the quadratic model has no minimum along the step (here: Δt < 0), nothing moves."""
    problem = discretised(ngcloth.scenes.hemisphere())
    before = vector(problem).copy()
    assert newton_step(problem, -1e6).length == 0
    assert np.array_equal(vector(problem), before)


def test_step_satisfies_the_backward_euler_equation():
    """Steps from an anchor end where L' + (ψ − anchor)ᵀ K / Δt vanishes on all free unknowns."""
    problem = discretised(ngcloth.scenes.hemisphere(2.0))
    anchor = problem.state.vec.CreateVector()
    anchor.data = problem.state.vec
    for _ in range(12):
        newton_step(problem, 1.0, anchor)
    free = np.array(list(problem.free))
    moved = vector(problem) - anchor.FV().NumPy()
    pull, push = derivative(problem)[free], (dense(problem.flow) @ moved)[free]
    assert np.abs(pull).max() > 1e-2
    assert np.abs(pull + push).max() < 1e-8


def test_mirror_lines_hold_and_nothing_else_is_clamped():
    problem = discretised(ngcloth.scenes.hemisphere())
    held = ~np.array(list(problem.free))
    edges = problem.fes.mesh.Boundaries("mirror.*")
    assert (
        0
        < held.sum()
        == sum(
            sum(list(space.GetDofs(edges.Split()[i])))
            for i, space in enumerate(problem.fes.components)
        )
    )
    whole = discretised(ngcloth.scenes.hemisphere(symmetric=False))
    assert np.sum(~np.array(list(whole.free))) == 2
    # ... and those two hold no more than translations, for which the energy has no slope.
    slope = derivative(whole)
    for component in (0, 1):
        ones = np.zeros(whole.fes.ndof)
        shift = ngs.GridFunction(whole.fes)
        shift.components[component].Set(1.0)
        ones[:] = shift.vec.FV().NumPy()
        assert abs(slope @ ones) < 1e-12 * np.abs(slope).max()
