"""The virtual work of sliding the cloth along η, and its derivatives."""

import ngsolve as ngs
import numpy as np

from .discretisation import of_state
from .sampled_cloth import PushedTensor
from .sampling import Sampling


class VirtualWork:
    """∫ J S : L_η a (eq. 16, in intrinsic form), over kc, from numbers at the sampling points.

    It is linear in η, and as a density per flat area the sum of w11, w22 and 2 w12 times entries of
    G⁻ᵀ (L_η a) G⁻¹.

    Parameters
    ----------
    cloth : SampledCloth
        Of the current ψ, η.
    law : SampledExpressions
        Its "stress" are the derivatives of W by I4, I6 and I8, over kc.
    virtual_strain : callable
        From η and its gradient to L_η a, all expressions.
    psi : Sampling
        Of a component of ψ.
    points : Points
    """

    def __init__(self, cloth, law, virtual_strain, psi, points):
        self._cloth, self._law, self._psi = cloth, law, psi
        self.unknowns, space = cloth.state.vec.FV().NumPy(), cloth.state.space
        self.eta = Sampling(space.components[2], points)
        self._dofs = slice(space.Range(2).start, space.Range(3).stop)
        self._weights = points.weights
        self._unit_strains = _unit_strains(virtual_strain, points)
        triangles, _, at_one, _ = self.eta.shapes.shape
        by_triangle = self._unit_strains.reshape(3, 2, 3, triangles, at_one)
        # How each η of a triangle strains its points: (triangles, η, strains at points).
        straining = np.einsum("kjmtq,tmqa->tjakq", by_triangle, self.eta.shapes, optimize=True)
        self._straining = straining.reshape(triangles, -1, 3 * at_one)

    @of_state
    def stress(self):
        """J S over kc, as S11, S12, S22, (3, points)."""
        slopes = self._law.values("stress") * self._cloth.jacobians()
        return np.einsum("kn,kcn->cn", slopes, self._directions())

    @of_state
    def stress_slopes(self):
        """Its derivatives by the components of ∇ψ, (4, 3, points)."""
        inverse, stress = self._cloth.inverses(), self.stress()
        s11, s12, s22 = stress
        # d(J S) by the rule of products, with dJ = J tr(G⁻¹ dG) and dG⁻¹ = −G⁻¹ dG G⁻¹.
        changes = self._law.slopes("stress") * self._cloth.jacobians()
        slopes = np.einsum("kin,kcn->icn", changes, self._directions()).reshape(2, 2, 3, -1)
        slopes += np.einsum("jin,cn->ijcn", inverse, stress)
        turned = np.einsum("cin,jdn->cdijn", inverse, np.array([[s11, s12], [s12, s22]]))
        slopes[:, :, 0] -= 2 * turned[0, 0]
        slopes[:, :, 1] -= turned[0, 1] + turned[1, 0]
        slopes[:, :, 2] -= 2 * turned[1, 1]
        return slopes.reshape(4, 3, -1)

    @of_state
    def _directions(self):
        """S11, S12, S22 of unit derivatives of W by I4, I6 and I8, (3, 3, points)."""
        (x, y), (u, v) = self._cloth.inverses()
        mixed = x * y, (x * v + y * u) / 2, u * v
        return np.array([(x * x, x * u, u * u), (y * y, y * v, v * v), mixed])

    @of_state
    def strain(self):
        """L_η a as L11, 2 L12, L22, so that J S : L_η a is its product with `stress`."""
        eta = self.eta.at_points(self.unknowns[self._dofs].reshape(2, -1))
        return np.einsum("kjmp,jmp->kp", self._unit_strains, eta)

    def value(self):
        """The work."""
        return (self._weights * self.stress() * self.strain()).sum()

    @of_state
    def eta_force(self):
        """The derivative of the work by η, (dofs of η,)."""
        stress = self.stress() * self._weights
        forces = np.einsum("kjmp,kp->jmp", self._unit_strains, stress)
        return self.eta.transposed(forces).ravel()

    def density(self):
        """S : L_η a at the points, (points,)."""
        return (self._law.values("stress") * self.sliding().entries).sum(axis=0)

    def slopes(self):
        """Derivatives of `density` by the components of ∇ψ, (4, points)."""
        sliding = self.sliding()
        slopes = np.einsum("kin,kn->in", self._law.slopes("stress"), sliding.entries)
        return slopes + np.einsum("kin,kn->in", sliding.slopes, self._law.values("stress"))

    @of_state
    def sliding(self):
        """G⁻ᵀ (L_η a) G⁻¹, how η strains the cloth along its threads, a `PushedTensor`."""
        l11, twice_l12, l22 = self.strain()
        l12 = twice_l12 / 2
        return PushedTensor(self._cloth.inverses(), np.array([[l11, l12], [l12, l22]]))

    def coupling_blocks(self):
        """Second derivatives by η and ψ, (triangles, η of a triangle, ψ of a triangle)."""
        triangles, _, at_one, _ = self._psi.shapes.shape
        slopes = self.stress_slopes() * self._weights
        slopes = slopes.reshape(2, 2, 3, triangles, at_one)
        changes = np.einsum("imktq,tmqb->tkqib", slopes, self._psi.shapes[:, 1:], optimize=True)
        return self._straining @ changes.reshape(triangles, 3 * at_one, -1)


def _unit_strains(virtual_strain, points):
    """L_η a of a unit value or derivative of a component of η, (3, 2, 3, points)."""
    strains = []
    for j, m in np.ndindex(2, 3):
        unit = np.zeros((2, 3))
        unit[j, m] = 1
        eta, gradient = ngs.CF(tuple(unit[:, 0])), ngs.CF(tuple(unit[:, 1:].ravel()), dims=(2, 2))
        strain = virtual_strain(eta, gradient)
        strains += [strain[0, 0], 2 * strain[0, 1], strain[1, 1]]
    strains = points.sample(ngs.CF(tuple(strains)).Compile()).reshape(2, 3, 3, -1)
    return np.ascontiguousarray(strains.transpose(2, 0, 1, 3))
