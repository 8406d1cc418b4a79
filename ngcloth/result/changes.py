"""How C, and the energy with it, change with ψ: derivatives up to the third, in closed form.

A change of ψ by w takes G to (I + Z) G, Z = ∇w G⁻¹ being its gradient in the flat plane, and

    C(Z) = (I + Z)⁻ᵀ C (I + Z)⁻¹,   (I + Z)⁻¹ = I − Z + Z² − Z³ + …,   J(Z) = J det(I + Z).

Derivatives are by Z11, Z12, Z21, Z22 at Z = 0. Symmetric tensors are 11, 22, 12. The first axis of
all arrays is that of the points. Where the energy feels the place X in the cloth, w itself counts,
too: derivatives are by (Z11, Z12, w1, Z21, Z22, w2).
"""

from functools import cache, cached_property
from itertools import permutations

import numpy as np

_Z = np.eye(4).reshape(4, 2, 2)
_SYMMETRIC = np.array([[[1, 0], [0, 0]], [[0, 0], [0, 1]], [[0, 1], [1, 0]]], dtype=float)
_TRACE = np.array([1.0, 0.0, 0.0, 1.0])
_DETERMINANT = np.array([[0, 0, 0, 1], [0, 0, -1, 0], [0, -1, 0, 0], [1, 0, 0, 0]], dtype=float)
_OF_Z, _OF_W = [0, 1, 3, 4], [2, 5]


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


def with_place(derivatives, orders):
    """Derivatives by Z alone, (…, 4, …), as derivatives by Z and w."""
    for axis in range(-orders, 0):
        whole = np.zeros((*derivatives.shape[:axis], 6, *derivatives.shape[axis:][1:]))
        np.moveaxis(whole, axis, 0)[_OF_Z] = np.moveaxis(derivatives, axis, 0)
        derivatives = whole
    return derivatives


def and_of_place(derivatives):
    """First or second derivatives of variables by Z, (n, v, …), as by Z and w; and those of X."""
    orders = derivatives.ndim - 2
    own = np.zeros((len(derivatives), 2, *orders * (6,)))
    if orders == 1:
        own[:, [0, 1], _OF_W] = 1
    return np.concatenate([with_place(derivatives, orders), own], axis=1)


def along_w(weights):
    """The form w·w, (n, 6, 6), with a weight for each point."""
    whole = np.zeros((len(weights), 6, 6))
    whole[:, _OF_W, _OF_W] = weights[:, None]
    return whole


@cache
def _area(width):
    """First and second derivatives of det(I + Z)."""
    if width == 4:
        return _TRACE, _DETERMINANT
    return with_place(_TRACE, 1), with_place(_DETERMINANT, 2)


class Felt:
    """What the energy feels, as variables: C, and K and X where a fabric has them.

    Parameters
    ----------
    tensors : list of ndarray, (n, 3)
    placed : bool
        Whether X is felt: where it is, 4 is 6 below.
    """

    def __init__(self, tensors, placed):
        self._tensors, self._placed = tensors, placed

    @cached_property
    def firsts(self):
        """Derivatives of the variables, (n, v, 4)."""
        return self._of_all(first)

    @cached_property
    def seconds(self):
        """Second derivatives, (n, v, 4, 4)."""
        return self._of_all(second)

    def thirds(self, spread):
        """Third derivatives, one of them along a change (n, 4): (n, v, 4, 4)."""
        along = spread[:, _OF_Z] if self._placed else spread
        return self._of_all(lambda tensor: third(tensor, along))

    def _of_all(self, derivative):
        parts = np.concatenate([derivative(tensor) for tensor in self._tensors], axis=1)
        return and_of_place(parts) if self._placed else parts


def chained(slopes, bends, firsts, seconds):
    """First and second derivatives by Z of a function of variables.

    Parameters
    ----------
    slopes, bends : ndarray, (n, v), (n, v, v)
        Its derivatives by the variables.
    firsts, seconds : ndarray, (n, v, 4), (n, v, 4, 4)
        Those of the variables by Z; or by Z and w, 4 being 6 here and below.

    Returns
    -------
    ndarray, (n, 4); ndarray, (n, 4, 4)
    """
    first = np.einsum("na,nai->ni", slopes, firsts)
    second = firsts.swapaxes(1, 2) @ (bends @ firsts) + _summed(slopes, seconds)
    return first, second


def with_area(density, first, second):
    """Derivatives of det(I + Z) times a density, (n, 4) and (n, 4, 4), given the density's."""
    trace, determinant = _area(first.shape[-1])
    sides = trace[:, None] * first[:, None]
    whole = density[:, None, None] * determinant + sides + sides.swapaxes(1, 2) + second
    return density[:, None] * trace + first, whole


def along(law, felt, spread):
    """Second derivatives by Z of the derivative along a change M of det(I + Z) W: (n, 4, 4).

    Parameters
    ----------
    law : list of ndarray
        W and its derivatives by what it feels, (n,), (n, v), (n, v, v), (n, v, v, v).
    felt : Felt
        That.
    spread : ndarray, (n, 4)
        M.
    """
    _, slopes, bends, thirds = law
    one, two = felt.firsts, felt.seconds
    trace, determinant = _area(spread.shape[-1])
    strain = np.einsum("nai,ni->na", one, spread)
    strain_slopes = np.einsum("naij,nj->nai", two, spread)
    slope, bend = chained(slopes, bends, one, two)
    # Of W alone.
    mixed = one.swapaxes(1, 2) @ (bends @ strain_slopes)
    inner = np.einsum("nabc,nc->nab", thirds, strain)
    whole = one.swapaxes(1, 2) @ (inner @ one) + mixed + mixed.swapaxes(1, 2)
    whole += _summed(np.einsum("nab,nb->na", bends, strain), two)
    whole += _summed(slopes, felt.thirds(spread))
    # With the area.
    turned = np.einsum("nij,nj->ni", bend, spread)
    area = spread @ determinant
    sides = trace[:, None] * turned[:, None] + area[:, :, None] * slope[:, None]
    growth = (spread @ trace)[:, None, None]
    grown = np.einsum("ni,ni->n", slope, spread)[:, None, None] * determinant
    return whole + growth * bend + grown + sides + sides.swapaxes(1, 2)


def _summed(weights, tensors):
    """Σ_a w_a T_a, (n, 4, 4)."""
    n, v, width, _ = tensors.shape
    return (weights[:, None] @ tensors.reshape(n, v, -1)).reshape(n, width, width)
