"""From the gradient of ψ to what the cloth feels. Pure expressions, no mesh and no loop."""

from functools import cached_property
from itertools import combinations

import ngsolve as ngs
import numpy as np

from .fabric import along, directions, of_curvature, of_place


class Kinematics:
    """The state of the cloth at a point, as NGSolve expressions.

    Parameters
    ----------
    gradient : CoefficientFunction, (2, 2)
        G = ∇ψ, of a trial function or of a GridFunction.
    metric : CoefficientFunction, (2, 2)
        First fundamental form a of the target surface.
    fabric : Net or similar, optional
        Needed for stresses and `reaction`.
    curvature : callable, optional
        Returns the second fundamental form b, (2, 2); only called for `reaction`.
    place : pair of CoefficientFunction, optional
        X = ψ; only asked for by fabrics that depend on it.

    Attributes
    ----------
    jacobian : J = det G, patch area per parameter area
    inverse : G⁻¹
    I4, I6, I8 : the invariants C11, C22, C12 of C = G⁻ᵀ a G⁻¹ (eq. 8)
    cauchy_green : C
    stretches : list of the stretches of all families of threads
    shears : list of the cosines of the angles between each two of them
    stretch1, stretch2 : those of the first two families, λ1 = √I4 of the warp, λ2 = √I6 of the weft
    shear : γ = I8 / (λ1 λ2), cosine of the angle between these
    angle : shear angle in degrees, 90° minus the angle between these; its sine is γ
    thickness : t/t0 of incompressible cloth, one over the areal stretch √det C = √det a / J
    bends : list of the same parts of K = G⁻ᵀ b G⁻¹, if the fabric resists bending
    energy : W
    energy_slopes : list of the derivatives of W by I4, I6 and I8
    reaction : τ = −2 w : G⁻ᵀ b G⁻¹ with w = dW/dC, force per flat area with which the surface
        pushes (Laplace's law); of a fabric that resists bending, the part of its tension
    """

    def __init__(self, gradient, metric, fabric=None, curvature=None, place=None):
        self.gradient, self.metric = gradient, metric
        self.fabric, self.curvature = fabric, curvature
        # NGSolve differentiates by a product with a field, where not by the field itself.
        self.place = [1.0 * component for component in place] if of_place(fabric) else []
        self.jacobian = ngs.Det(gradient)
        self.inverse = ngs.Inv(gradient)
        self.I4, self.I6, self.I8 = self.pushed(metric)

    def pushed(self, tensor):
        """11, 22 and 12 of G⁻ᵀ t G⁻¹: a symmetric tensor t of the surface along the threads."""
        pushed = self.inverse.trans * tensor * self.inverse
        return pushed[0, 0], pushed[1, 1], pushed[0, 1]

    @cached_property
    def cauchy_green(self):  # noqa: D102
        return ngs.CF((self.I4, self.I8, self.I8, self.I6), dims=(2, 2))

    @cached_property
    def stretches(self):  # noqa: D102
        return [ngs.sqrt(self.between(line, line)) for line in directions(self.fabric)]

    @cached_property
    def shears(self):  # noqa: D102
        pairs = combinations(directions(self.fabric), 2)
        return [
            self.between(t, s) / ngs.sqrt(self.between(t, t) * self.between(s, s)) for t, s in pairs
        ]

    @property
    def stretch1(self):  # noqa: D102
        return self.stretches[0]

    @property
    def stretch2(self):  # noqa: D102
        return self.stretches[1]

    @property
    def shear(self):  # noqa: D102
        return self.shears[0]

    def between(self, one, other):
        """The product t·C s of two flat directions, (2,) each; λ² along t if both are t."""
        return along(one, other, self.I4, self.I6, self.I8)

    @cached_property
    def angle(self):  # noqa: D102
        # By the areal stretch λ1 λ2 cos(angle): the arc sine of γ has no slope at a collapse.
        one, other = directions(self.fabric)[:2]
        across = abs(float(one[0] * other[1] - one[1] * other[0])) / self.thickness
        return 180 / np.pi * ngs.atan2(self.between(one, other), across)

    @cached_property
    def thickness(self):  # noqa: D102
        return self.jacobian / ngs.sqrt(ngs.Det(self.metric))

    @cached_property
    def bends(self):  # noqa: D102
        return list(self.pushed(self.curvature())) if of_curvature(self.fabric) else []

    @cached_property
    def energy(self):  # noqa: D102
        return self.fabric.energy(self.I4, self.I6, self.I8, *self.bends, *self.place)

    @cached_property
    def energy_slopes(self):  # noqa: D102
        return [self.energy.Diff(invariant) for invariant in (self.I4, self.I6, self.I8)]

    def change(self, expression, psi1, psi2):
        """The derivative of an expression of this cloth as ψ changes by two fields."""
        change = expression.Diff(self.gradient, gradient(psi1, psi2))
        for component, moved in zip(self.place, (psi1, psi2), strict=False):
            change += expression.Diff(component, moved)
        return change

    @cached_property
    def reaction(self):  # noqa: D102
        products = zip(self.energy_slopes, self.pushed(self.curvature()), strict=True)
        return -2 * sum((slope * part for slope, part in products), ngs.CF(0.0))


def gradient(psi1, psi2):
    """G = ∇ψ from the two components of ψ, rows being components."""
    return ngs.CF((ngs.Grad(psi1), ngs.Grad(psi2)), dims=(2, 2))
