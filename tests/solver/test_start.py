"""Starts far from the answer: flattened and dilated, they lead to it in few steps."""

from math import cos, pi

import ngsolve as ngs
import numpy as np
import pytest

from ngcloth import (
    Disk,
    Elongation,
    Net,
    Reason,
    Rectangle,
    Scene,
    ShearLimit,
    Surface,
    scenes,
    solve,
)
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.problem.kinematics import gradient
from ngcloth.solver.interior_point import interior_point
from ngcloth.solver.meshes import make_sheets
from ngcloth.solver.recorder import Recorder
from ngcloth.solver.start import STRETCHED, dilate, feasible_start, flatten, near_start

BUMP = Surface(lambda x, y: (x, y, ngs.exp(-(x * x + y * y) / 0.09)), Disk())
COARSE = {"order": 2, "barrier_end": 1e-3}
FAR = scenes.sphere(0.95, shear_limit=cos(pi / 6))  # λ up to 40 at its start


def discretised(scene, maxh=0.3):
    *_, sheet = make_sheets(scene, maxh, order=2)
    return ClosedFormLagrangian(scene, sheet, 2, 6, "sparsecholesky", 2)


def with_start(scene, start):
    return Scene(scene.surface, scene.fabric, scene.constraints, start, symmetric=True)


@pytest.mark.parametrize("start", [(0.1, 2.0), (2.0, 0.1), (0.02, 0.02)])
def test_thread_stretched_many_times_over(start):
    """Flattened, they are starts like any other."""
    dome = scenes.hemisphere(1.0)
    result, usual = solve(with_start(dome, start), maxh=0.3), solve(dome, maxh=0.3)
    assert result.converged
    assert result.energy == pytest.approx(usual.energy, rel=1e-4)
    assert result.newton_iterations <= usual.newton_iterations + 4


def test_dilation_stops_where_the_cost_is_small_or_the_state_not_allowed():
    problem = discretised(with_start(scenes.hemisphere(1.0), (0.05, 0.05)))
    vector, size = problem.state.vec.FV().NumPy(), np.linalg.norm(problem.state.vec.FV().NumPy())
    kept = vector.copy()
    dilate(problem, allowed=lambda: np.linalg.norm(vector) < 1.5 * size)
    assert np.linalg.norm(vector) == pytest.approx(1.1**4 * size)
    dilate(problem)
    assert STRETCHED / 2 < problem.cost() / problem.area <= STRETCHED
    vector[:] = kept / kept.max()
    kept = vector.copy()
    dilate(problem)
    assert np.array_equal(vector, kept)


def test_stretched_chebyshev_start():
    """E(sψ) falls by the fourth power of s, and Newton's method by a quarter at a time."""
    sphere = scenes.sphere(0.7)
    stretched = Scene(sphere.surface, Net(), (), start=(0.01, 0.01), symmetric=True)
    results = [solve(scene, maxh=0.2) for scene in (sphere, stretched)]
    assert all(result.converged for result in results)
    assert results[0].energy == pytest.approx(results[1].energy, rel=1e-4)
    assert results[1].newton_iterations <= results[0].newton_iterations + 4


def test_stressed_start():
    """Threads up to forty times their length. Of two minima, 24.9 and 25.6, rounding chooses."""
    result = solve(FAR, maxh=0.28, **COARSE)
    assert result.converged
    assert result.normalized_energy < 26
    assert result.newton_iterations <= 190


@pytest.mark.parametrize("steps", [5, 12])
def test_solve_from_a_stressed_start_is_taken_up_again(steps, tmp_path):
    path = tmp_path / "run.npz"
    whole = solve(FAR, maxh=0.31, **COARSE)
    cut = solve(FAR, maxh=0.31, checkpoint=path, max_steps=steps, **COARSE)
    assert cut.reason is Reason.STEP_BUDGET
    rest = solve(FAR, maxh=0.31, checkpoint=path, **COARSE)
    # Steps cut very short differ by rounding between two runs of the same solve, too.
    assert rest.newton_iterations == pytest.approx(whole.newton_iterations, rel=0.25)
    assert rest.energy == pytest.approx(whole.energy, rel=1e-6)


@pytest.mark.parametrize(
    "scene, maxh, energy",
    [(scenes.sphere(0.83), 0.1, 1.2199e-4), (Scene(BUMP, Net(), symmetric=True), 0.12, 8.3877e-4)],
    ids=["almost collapsed", "bump"],
)
def test_hessian_takes_over_from_gauss_newton(scene, maxh, energy):
    """Where the mesh leaves a residual, Gauss-Newton alone takes 23 and 64 steps."""
    result = solve(scene, maxh=maxh)
    assert result.converged
    assert result.normalized_energy == pytest.approx(energy, rel=1e-3)
    assert result.newton_iterations <= 18


def paraboloid(shear):
    """A cap on sheared coordinates, flat enough for all shears to be nearly the same."""

    def chart(x, y):
        u = x + shear * y
        return u, y, -0.3 * (u * u + y * y) / (1 + shear)

    return Surface(chart, Disk())


@pytest.mark.parametrize("shear", [5.0, 10.0, 100.0])
def test_start_on_sheared_coordinates(shear):
    """Flattened, it is nearly isometric; without, at 10, 374 steps."""
    scene = Scene(paraboloid(shear), Net(1.0, 1.0), (Elongation(),))
    result = solve(scene, maxh=0.3, **COARSE)
    assert result.converged
    assert result.newton_iterations <= 40
    assert result.extrema["stretch1"][1] < 1.2  # 3.2 at what is found without, at shear 10


def test_flattened_start_of_a_developable_surface_is_an_isometry():
    """A cone, cut open: steps lead to the one flattening without strain, and go on to it."""
    cone = Surface(
        lambda x, y: (x * ngs.cos(y) / 2, x * ngs.sin(y) / 2, np.sqrt(0.75) * x),
        Rectangle((1, 2), (0, pi)),
    )
    problem = discretised(Scene(cone, Net(1.0, 1.0), (Elongation(),), (3.0, 0.4)), 0.1)
    assert problem.cost() > problem.area
    flatten(problem)
    assert problem.cost() < 1e-2 * problem.area
    for _ in range(100):
        problem.rigid_step()
    assert problem.cost() < 1e-6 * problem.area


def test_rigid_steps_lower_the_distance_to_an_isometry():
    """∫ |∇ψ √a⁻¹ − R|² dA falls with each, with R the nearest rotation."""
    problem = discretised(with_start(scenes.hemicatenoid(1.0), (2.0, 0.5)))
    metric = problem.scene.surface.metric  # conformal: √a is a multiple of one

    def distance():
        g = gradient(*problem.state.components[:2]) / ngs.sqrt(metric[0, 0])
        twice = g + ngs.Cof(g)
        square = ngs.InnerProduct(g, g) - 2 * ngs.sqrt(ngs.Det(twice)) + 2
        return ngs.Integrate(square * metric[0, 0], problem.fes.mesh)

    distances = [distance()]
    for _ in range(5):
        problem.rigid_step()
        distances.append(distance())
    assert (np.diff(distances) < 0).all()
    vector = problem.state.vec.FV().NumPy()
    assert not vector[~np.array(list(problem.free))].any()


def test_tall_hemicatenoid():
    """A start that is rigid where it can be."""
    tall = Surface(
        lambda x, y: (ngs.cosh(y) * ngs.cos(x), ngs.cosh(y) * ngs.sin(x), y),
        Rectangle((0, pi), (-2.5, 2.5)),
    )
    result = solve(Scene(tall, Net(ks=1.0), (Elongation(),), symmetric=True), maxh=0.25)
    assert result.converged
    assert result.newton_iterations <= 100
    assert result.normalized_energy == pytest.approx(3.029, rel=1e-3)


def test_start_that_is_near_stays():
    """What comes of flattening a solution costs more once it is feasible, and is not balanced."""
    problem = discretised(scenes.hemisphere(1.0))
    interior_point(problem, Recorder(1.0, 100, None), 1e-2)
    found = problem.state.vec.FV().NumPy().copy()
    near_start(problem, Recorder(1.0, 100, None))
    assert np.array_equal(problem.state.vec.FV().NumPy(), found)


def test_stiff_cloth_keeps_a_start_without_shear():
    """The hemisphere's start is conformal; flattened it has less energy and less balance."""
    problem, other = (discretised(scenes.hemisphere(100.0)) for _ in range(2))
    near_start(problem, Recorder(1.0, 100, None))
    feasible_start(other)
    assert np.array_equal(*(each.state.vec.FV().NumPy() for each in (problem, other)))
    cost, imbalance = other.cost(), other.imbalance()
    flatten(other)
    feasible_start(other)
    assert other.cost() < cost
    assert other.imbalance() > 2 * imbalance


@pytest.mark.parametrize("shear", [1.0, 2.0])
def test_start_sheared_beyond_its_limit_is_flattened(shear):
    """No multiple of it respects the limit, but of the flattened one; the log says so."""
    limits, lines = (Elongation(), ShearLimit(0.5)), []
    surface, start = scenes.hemisphere().surface, lambda x, y: (x + shear * y, y)
    result = solve(Scene(surface, Net(ks=10.0), limits, start), maxh=0.4, log=lines.append)
    assert result.converged
    assert any("rigid" in line for line in lines)
    usual = solve(Scene(surface, Net(ks=10.0), limits), maxh=0.4)
    assert result.energy == pytest.approx(usual.energy, rel=0.02)
