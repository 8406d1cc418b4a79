"""Limits between the points: bounds against closed forms, and violations that no lattice meets."""

from dataclasses import replace

import ngsolve as ngs
import numpy as np
import pytest
from covering import PLANE, covered

from ngcloth import Disk, Elongation, Scene, ShearLimit, Surface
from ngcloth.result.between import Between
from ngcloth.result.certificate import check_limits
from ngcloth.result.patch import Patch


def checks(result, *limits):
    scene = Scene(result.scene.surface, result.scene.fabric, limits)
    return check_limits(replace(result, scene=scene))


@pytest.mark.parametrize("bend", [0.2, -0.1])
def test_bounds_of_a_polynomial_are_exact(bend):
    """ψ = (θ1 + bend θ1², θ2) on the plane: λ1 = 1/(1 + 2 bend θ1), λ2 = 1, least at corners."""
    result = covered(lambda x, y: (x + bend * x * x, y))
    one, other = checks(result, Elongation())
    assert one.slack == pytest.approx(min(0, -2 * bend), abs=1e-9)
    assert one.bound == pytest.approx(one.slack, abs=1e-9) and one.holds == (bend < 0)
    assert other.bound == pytest.approx(0, abs=1e-9) and other.holds
    assert ("missed by 0.4 at θ = (1," in str(one)) == (bend > 0)


@pytest.mark.parametrize("maximum, holds", [(0.6, True), (0.5, False)])
def test_bound_of_the_shear(maximum, holds):
    """ψ = (θ1 + s θ2, θ2) on the plane: γ = −s/√(1 + s²)."""
    result = covered(lambda x, y: (x + 0.6 * y, y))
    (check,) = checks(result, ShearLimit(maximum))
    assert check.bound == pytest.approx(maximum**2 - 0.36 / 1.36, abs=1e-9)
    assert check.holds == holds and check.claim == "|γ| ≤ 0.5145"


def test_bounds_on_a_curved_surface():
    """ψ = c θ on a stereographic chart, where γ = 0 and λ = √f/c, least on the rim."""

    def chart(x, y):
        square = 1 + x * x + y * y
        return 2 * x / square, 2 * y / square, (square - 2) / square

    result = covered(lambda x, y: (0.99 * x, 0.99 * y), Surface(chart, Disk(), side=-1))
    one, other = checks(result, Elongation())
    assert Between(Patch(result)).error < 1e-4
    for check in (one, other):  # f = 4/(1 + r²)², but for the rim's distance from its polygons
        assert check.slack == pytest.approx(1 - 0.99, abs=1e-4)
        assert check.slack - 5e-4 < check.bound <= check.slack
    (check,) = checks(result, ShearLimit(0.1))
    assert 0 <= 0.01 - check.bound < 1e-6


@pytest.mark.parametrize("gap, proven", [(1e-5, False), (-1e-3, True)])
def test_a_violation_between_the_points_is_refused(gap, proven):
    """1/λ1 = 1.002 + gap − |θ − p|², too much on a spot of width 0.006 that the lattice misses."""

    def psi(x, y):
        spot = (x - 0.37) ** 3 / 3 + x * (y - 0.41) ** 2
        return (1.002 + gap) * x - spot, y

    (one, other) = checks(covered(psi, order=3), Elongation())
    assert other.holds and one.slack > -2e-3  # nothing seen
    assert one.holds == proven
    assert ("proven only to within 0.002" in str(one)) != proven


def test_a_metric_that_is_no_polynomial_weakens_the_bounds():
    """A wavy chart on coarse triangles: what interpolation leaves out is taken off."""
    wavy = Surface(lambda x, y: (x, y, 0.02 * ngs.sin(20 * x)), PLANE.domain)
    result = covered(lambda x, y: (0.9 * x, 0.9 * y), wavy)
    error = Between(Patch(result)).error
    one, _ = checks(result, Elongation())
    exact = 1 - 0.9  # where the slope of the wave is 0
    assert 1e-4 < error < 0.1
    assert exact - error < one.bound < exact
    assert np.isclose(one.slack, exact, atol=error)
