"""From the gradient of ψ to what the cloth feels. Pure expressions, no mesh and no loop."""

from functools import cached_property

import ngsolve as ngs


class Kinematics:
    """The state of the cloth at a point, as NGSolve expressions.

    Parameters
    ----------
    gradient : CoefficientFunction, (2, 2)
        G = ∇ψ, of a trial function or of a GridFunction.
    metric : CoefficientFunction, (2, 2)
        First fundamental form a of the target surface.
    fabric : Net or similar, optional
        Needed for `contravariant_stress` and `reaction`.
    curvature : callable, optional
        Returns the second fundamental form b, (2, 2); only called for `reaction`.

    Attributes
    ----------
    jacobian : J = det G, patch area per parameter area
    inverse : G⁻¹
    cauchy_green : C = G⁻ᵀ a G⁻¹ (eq. 8)
    I4, I6, I8 : the invariants C11, C22, C12
    stretch1, stretch2 : λ1 = √I4 of the warp, λ2 = √I6 of the weft
    shear : γ = I8 / (λ1 λ2), cosine of the angle between the threads
    contravariant_stress : S = G⁻¹ w G⁻ᵀ with w = dW/dC, force per flat length
    reaction : τ = −2 S : b, force per flat area with which the surface pushes (Laplace's law)
    """

    def __init__(self, gradient, metric, fabric=None, curvature=None):
        self.gradient, self.fabric, self.curvature = gradient, fabric, curvature
        self.jacobian = ngs.Det(gradient)
        self.inverse = ngs.Inv(gradient)
        self.cauchy_green = self.inverse.trans * metric * self.inverse
        self.I4 = self.cauchy_green[0, 0]
        self.I6 = self.cauchy_green[1, 1]
        self.I8 = self.cauchy_green[0, 1]

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
    def contravariant_stress(self):  # noqa: D102
        energy = self.fabric.energy(self.I4, self.I6, self.I8)
        w11, w22, w12 = energy.Diff(self.I4), energy.Diff(self.I6), energy.Diff(self.I8) / 2
        w = ngs.CF((w11, w12, w12, w22), dims=(2, 2))
        return self.inverse * w * self.inverse.trans

    @cached_property
    def reaction(self):  # noqa: D102
        return -2 * ngs.InnerProduct(self.contravariant_stress, self.curvature())


def gradient(psi1, psi2):
    """G = ∇ψ from the two components of ψ, rows being components."""
    return ngs.CF((ngs.Grad(psi1), ngs.Grad(psi2)), dims=(2, 2))


def virtual_strain(eta, eta_gradient, metric, metric_derivatives):
    """L_η a = η·∇a + a ∇η + ∇ηᵀ a: how the metric changes as the cloth slides along η."""
    stretched = metric * eta_gradient
    carried = eta[0] * metric_derivatives[0] + eta[1] * metric_derivatives[1]
    return carried + stretched + stretched.trans
