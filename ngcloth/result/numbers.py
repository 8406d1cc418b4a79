"""Functions of the user's own, which are expressions of NGSolve, at states given by numbers."""

from itertools import permutations

import ngsolve as ngs
import numpy as np
from ngsolve.meshes import MakeStructured3DMesh


class Numbers:
    """Numbers at places of the parameter plane as expressions, to put into others.

    Laws and limits may depend on θ: the places lie in space, their third coordinate numbers them.

    Parameters
    ----------
    theta : ndarray, (n, 2)
    """

    def __init__(self, theta):
        low = np.append(theta.min(axis=0), 0.0)
        size = np.append(np.maximum(np.ptp(theta, axis=0), 1e-3 * np.ptp(theta) or 1.0), 1.0)
        self._n, self._box = len(theta), (tuple(low - size), tuple(low + 2 * size))
        self._frame = MakeStructured3DMesh(
            nx=1,
            ny=1,
            nz=1,
            mapping=lambda s, t, u: tuple(low + (3 * np.array([s, t, u]) - 1) * size),
        )
        self._points = self._frame(*theta.T, (np.arange(self._n) + 0.5) / self._n)

    def variables(self, values):
        """Numbers (n, variables) as expressions."""
        low, high = (*self._box[0][:2], 0.0), (*self._box[1][:2], 1.0)
        return [
            1.0 * ngs.VoxelCoefficient(low, high, row.reshape(-1, 1, 1).copy(), linear=False)
            for row in values.T
        ]

    def derivatives(self, expressions, variables, highest):
        """Expressions and their partial derivatives by the variables, up to an order.

        Returns
        -------
        list of ndarray
            (n, expressions), (n, expressions, variables), (n, expressions, variables,
            variables), …
        """
        levels = [{(number,): expression for number, expression in enumerate(expressions)}]
        for _ in range(highest):
            levels.append(
                {
                    (*at, number): derivative
                    for at, expression in levels[-1].items()
                    for number in range(at[-1] if len(at) > 1 else 0, len(variables))
                    if not _vanishes(derivative := expression.Diff(variables[number]))
                }
            )
        stacked = [expression for level in levels for expression in level.values()]
        values = iter(np.reshape(ngs.CF(tuple(stacked)).Compile()(self._points), (self._n, -1)).T)
        tensors = []
        for order, level in enumerate(levels):
            shape = self._n, len(expressions), *order * (len(variables),)
            tensors.append(np.zeros(shape))
            for (row, *at), value in zip(level, values, strict=False):
                for turned in set(permutations(at)):
                    tensors[-1][(slice(None), row, *turned)] = value
        return tensors


def _vanishes(expression):
    """NGSolve simplifies what is zero, but only its name tells."""
    return str(expression) == "ZeroCoefficientFunction"
