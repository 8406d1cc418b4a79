"""Certificates of fabrics that feel the place in the cloth, or how their threads bend."""

from dataclasses import dataclass, replace

import ngsolve as ngs
import numpy as np
import pytest
from covering import covered

from ngcloth import BendingThreads, Disk, Elongation, Net, Scene, Surface, Swollen, Turned, solve
from ngcloth.result.patch import Patch
from ngcloth.result.stationarity import Pencil, StationaryPoint
from ngcloth.scenes import hemisphere

R, B = 2.0, 0.02
CYLINDER = Surface(lambda x, y: (R * ngs.sin(x / R), y, R * ngs.cos(x / R)), Disk())
CAP = Surface(lambda x, y: (x, y, ngs.sqrt(2.25 - x**2 - y**2)), Disk())
DOME = Surface(lambda x, y: (x, y, -0.3 * x**2 - 0.4 * y**2), Disk())


@dataclass(frozen=True)
class Zones:
    """A net with a soft spot, and of another stiffness where X1 > 0, which may resist bending."""

    of_curvature: bool = False
    of_place, stiffness = True, 1.0

    def energy(self, I4, I6, I8, *more):
        *bent, X1, X2 = more
        soft = ngs.exp(-8 * (X1**2 + X2**2))
        energy = (1 - 0.8 * soft) * ((I4 - 1) ** 2 + (I6 - 1) ** 2 + I8**2)
        for each in bent:
            energy += (0.1 + 0.02 * X1) * each**2 / (I4 * I6)
        return energy


def lagrangian(patch, v):
    """E + dE[v] over kc."""
    point = StationaryPoint(patch, {"multiplier_order": 2})
    value = point.flat_areas @ point.energy[0]
    spread = point.inside.gradients(2, point.system(patch.order).v_by_triangle(v))
    return value + point.flat_areas @ np.einsum("ni,ni->n", point.energy[1], spread)


@pytest.mark.parametrize(
    "fabric", [Zones(), Zones(of_curvature=True), BendingThreads(Net(ks=1.0), (0.3, 0.1), 0.2)]
)
def test_the_second_variation_is_that_of_the_lagrangian(fabric):
    """Against second differences along a change of ψ and v."""
    result = covered(lambda x, y: (1.1 * x + 0.1 * y * y, y - 0.1 * x * y), DOME, fabric)
    result = replace(result, scene=replace(result.scene, constraints=(Elongation(),)))
    patch, draw = Patch(result), np.random.default_rng(0)
    point = StationaryPoint(patch, {"multiplier_order": 2})
    system = point.system(2)
    change, v = draw.uniform(-1, 1, (2, system.size))
    change[: system.psi.stop] *= 0.1
    v = v[system.psi.stop :]
    step, values = 3e-3, []
    space = system._space  # how unknowns are numbered
    for factor in (-2, -1, 0, 1, 2):
        moved = Patch(result)
        of_psi = factor * step * change[: system.psi.stop].reshape(2, -1)[:, space.dofs]
        moved.psi = patch.psi + np.moveaxis(of_psi, 0, 1)
        values.append(lagrangian(moved, v + factor * step * change[system.psi.stop :]))
    expected = np.dot([-1, 16, -30, 16, -1], values) / (12 * step**2)
    hessian, order = Pencil(point, v).hessian, system._order
    assert change[order] @ (hessian @ change[order]) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("degrees", [0, 20, 70])
@pytest.mark.parametrize("twist", [0.0, 0.08])
def test_threads_along_the_hoop(degrees, twist):
    """In cloth cut at any angle to them. With W = Σ (λ² − 1)² + P, P the energy of the curvature
    that threads of all lengths have, W/λ² is least at λ² = √(1 + P/2). As the cloth turns by α, P =
    B (cos⁴α + sin⁴α)/2R² + D sin²α cos²α/R² has the second derivative 2 (D − B)/R², and turning has
    the seminorm √2."""
    fabric = BendingThreads(Turned(Net(ks=1.0), -degrees), B, twist)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    length = (1 + B / R**2 / 4) ** -0.25

    def rolled(x, y):
        return length * (c * x + s * y), length * (c * y - s * x)

    certificate = covered(rolled, CYLINDER, fabric).certificate()
    expected = (twist - B) / R**2
    assert certificate.curvature == pytest.approx(expected, rel=2e-2)
    assert certificate.stationarity < 1e-9
    assert certificate.certified == (expected > 0)
    assert certificate.certified or certificate.faults[0].startswith("a saddle")


@dataclass(frozen=True)
class Dearer:
    """A net of which every piece costs the same on top."""

    stiffness = 1.0

    def energy(self, I4, I6, I8):
        return Net(ks=1.0).energy(I4, I6, I8) + B / 1.5**2


def test_bending_on_a_sphere_is_a_constant():
    scene = Scene(CAP, BendingThreads(Net(ks=1.0), B), symmetric=True)
    result = solve(scene, maxh=0.4, order=3)
    found = result.certificate()
    same = replace(result, scene=replace(scene, fabric=Dearer())).certificate()
    assert found.certified and found.energy == pytest.approx(same.energy, rel=1e-9)
    for name in ("stress", "stationarity_richer", "curvature"):
        assert getattr(found, name) == pytest.approx(getattr(same, name), rel=1e-6), name


def test_bending_picks_one_of_many_chebyshev_nets():
    """Nets along the axes of a dome and along its diagonals: only the latter are minima."""
    found = {}
    for degrees in (0, 45):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        start = lambda x, y, c=c, s=s: (c * x + s * y, c * y - s * x)  # noqa: E731
        scene = Scene(DOME, BendingThreads(Net(), 0.05, 0.02), start=start, symmetric=not degrees)
        found[degrees] = solve(scene, maxh=0.4, order=3)
    along, across = found[0], found[45]
    assert along.converged and across.converged and across.energy < 0.97 * along.energy
    assert across.certificate().certified
    certificate = along.certificate()
    assert certificate.asymmetric_curvature == pytest.approx(-2.9e-3, rel=0.1)
    assert certificate.curvature > 0


def test_a_zoned_knit_is_certified_where_its_zones_are():
    """And nowhere else: what is stiff there is felt when all of the cloth is moved."""
    scene = Scene(DOME, Zones(), start=(0.9, 0.8))
    result = solve(scene, maxh=0.5, order=3)
    certificate = result.certificate()
    assert certificate.certified and certificate.curvature > 0
    state = ngs.GridFunction(result.state.space)
    state.vec.data = result.state.vec
    state.vec.FV().NumPy()[: result.state.space.components[0].mesh.nv] += 0.1  # at its vertices
    moved = replace(result, state=state).certificate()
    assert moved.stationarity > 100 * certificate.stationarity
    assert "not stationary" in str(moved)


def test_a_swollen_disk_is_a_hemisphere_without_stress():
    def growth(X1, X2):
        g = 2 / (1 + X1**2 + X2**2)
        return g, g

    scene = Scene(hemisphere().surface, Swollen(Net(ks=1.0), growth), start=(0.8, 0.9))
    result = solve(scene, maxh=0.5, order=3)
    certificate = result.certificate()
    assert certificate.certified and result.normalized_energy < 1e-20
    assert abs(certificate.curvature) < 1e-9  # the cloth may turn
