"""From the gradient of ψ to what the cloth feels. Pure expressions, no mesh and no loop."""

from functools import cached_property

import ngsolve as ngs
import numpy as np


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

    Attributes
    ----------
    jacobian : J = det G, patch area per parameter area
    inverse : G⁻¹
    I4, I6, I8 : the invariants C11, C22, C12 of C = G⁻ᵀ a G⁻¹ (eq. 8)
    cauchy_green : C
    stretch1, stretch2 : λ1 = √I4 of the warp, λ2 = √I6 of the weft
    shear : γ = I8 / (λ1 λ2), cosine of the angle between the threads
    angle : shear angle in degrees, 90° minus the angle between the threads; its sine is γ
    thickness : t/t0 of incompressible cloth, one over the areal stretch √det C = √det a / J
    energy_slopes : list of the derivatives of W by I4, I6 and I8
    reaction : τ = −2 w : G⁻ᵀ b G⁻¹ with w = dW/dC, force per flat area with which the surface
        pushes (Laplace's law)
    """

    def __init__(self, gradient, metric, fabric=None, curvature=None):
        self.gradient, self.metric = gradient, metric
        self.fabric, self.curvature = fabric, curvature
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
    def stretch1(self):  # noqa: D102
        return ngs.sqrt(self.I4)

    @cached_property
    def stretch2(self):  # noqa: D102
        return ngs.sqrt(self.I6)

    @cached_property
    def shear(self):  # noqa: D102
        return self.I8 / ngs.sqrt(self.I4 * self.I6)

    @cached_property
    def angle(self):  # noqa: D102
        # By the areal stretch λ1 λ2 cos(angle): the arc sine of γ has no slope at a collapse.
        return 180 / np.pi * ngs.atan2(self.I8, 1 / self.thickness)

    @cached_property
    def thickness(self):  # noqa: D102
        return self.jacobian / ngs.sqrt(ngs.Det(self.metric))

    @cached_property
    def energy_slopes(self):  # noqa: D102
        energy = self.fabric.energy(self.I4, self.I6, self.I8)
        return [energy.Diff(invariant) for invariant in (self.I4, self.I6, self.I8)]

    @cached_property
    def reaction(self):  # noqa: D102
        products = zip(self.energy_slopes, self.pushed(self.curvature()), strict=True)
        return -2 * sum((slope * part for slope, part in products), ngs.CF(0.0))


def gradient(psi1, psi2):
    """G = ∇ψ from the two components of ψ, rows being components."""
    return ngs.CF((ngs.Grad(psi1), ngs.Grad(psi2)), dims=(2, 2))
