"""The limits at one family of sampling points, and their derivatives by ψ."""

import numpy as np

from .discretisation import of_state
from .sampled_cloth import SampledExpressions, symmetric_products


class SampledLimits:
    """The slacks c of all limits, from numbers at the sampling points.

    Parameters
    ----------
    cloth : SampledCloth
    slacks : list of CoefficientFunction
        In terms of that.
    weights : ndarray, (points,)
        With which each point counts.
    """

    def __init__(self, cloth, slacks, weights):
        self.cloth, self.weights, self.unknowns = cloth, weights, cloth.unknowns
        self._slacks = SampledExpressions(cloth, slacks)
        dofs, after = cloth.psi.dofs, len(self.unknowns) // 2
        self._numbers = np.concatenate([dofs, after + dofs], axis=1)

    def values(self):
        """Values c, (slacks, points)."""
        return self._slacks.values()

    def changes(self, direction):
        """Derivatives of c along a change of ψ, (dofs of ψ,): (slacks, points)."""
        changes = self._by_unknowns() @ direction[self._numbers][:, :, None]
        return changes.reshape(len(self.weights), self._slacks.number).T

    def loads(self, z):
        """The derivative of −Σ z c by ψ, weighted, (dofs of ψ,), z being (slacks, points)."""
        slopes = self._by_unknowns()
        loads = (z * self.weights).T.reshape(len(slopes), 1, slopes.shape[1]) @ slopes
        return -np.bincount(self._numbers.ravel(), loads.ravel(), len(self.unknowns))

    def tangent(self, z, stiffness):
        """Second derivatives of −Σ z c + ½ Σ stiffness (c − c̄)² by Y, weighted, (4, 4, points).

        Parameters
        ----------
        z, stiffness : ndarray, (slacks, points)
            The multipliers, and the weights of ∇c ∇cᵀ.
        """
        tangent = self._slacks.bend(-z * self.weights)
        slopes = self._slacks.slopes()
        if len(slopes):
            half = (self.weights / 2 * stiffness)[:, None] * slopes
            tangent += symmetric_products(half, slopes)
        return tangent

    @of_state
    def _by_unknowns(self):
        """Derivatives of c by ψ's unknowns, (triangles, points and slacks, dofs of a triangle)."""
        flat = self.cloth.flat().shapes
        triangles, _, at_one, n = flat.shape
        number = self._slacks.number
        slopes = self._slacks.slopes().reshape(number, 2, 2, triangles, at_one)
        slopes = slopes.transpose(3, 4, 0, 1, 2).reshape(triangles, at_one, 2 * number, 2)
        return (slopes @ flat.swapaxes(1, 2)).reshape(triangles, at_one * number, 2 * n)
