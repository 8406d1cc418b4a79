"""The limits at one family of sampling points, and their derivatives by ψ."""

import numpy as np

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
        self.cloth, self.weights = cloth, weights
        self._slacks = SampledExpressions(cloth, slacks)

    def values(self):
        """Values c, (slacks, points)."""
        return self._slacks.values()

    def changes(self, direction):
        """Derivatives of c along a change of ψ (2, dofs of a component), (slacks, points)."""
        change = self.cloth.flat().at_points(direction).reshape(4, -1)
        return np.einsum("sip,ip->sp", self._slacks.slopes(), change)

    def slopes(self, z):
        """Derivatives of −Σ z c by Y, weighted, (4, points), z being (slacks, points)."""
        return -np.einsum("sp,sip->ip", z * self.weights, self._slacks.slopes())

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
