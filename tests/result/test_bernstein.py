"""Polynomials by Bernstein coefficients, against their values."""

import numpy as np
import pytest

from ngcloth.result import bernstein
from ngcloth.result.between import least_ratio

RANDOM = np.random.default_rng(1)
POINTS = RANDOM.dirichlet([1, 1, 1], 40)[:, :2]


def polynomial(degree):
    return RANDOM.uniform(-1, 1, len(bernstein.exponents(degree)))


def values(coefficients, degree, points=POINTS):
    return bernstein.basis(degree, points) @ coefficients


@pytest.mark.parametrize("degree", [1, 3, 6])
def test_interpolation_and_derivatives(degree):
    def f(x, y):
        return (0.3 + x - 2 * y) ** degree

    coefficients = bernstein.fit(degree) @ f(*bernstein.lattice(degree).T)
    assert values(coefficients, degree) == pytest.approx(f(*POINTS.T), abs=1e-11)
    slope = degree * (0.3 + POINTS @ [1, -2]) ** (degree - 1)
    along = bernstein.slopes(degree, POINTS) @ coefficients
    assert along == pytest.approx(slope[:, None] * [1, -2], abs=1e-10)


def test_products_and_halves():
    one, other = polynomial(3), polynomial(2)
    product = bernstein.product(one, other, (3, 2))
    assert values(product, 5) == pytest.approx(values(one, 3) * values(other, 2), abs=1e-12)
    assert values(bernstein.raised(one, 3, 7), 7) == pytest.approx(values(one, 3), abs=1e-12)
    corners = np.array([(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)])
    middle, barycentric = (corners[0] + corners[1]) / 2, np.c_[POINTS, 1 - POINTS.sum(axis=1)]
    for half, corner in zip(bernstein.halves(5), corners, strict=False):
        there = barycentric @ np.array([corner, corners[2], middle])
        assert values(half @ product, 5) == pytest.approx(values(product, 5, there), abs=1e-12)


def test_least_ratio_is_below_and_near():
    """1/(1 + |θ − p|²) over the triangle, least at the corner that is farthest from p."""
    x, y = bernstein.lattice(2).T
    below = bernstein.fit(2) @ (1 + (x - 0.2) ** 2 + (y - 0.3) ** 2)
    least = 1 / (1 + 0.8**2 + 0.3**2)
    bound, halvings = least_ratio(np.ones((1, 6)), below[None], 2, least - 1e-9)
    assert bound == pytest.approx(least, abs=1e-12) and halvings == 0  # convex: no halving
    # Greatest inside, where only parts come near.
    bound, halvings = least_ratio(-np.ones((1, 6)), below[None], 2, -1.01)
    assert -1.01 <= bound <= -1 and 0 < halvings < 8
    # Not true, and not tried for long.
    bound, halvings = least_ratio(np.ones((1, 6)), below[None], 2, least + 1e-3)
    assert bound < least + 1e-3 and halvings == 0
