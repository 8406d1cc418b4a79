"""The virtual work of sliding the cloth along η, and its derivatives."""

import ngsolve as ngs
import numpy as np

from .lagrangian import of_state
from .sampled_cloth import SampledExpressions
from .sampling import Sampling, point_weights, sampled


class VirtualWork:
    """∫ J S : L_η a (eq. 16, in intrinsic form), over kc.

    It is linear in η. Differentiated automatically by η too, it would take two thirds of the time
    of the Newton matrix; so only its second derivative by ψ is, through `density`. What couples ψ
    and η is made of the derivatives of J S at the sampling points.

    Parameters
    ----------
    cloth : SampledCloth
        Of the current ψ, η.
    virtual_strain : callable
        From η and its gradient to L_η a, all expressions.
    psi : Sampling
        Of a component of ψ.
    points, dx : IntegrationRuleSpace, DifferentialSymbol
        Where to sample, and the integral by these points.
    """

    def __init__(self, cloth, virtual_strain, psi, points, dx):
        self.state, self._cloth, self._psi = cloth.state, cloth, psi
        space = self.state.space
        self._eta = Sampling(space.components[2], points, dx)
        self._dofs = [slice(r.start, r.stop) for r in map(space.Range, range(4))]
        self._weights = point_weights(points, dx)
        stiffness = cloth.fabric.stiffness
        self._energy_slopes = SampledExpressions(
            cloth, [w / stiffness for w in cloth.energy_slopes]
        )
        self._frozen_strain = [ngs.GridFunction(points) for _ in range(3)]
        self._unit_strains = _unit_strains(virtual_strain, points)
        _, triangles, at_one, _ = self._eta.shapes.shape
        by_triangle = self._unit_strains.reshape(3, 2, 3, triangles, at_one)
        # How each η of a triangle strains its points: (triangles, strains at points, η).
        straining = np.einsum("kjmtq,mtqa->tkqja", by_triangle, self._eta.shapes, optimize=True)
        self._straining = straining.reshape(triangles, 3 * at_one, -1)
        self._places = None

    @of_state
    def stress(self):
        """J S over kc, as S11, S12, S22, (3, points)."""
        slopes = self._energy_slopes.values() * self._cloth.jacobians()
        return np.einsum("kn,kcn->cn", slopes, self._directions())

    @of_state
    def stress_slopes(self):
        """Its derivatives by the components of ∇ψ, (4, 3, points)."""
        inverse, stress = self._cloth.inverses(), self.stress()
        s11, s12, s22 = stress
        # d(J S) by the rule of products, with dJ = J tr(G⁻¹ dG) and dG⁻¹ = −G⁻¹ dG G⁻¹.
        changes = self._energy_slopes.slopes() * self._cloth.jacobians()
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
        state = self.state.vec.FV().NumPy()
        eta = np.array([self._eta.at_points(state[dofs]) for dofs in self._dofs[2:]])
        return np.einsum("kjmp,jmp->kp", self._unit_strains, eta)

    def value(self):
        """The work."""
        return (self._weights * self.stress() * self.strain()).sum()

    @of_state
    def psi_force(self):
        """What acts on ∇ψ at the points: derivatives of the work's density, (4, points)."""
        return np.einsum("ikp,kp->ip", self.stress_slopes(), self.strain())

    @of_state
    def eta_force(self):
        """The derivative of the work by η, (dofs of η,)."""
        stress = self.stress() * self._weights
        forces = np.einsum("kjmp,kp->jmp", self._unit_strains, stress)
        return np.concatenate([self._eta.transposed(force) for force in forces])

    def density(self, cloth):
        """J S : L_η a as an expression in ψ, with the strain that `freeze` has frozen."""
        l11, twice_l12, l22 = self._frozen_strain
        strain = ngs.CF((l11, twice_l12 / 2, twice_l12 / 2, l22), dims=(2, 2))
        return cloth.jacobian * cloth.power(strain) / cloth.fabric.stiffness

    def freeze(self):
        """Freeze the present strain."""
        for field, values in zip(self._frozen_strain, self.strain(), strict=True):
            field.vec.FV().NumPy()[:] = values

    def add_coupling(self, matrix):
        """Add the second derivatives by ψ and η to a matrix of the compound space."""
        _, triangles, at_one, _ = self._psi.shapes.shape
        slopes = self.stress_slopes() * self._weights
        slopes = slopes.reshape(2, 2, 3, triangles, at_one)
        changes = np.einsum("imktq,mtqb->tkqib", slopes, self._psi.shapes[1:], optimize=True)
        changes = changes.reshape(triangles, 3 * at_one, -1)
        blocks = (self._straining.transpose(0, 2, 1) @ changes).ravel()
        if self._places is None:
            self._places = self._find_places(matrix)
        entries = matrix.AsVector().FV().NumPy()
        for places in self._places:
            entries += np.bincount(places, blocks, len(entries))

    def _find_places(self, matrix):
        """Where entries of the blocks, and of the transposed blocks, are in the matrix."""
        psi, eta = (
            np.concatenate([dofs.start + sampling.dofs for dofs in ranges], axis=1)
            for sampling, ranges in ((self._psi, self._dofs[:2]), (self._eta, self._dofs[2:]))
        )
        _, columns, starts = (np.array(part, dtype=np.int64) for part in matrix.CSR())
        rows = np.repeat(np.arange(matrix.height), np.diff(starts))
        numbers = rows * matrix.width + columns

        def places(rows, columns):
            return np.searchsorted(numbers, (rows * matrix.width + columns).ravel())

        psi, eta = psi[:, None, :].astype(np.int64), eta[:, :, None].astype(np.int64)
        return places(eta, psi), places(psi, eta)


def _unit_strains(virtual_strain, points):
    """L_η a of a unit value or derivative of a component of η, (3, 2, 3, points)."""
    field, strains = ngs.GridFunction(points**3), np.empty((3, 2, 3, points.ndof))
    for j, m in np.ndindex(2, 3):
        unit = np.zeros((2, 3))
        unit[j, m] = 1
        eta, gradient = ngs.CF(tuple(unit[:, 0])), ngs.CF(tuple(unit[:, 1:].ravel()), dims=(2, 2))
        strain = virtual_strain(eta, gradient)
        strain = ngs.CF((strain[0, 0], 2 * strain[0, 1], strain[1, 1])).Compile()
        strains[:, j, m] = sampled(strain, field)
    return strains
