"""Limits, fabrics and units that users bring, and symmetries of the answer."""

from functools import cache

import ngsolve as ngs
import numpy as np
import pytest
from discretising import assert_solved, assert_strictly_feasible

from ngcloth import Disk, Elongation, InputError, Net, Reason, Scene, Surface, solve
from ngcloth.scenes import hemisphere


@cache
def solved(ks, maxh):
    return solve(hemisphere(ks), maxh=maxh)


class Never:
    """A limit that never binds."""

    name = "never"

    def slacks(self, cloth):
        return (cloth.stretch1 + 1,)


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
    result = solve(scene, maxh=0.3, order=2, max_steps=400)
    assert result.reason is Reason.INFEASIBLE
    assert "missed by" in str(result) and "at θ = (" in str(result)
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
    # The mesh has not the symmetry, and no mirror holds the direction of the threads.
    assert other.energy == pytest.approx(one.energy, rel=1e-3)
    assert other.area == pytest.approx(one.area, rel=1e-3)
    here, there = one.extrema, other.extrema
    assert abs(here["stretch1"][1] - here["stretch2"][1]) > 0.05
    for mine, its in (("stretch1", "stretch2"), ("stretch2", "stretch1")):
        assert there[its] == pytest.approx(here[mine], rel=1e-2)
    low, high = here["shear"]
    assert there["shear"] == pytest.approx((-high, -low), abs=2e-2)


def test_half_finished_classes_are_refused():
    """A limit without a name, and a fabric without a stiffness."""
    surface = hemisphere().surface
    nameless = type("Nameless", (), {"slacks": lambda self, cloth: (cloth.stretch1,)})()
    with pytest.raises(InputError, match="constraints"):
        Scene(surface, Net(ks=1.0), (nameless,))
    bare = type("Bare", (), {"energy": lambda self, I4, I6, I8: (I4 - 1) ** 2})()
    with pytest.raises(InputError, match="stiffness"):
        Scene(surface, bare)


@pytest.mark.parametrize("unit", [1e-6, 1e3])
def test_unit_of_length_changes_nothing(unit):
    """Not the steps either; norms in parameters took 10, 13 and 19 at 1, 1e3 and 1e6."""

    def dome(length):
        def chart(x, y):
            scale = length / (1 + x * x + y * y)
            return 2 * scale * x, 2 * scale * y, scale * (x * x + y * y - 1)

        return Scene(Surface(chart, Disk(), side=-1), Net(ks=1.0), (Elongation(),), symmetric=True)

    here, there = (solve(dome(length), maxh=0.3) for length in (1.0, unit))
    assert there.converged
    assert abs(there.newton_iterations - here.newton_iterations) <= 2
    assert there.energy == pytest.approx(unit**2 * here.energy, rel=1e-8)
