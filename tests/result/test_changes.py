"""How C and the energy change with ψ, against difference quotients."""

import numpy as np
import pytest

from ngcloth.result import changes

RANDOM = np.random.default_rng(2)
N, STEP = 3, 1e-3
A = RANDOM.uniform(0.7, 1.3, N)[:, None, None] * (np.eye(2) + RANDOM.uniform(-0.2, 0.2, (N, 2, 2)))
C = A.swapaxes(1, 2) @ A
STRAIN = np.stack([C[:, 0, 0], C[:, 1, 1], C[:, 0, 1]], axis=1)


def law(strain):
    """W = (I4 − 1)² + I6² + I4 I8², and its derivatives."""
    i4, i6, i8 = strain.T
    first, second, third = np.zeros((N, 3)), np.zeros((N, 3, 3)), np.zeros((N, 3, 3, 3))
    first.T[:] = 2 * (i4 - 1) + i8**2, 2 * i6, 2 * i4 * i8
    second[:, 0, 0] = second[:, 1, 1] = 2
    second[:, 2, 2] = 2 * i4
    second[:, 0, 2] = second[:, 2, 0] = 2 * i8
    third[:, 0, 2, 2] = third[:, 2, 0, 2] = third[:, 2, 2, 0] = 2
    return [(i4 - 1) ** 2 + i6**2 + i4 * i8**2, first, second, third]


def energy(change):
    """det(I + Z) W(C(Z)) for a Z (4,) or (N, 4)."""
    moved = np.eye(2) + np.broadcast_to(change, (N, 4)).reshape(N, 2, 2)
    back = np.linalg.inv(moved)
    there = back.swapaxes(1, 2) @ C @ back
    strain = np.stack([there[:, 0, 0], there[:, 1, 1], there[:, 0, 1]], axis=1)
    return np.linalg.det(moved) * law(strain)[0]


def quotient(function, direction):
    """A difference quotient of fourth order."""
    near, far = (function(s * STEP * direction) - function(-s * STEP * direction) for s in (1, 2))
    return (8 * near - far) / (12 * STEP)


def test_derivatives_of_the_energy():
    density, slopes, bends, _ = law(STRAIN)
    both = changes.chained(slopes, bends, changes.first(STRAIN), changes.second(STRAIN))
    first, second = changes.with_area(density, *both)
    for i, e in enumerate(np.eye(4)):
        assert first[:, i] == pytest.approx(quotient(energy, e), abs=1e-8)
        for j, f in enumerate(np.eye(4)):
            mixed = quotient(lambda x, f=f: quotient(lambda y: energy(x + y), f), e)
            assert second[:, i, j] == pytest.approx(mixed, abs=1e-6)


def test_second_derivatives_along_a_change():
    spread = RANDOM.uniform(-1, 1, (N, 4))
    found = changes.along(law(STRAIN), changes.Felt([STRAIN], False), spread)
    for i, e in enumerate(np.eye(4)):
        for j, f in enumerate(np.eye(4)):

            def slope(x, e=e, f=f):
                return quotient(lambda y: quotient(lambda z: energy(x + y + z), f), e)

            assert found[:, i, j] == pytest.approx(quotient(slope, spread), abs=2e-4)
