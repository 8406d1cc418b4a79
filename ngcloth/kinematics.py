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
        Needed for stresses and `reaction`.
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
    resultant : J S, force per parameter length
    resultant_slopes : list of its derivatives by G11, G12, G21, G22
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
        return self.inverse * _symmetric(*self._energy_slopes) * self.inverse.trans

    @property
    def resultant(self):  # noqa: D102
        return self.jacobian * self.contravariant_stress

    @property
    def resultant_slopes(self):  # noqa: D102
        w, invariants = _symmetric(*self._energy_slopes), (self.I4, self.I6, self.I8)
        curvatures = [[slope.Diff(i) for i in invariants] for slope in self._energy_slopes]
        slopes = []  # of J S = J G⁻¹ w G⁻ᵀ, by the rule of products
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            # Y = dG G⁻¹, where dG is 1 at (i, j) and 0 elsewhere: dG⁻¹ = −G⁻¹ Y and dJ = J tr Y.
            rows = [(0.0, 0.0), (0.0, 0.0)]
            rows[i] = self.inverse[j, 0], self.inverse[j, 1]
            Y = ngs.CF((*rows[0], *rows[1]), dims=(2, 2))
            dC = -(Y.trans * self.cauchy_green + self.cauchy_green * Y)
            dI = ngs.CF((dC[0, 0], dC[1, 1], dC[0, 1]))
            dw = _symmetric(*(ngs.InnerProduct(ngs.CF(tuple(row)), dI) for row in curvatures))
            change = self.inverse[j, i] * w - Y * w - w * Y.trans + dw
            slopes.append(self.jacobian * self.inverse * change * self.inverse.trans)
        return slopes

    @cached_property
    def _energy_slopes(self):
        """Derivatives of W by I4, I6 and I8."""
        energy = self.fabric.energy(self.I4, self.I6, self.I8)
        return [energy.Diff(invariant) for invariant in (self.I4, self.I6, self.I8)]

    @cached_property
    def reaction(self):  # noqa: D102
        return -2 * ngs.InnerProduct(self.contravariant_stress, self.curvature())


def _symmetric(slope4, slope6, slope8):
    """The derivative by C of a function of I4, I6, I8 with these derivatives."""
    return ngs.CF((slope4, slope8 / 2, slope8 / 2, slope6), dims=(2, 2))


def gradient(psi1, psi2):
    """G = ∇ψ from the two components of ψ, rows being components."""
    return ngs.CF((ngs.Grad(psi1), ngs.Grad(psi2)), dims=(2, 2))


def virtual_strain(eta, eta_gradient, metric, metric_derivatives):
    """L_η a = η·∇a + a ∇η + ∇ηᵀ a: how the metric changes as the cloth slides along η."""
    stretched = metric * eta_gradient
    carried = eta[0] * metric_derivatives[0] + eta[1] * metric_derivatives[1]
    return carried + stretched + stretched.trans
