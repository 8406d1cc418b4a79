"""Polynomials on triangles by their Bernstein coefficients, which bound them from both sides.

A polynomial of degree n is Σ c_α B_α, B_α = n!/(i! j! k!) L1^i L2^j L3^k over α = (i, j, k) with
i + j + k = n, in the barycentric coordinates L of a triangle. All B_α are ≥ 0 and their sum is 1.
Arrays of coefficients have α as their last axis, in the order of `exponents`. Corners of the
reference triangle are (1, 0), (0, 1) and (0, 0), as NGSolve has them.
"""

from functools import cache
from math import comb

import numpy as np


@cache
def exponents(degree):
    """All α, (n, 3)."""
    pairs = [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]
    return np.array([(i, j, degree - i - j) for i, j in pairs])


@cache
def lattice(degree):
    """Reference points α/n, (n, 2), edges and corners included; of degree 0 the middle."""
    return exponents(degree)[:, :2] / degree if degree else np.full((1, 2), 1 / 3)


@cache
def _multinomials(degree):
    return np.array([comb(degree, i) * comb(degree - i, j) for i, j, _ in exponents(degree)], float)


def _place(exponents, degree):
    """The place of each α, (..., 3), among those of its degree."""
    i, j = exponents[..., 0], exponents[..., 1]
    return i * (2 * degree + 3 - i) // 2 + j


def basis(degree, points):
    """B_α at reference points (..., 2): (..., n)."""
    x, y = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    i, j, k = exponents(degree).T
    x, y, z = x[..., None], y[..., None], (1 - x - y)[..., None]
    return _multinomials(degree) * x**i * y**j * z**k


@cache
def fit(degree):
    """The matrix from values at the lattice to coefficients, (n, n)."""
    return np.linalg.inv(basis(degree, lattice(degree)))


@cache
def derivatives(degree):
    """The matrices from coefficients to those of both derivatives, of degree n − 1, (2, m, n)."""
    lower = exponents(degree - 1)
    matrices = np.zeros((2, len(lower), len(exponents(degree))))
    rows = np.arange(len(lower))
    for axis in (0, 1):
        matrices[axis, rows, _place(lower + np.eye(3, dtype=int)[axis], degree)] = degree
        matrices[axis, rows, _place(lower + np.eye(3, dtype=int)[2], degree)] = -degree
    return matrices


def slopes(degree, points):
    """Both derivatives of all B_α at reference points (..., 2): (..., 2, n)."""
    return np.einsum("...m,xmn->...xn", basis(degree - 1, points), derivatives(degree))


def product(one, other, degrees):
    """Coefficients of a product, given those of its factors and their degrees."""
    m, n = degrees
    one, other = one * _multinomials(m), other * _multinomials(n)
    shape = np.broadcast_shapes(one.shape[:-1], other.shape[:-1])
    whole = np.zeros((*shape, len(exponents(m + n))))
    for a, alpha in enumerate(exponents(m)):
        whole[..., _place(exponents(n) + alpha, m + n)] += one[..., a, None] * other
    return whole / _multinomials(m + n)


def raised(polynomial, degree, to):
    """Coefficients of the same polynomial as one of a higher degree."""
    return product(np.ones(len(exponents(to - degree))), polynomial, (to - degree, degree))


@cache
def halves(degree):
    """The matrices to the coefficients on both halves of a triangle, (2, n, n).

    The side between its first two corners is cut; the new corner is the last one of both, so that
    halves of halves keep their shape.
    """
    alphas = exponents(degree)
    matrices = np.zeros((2, len(alphas), len(alphas)))
    for row, (i, _, k) in enumerate(alphas):
        # Of the halves (P1, P3, M) and (P2, P3, M), M between P1 and P2, by de Casteljau.
        for r in range(k + 1):
            share = comb(k, r) / 2**k
            matrices[0, row, _place(np.array([i + r, k - r]), degree)] += share
            matrices[1, row, _place(np.array([r, i + k - r]), degree)] += share
    return matrices


@cache
def corners(degree):
    """The places of the three coefficients that are values at the corners."""
    return _place(degree * np.eye(3, dtype=int), degree)
