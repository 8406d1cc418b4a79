"""Scenes with limits: what their patches are like, and what limits and equilibrium cost."""

from functools import cache

import ngsolve as ngs
import numpy as np
import pytest
from discretising import assert_solved, assert_strictly_feasible, discretised, vector

from ngcloth import Disk, Elongation, Net, Obstacle, Scene, Surface, solve
from ngcloth.geometry.sheet import lattice, mesh_points
from ngcloth.scenes import hemicatenoid, hemisphere, sphere
from ngcloth.solver.exchange import missed_points

# Directions in the quarter of a symmetric disk.
ROUND = [(np.cos(a), np.sin(a)) for a in np.radians((10, 30, 45, 70))]


class Never:
    """A limit that never binds."""

    name = "never"

    def slacks(self, cloth):
        return (cloth.stretch1 + 1,)


@cache
def solved(ks, maxh, **settings):
    return solve(hemisphere(ks), maxh=maxh, **settings)


def largest_v(result):
    return max(np.abs(c.vec.FV().NumPy()).max() for c in result.state.components[2:])


def test_without_active_limit_equilibrium_costs_nothing():
    """v is zero, and the energy that of the scene without limits."""
    surface = hemisphere().surface

    def never(maxh):
        scene = Scene(surface, Net(ks=1.0), (Never(),), symmetric=True)
        return solve(scene, maxh=maxh, barrier_end=1e-7)

    free = solve(Scene(surface, Net(ks=1.0), symmetric=True), maxh=0.3, order=3, tolerance=1e-12)
    coarse, fine = never(0.3), never(0.15)
    assert coarse.converged and fine.converged and free.converged
    assert coarse.normalized_energy == pytest.approx(free.normalized_energy, rel=1e-4)
    assert solved(1.0, 0.3).normalized_energy > 1.5 * free.normalized_energy
    # A patch at which E is stationary in all ψ is in equilibrium on the mesh, too.
    assert max(largest_v(coarse), largest_v(fine)) < 1e-5 * largest_v(solved(1.0, 0.3))


def test_barrier_bias_falls_like_mu():
    ends = [1e-2, 1e-3, 1e-4, 1e-6]
    energies = np.array([solved(1.0, 0.3, barrier_end=mu).normalized_energy for mu in ends])
    assert (np.diff(energies) < 0).all()
    bias = energies[:-1] - energies[-1]
    order = np.log10(bias[:-1] / bias[1:])
    assert ((0.7 < order) & (order < 1.3)).all()
    assert bias[1] < 1e-3 * energies[-1]


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
    coarse, fine = solved(ks, 0.3, order=2), solved(ks, 0.15, order=2)
    assert_solved(coarse, 3 * slack)
    assert_solved(fine, slack)
    assert fine.normalized_energy == pytest.approx(energy[0], abs=energy[1])
    for thread in ("stretch1", "stretch2"):
        assert fine.extrema[thread][1] == pytest.approx(stretch[0], abs=stretch[1])
    assert fine.equilibrium_residual < 0.35 * coarse.equilibrium_residual < 0.05


def test_linear_multiplier_leaves_the_rim_unbalanced():
    """A poorer v asks for less: less energy, and more force left."""
    poor, rich = (solved(1.0, 0.2, **v) for v in ({"multiplier_order": 1}, {}))
    assert_solved(poor)
    assert poor.normalized_energy < 0.95 * rich.normalized_energy
    assert poor.equilibrium_residual > 3 * rich.equilibrium_residual


def test_eta_falls_to_zero_within_the_last_triangles_before_the_rim():
    inside, seminorm = [], []
    for maxh in (0.1, 0.05):
        result = solve(hemisphere(1), maxh=maxh, order=2)
        eta, mesh = result.state.components[2:], result.state.space.mesh
        inside.append([component(mesh(0.5 * x, 0.5 * y)) for component in eta for x, y in ROUND])
        square = sum(ngs.InnerProduct(ngs.grad(c), ngs.grad(c)) for c in eta)
        seminorm.append(np.sqrt(ngs.Integrate(square, mesh)))
    np.testing.assert_allclose(*inside, rtol=0.07)
    assert seminorm[1] > 1.4 * seminorm[0]  # of a jump it grows like h^-1/2


def test_hemicatenoid():
    result = solve(hemicatenoid(10.0), maxh=0.2)
    assert_solved(result)
    assert result.normalized_energy == pytest.approx(0.235, abs=0.006)
    assert result.equilibrium_residual < 0.05


def test_sphere_with_shear_limit():
    """All energy that is left is the limit's: a barrier of 1e-3 would cost three times as much."""
    limit = float(np.cos(np.pi / 6))
    result = solve(sphere(0.6, shear_limit=limit), maxh=0.15, order=3, barrier_end=1e-5)
    assert_solved(result, slack=1e-3, shear=limit, steps=120)
    assert result.normalized_energy == pytest.approx(1.0e-4, rel=5e-2)
    assert result.extrema["shear"][1] > 0.98 * limit  # it binds


@pytest.mark.parametrize("order", [2, 3])
def test_limits_between_the_points(order):
    """Met to 1e-3 on a fine lattice, where rules of this degree alone miss them by ten times it."""
    result = solve(hemisphere(100.0), maxh=0.15, order=order)
    n, mesh = 24, result.state.space.mesh
    triangles = np.repeat(np.arange(mesh.ne), (n + 1) * (n + 2) // 2)
    points = mesh_points(mesh, triangles, np.tile(lattice(n), (mesh.ne, 1)))
    slacks = ngs.CF(Elongation().slacks(result._cloth))(points)
    assert result.converged and np.min(slacks) > -1e-3
    problem = discretised(result.scene, 0.15, order)
    vector(problem)[:] = result.state.vec.FV().NumPy()
    problem.add_limit_points(result.limit_points)
    known = len(problem.limit_points.triangles)
    problem.add_limit_points(missed_points(problem))
    assert len(problem.limit_points.triangles) == known
    assert 0 < problem.slacks()[:, problem.parts[2]].min() < 1e-3  # they are felt


class Metres:
    """A limit whose slack is in a unit of its own."""

    name = "in millimetres"

    def slacks(self, cloth):
        return (1e3 * (cloth.stretch1 - 1), 1e3 * (cloth.stretch2 - 1))


def test_limits_of_ones_own_are_missed_by_strains():
    """Whatever their unit: the same points are found as for stretches."""
    surface = hemisphere().surface
    found = []
    for limit in (Metres(), Elongation()):
        scene = Scene(surface, Net(ks=100.0), (limit,), start=(1.2, 1.3), symmetric=True)
        found.append(missed_points(discretised(scene, 0.3)))
    assert 0 < len(found[0].triangles) <= len(found[1].triangles)
    assert set(found[0].triangles) <= set(found[1].triangles)


def test_quarter_and_whole_agree():
    """Two meshes, one of them with mirror lines: the same patch."""
    quarter = solved(10.0, 0.25)
    whole = solve(hemisphere(10.0, symmetric=False), maxh=0.25)
    assert_solved(whole, 0.03)
    assert whole.normalized_energy == pytest.approx(quarter.normalized_energy, rel=1e-2)
    assert whole.area == pytest.approx(quarter.area, rel=1e-2)


def test_shear_ten_thousand_times_as_stiff_as_threads():
    """Cloth that can hardly shear."""
    result = solve(hemicatenoid(1e4), maxh=0.35, order=3)
    assert_solved(result, slack=1e-3, steps=300)
    assert result.normalized_energy == pytest.approx(0.21, rel=0.01)
    assert result.extrema["shear"][1] < 0.005


def test_obstacle():
    """Unless τ ≥ 0 is asked for, the surface pulls the cloth somewhere; asking costs energy.

    Between the points τ is missed by a thousandth of its largest value at most.
    """
    free = solve(hemicatenoid(10.0), maxh=0.5)
    result = solve(hemicatenoid(10.0, obstacle=True), maxh=0.5)
    assert_solved(result, 1.5e-3, steps=120)
    assert_strictly_feasible(result)
    low, high = result.extrema["reaction"]
    assert free.extrema["reaction"][0] < -5 and low > -0.001 * high
    assert all(check.holds for check in result.certificate().limits)
    assert result.normalized_energy > 1.1 * free.normalized_energy


@pytest.mark.parametrize("order", [5, 6])
def test_obstacle_at_high_orders(order):
    """No spike at a vertex of the rim, where τ is asked for and no integration point lies."""
    result = solve(hemicatenoid(1.0, obstacle=True), maxh=0.8, order=order)
    assert result.converged and result.newton_iterations <= 60
    assert result.normalized_energy == pytest.approx(0.1263, rel=5e-3)


@pytest.mark.parametrize(
    ("uneven", "limits"), [(True, [Obstacle()]), (False, [Elongation(), Obstacle()])]
)
def test_an_obstacle_on_a_flat_plate_asks_for_nothing(uneven, limits):
    """It neither pushes nor pulls, whatever the patch: τ is zero, or its rounding."""

    def plane(x, y):
        u, v = (ngs.sinh(x / 2), y) if uneven else (x, y)
        return u, v, 0.7 * u + 0.3 * v

    surface = Surface(plane, Disk())
    result = solve(Scene(surface, Net(ks=1.0), limits), maxh=0.6, max_steps=60)
    whole = surface.on(result.sheet.mesh).metric
    exact = ngs.Integrate(ngs.sqrt(ngs.Det(whole)), result.sheet.mesh)
    assert result.converged and result.area == pytest.approx(exact, rel=1e-3)
    assert result.normalized_energy < 1e-6
    check = result.certificate().limits[-1]
    assert check.name == "obstacle" and check.holds


class Constant:
    """A limit that says nothing of the cloth."""

    name = "constant"

    def slacks(self, cloth):
        return (ngs.CF(1.0),)


@pytest.mark.filterwarnings("error")
def test_a_limit_that_says_nothing_changes_nothing():
    surface = hemisphere().surface
    free, held = (
        solve(Scene(surface, Net(ks=1.0), limits, symmetric=True), maxh=0.6, order=3)
        for limits in ((), (Constant(),))
    )
    assert held.converged and held.energy == pytest.approx(free.energy, rel=1e-4)


def test_a_limit_in_a_tiny_unit_is_not_lost_in_rounding():
    class Tiny:
        name = "tiny"

        def slacks(self, cloth):
            return (1e-20 * (cloth.stretch1 - 1),)

    scene = Scene(hemisphere().surface, Net(ks=1.0), (Tiny(),), symmetric=True)
    result = solve(scene, maxh=0.6, order=2, max_steps=60)
    assert not result.converged or result.extrema["stretch1"][0] > 0.99
