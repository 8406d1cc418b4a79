"""The limits at one family of sampling points, and their derivatives by ψ."""

import numpy as np

from .sampled_cloth import symmetric_products


class SampledLimits:
    """The slacks c of all limits, from numbers at the sampling points.

    Parameters
    ----------
    law : SampledExpressions
        Its "slacks" are c.
    sampling : Sampling
        Of a component of ψ.
    weights : ndarray, (points,)
        With which each point counts.

    Attributes
    ----------
    dofs : ndarray, (triangles, dofs of a triangle)
        Numbers of the unknowns of a component of ψ that `blocks` belong to.
    """

    def __init__(self, law, sampling, weights):
        self._law, self._sampling = law, sampling
        self.dofs, self.weights = sampling.dofs, weights

    def values(self):
        """Values c, (slacks, points)."""
        return self._law.values("slacks")

    def changes(self, direction):
        """Derivatives of c along a change of ψ (2, dofs of a component), (slacks, points)."""
        change = self._sampling.at_points(direction)[:, 1:].reshape(4, -1)
        return np.einsum("sip,ip->sp", self._law.slopes("slacks"), change)

    def loads(self, z):
        """Derivatives of −Σ z c by ψ, (dofs of ψ,), with multipliers z (slacks, points)."""
        pull = -np.einsum("sp,sip->ip", z * self.weights, self._law.slopes("slacks"))
        return self._sampling.transposed(pull.reshape(2, 2, -1)).ravel()

    def tangent(self, z, stiffness, **others):
        """Second derivatives of −Σ z c + ½ Σ stiffness (c − c̄)² by ∇ψ, weighted, (4, 4, points).

        Parameters
        ----------
        z, stiffness : ndarray, (slacks, points)
            The multipliers, and the weights of ∇c ∇cᵀ.
        **others : ndarray, (expressions of this name, points)
            Weights of what else the law has, whose second derivatives are added.
        """
        tangent = self._law.bend(slacks=-z * self.weights, **others)
        slopes = self._law.slopes("slacks")
        if len(slopes):
            half = (self.weights / 2 * stiffness)[:, None] * slopes
            tangent += symmetric_products(half, slopes)
        return tangent

    def blocks(self, z, stiffness):
        """The same by the ψ of each triangle, as of `Sampling.blocks`."""
        return self._sampling.blocks(self.tangent(z, stiffness))
