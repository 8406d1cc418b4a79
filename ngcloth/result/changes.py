"""How C, and the energy with it, change with ψ: derivatives up to the third, in closed form.

A change of ψ by w takes G to (I + Z) G, Z = ∇w G⁻¹ being its gradient in the flat plane, and

    C(Z) = (I + Z)⁻ᵀ C (I + Z)⁻¹,   (I + Z)⁻¹ = I − Z + Z² − Z³ + …,   J(Z) = J det(I + Z).

Derivatives are by Z11, Z12, Z21, Z22 at Z = 0. Symmetric tensors are 11, 22, 12. The first axis of
all arrays is that of the points.
"""

from functools import cache
from itertools import permutations

import numpy as np

_Z = np.eye(4).reshape(4, 2, 2)
_SYMMETRIC = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]], dtype=float)
_TRACE = np.array([1.0, 0.0, 0.0, 1.0])
_DETERMINANT = np.array([[0, 0, 0, 1], [0, 0, -1, 0], [0, -1, 0, 0], [1, 0, 0, 0]], dtype=float)


@cache
def _derivative(order):
    """Of C(Z), by C and `order` times by Z: (3, 3, 4, …), from C to its change."""
    powers = [np.eye(2)[None]]  # products of any Z, of which the last is multiplied last
    for _ in range(order):
        powers.append(np.einsum("pab,ibc->piac", powers[-1], _Z).reshape(-1, 2, 2))
    whole = 0
    for k in range(order + 1):
        factors = powers[k], _SYMMETRIC, powers[order - k]
        change = np.einsum("pba,cbd,qde->caepq", *factors)[:, [0, 1, 0], [0, 1, 1]]
        whole += change.reshape(3, 3, *order * (4,))
    turned = permutations(range(2, 2 + order))
    return (-1) ** order * sum(whole.transpose(0, 1, *axes) for axes in turned)


def first(tensor):
    """Derivatives of C (n, 3): (n, 3, 4)."""
    return np.tensordot(tensor, _derivative(1), 1)


def second(tensor):
    """Second derivatives of C: (n, 3, 4, 4)."""
    return np.tensordot(tensor, _derivative(2), 1)


def third(tensor, along):
    """Third derivatives of C, one of them along a Z (n, 4): (n, 3, 4, 4)."""
    both = (tensor[:, :, None] * along[:, None]).reshape(len(tensor), -1)
    return np.tensordot(both, np.moveaxis(_derivative(3), -1, 1).reshape(12, 3, 4, 4), 1)


def chained(slopes, bends, firsts, seconds):
    """First and second derivatives by Z of a function of variables.

    Parameters
    ----------
    slopes, bends : ndarray, (n, v), (n, v, v)
        Its derivatives by the variables.
    firsts, seconds : ndarray, (n, v, 4), (n, v, 4, 4)
        Those of the variables by Z.

    Returns
    -------
    ndarray, (n, 4); ndarray, (n, 4, 4)
    """
    first = np.einsum("na,nai->ni", slopes, firsts)
    second = firsts.swapaxes(1, 2) @ (bends @ firsts) + _summed(slopes, seconds)
    return first, second


def with_area(density, first, second):
    """Derivatives of det(I + Z) times a density, (n, 4) and (n, 4, 4), given the density's."""
    sides = _TRACE[:, None] * first[:, None]
    whole = density[:, None, None] * _DETERMINANT + sides + sides.swapaxes(1, 2) + second
    return density[:, None] * _TRACE + first, whole


def along(law, tensor, spread):
    """Second derivatives by Z of the derivative along a change M of det(I + Z) W: (n, 4, 4).

    Parameters
    ----------
    law : list of ndarray
        W and its derivatives by C, (n,), (n, 3), (n, 3, 3), (n, 3, 3, 3).
    tensor : ndarray, (n, 3)
        C.
    spread : ndarray, (n, 4)
        M.
    """
    _, slopes, bends, thirds = law
    one, two = first(tensor), second(tensor)
    strain = np.einsum("nai,ni->na", one, spread)
    strain_slopes = np.einsum("naij,nj->nai", two, spread)
    slope, bend = chained(slopes, bends, one, two)
    # Of W alone.
    mixed = one.swapaxes(1, 2) @ (bends @ strain_slopes)
    inner = np.einsum("nabc,nc->nab", thirds, strain)
    whole = one.swapaxes(1, 2) @ (inner @ one) + mixed + mixed.swapaxes(1, 2)
    whole += _summed(np.einsum("nab,nb->na", bends, strain), two)
    whole += _summed(slopes, third(tensor, spread))
    # With the area.
    turned = np.einsum("nij,nj->ni", bend, spread)
    area = spread @ _DETERMINANT
    sides = _TRACE[:, None] * turned[:, None] + area[:, :, None] * slope[:, None]
    growth = (spread @ _TRACE)[:, None, None]
    grown = np.einsum("ni,ni->n", slope, spread)[:, None, None] * _DETERMINANT
    return whole + growth * bend + grown + sides + sides.swapaxes(1, 2)


def _summed(weights, tensors):
    """Σ_a w_a T_a, (n, 4, 4)."""
    return (weights[:, None] @ tensors.reshape(*weights.shape, 16)).reshape(-1, 4, 4)
