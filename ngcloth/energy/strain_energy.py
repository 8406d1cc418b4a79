"""The strain energy, and what equilibrium asks of it: derivatives by ψ, and once more along v."""

import ngsolve as ngs
import numpy as np

from .discretisation import of_state
from .sampled_cloth import Stacked, partial_derivatives, pushed_bend, pushed_slopes

UNIT = np.array([1.0, 0.0, 0.0, 1.0])[:, None]  # tr Y, by Y
# (tr Y)(tr Z) − tr(Y Z), by Y and Z: twice the change of J of second order, over J.
TURNING = np.einsum("ij,kl->ijkl", *2 * [np.eye(2)]) - np.einsum("il,jk->ijkl", *2 * [np.eye(2)])
TURNING = TURNING.reshape(4, 4, 1)


class StrainEnergy:
    """∫ J W and its derivative along v, ∫ P : ∇v, from numbers at the sampling points.

    Per flat area, and by the gradients Y of changes in the flat plane (see `SampledCloth`), J W has
    the derivative P = W I − 2 C w, w = dW/dC: Eshelby's stress. A dot is the derivative along v, M
    being its Y: Ċ = −(Mᵀ C + C M), J̇ = J tr M, and Y itself changes by −Y M.

    Parameters
    ----------
    cloth : SampledCloth
        Of the current ψ.
    fabric : Net or similar
    v : Sampling
        Of a component of v.
    """

    def __init__(self, cloth, fabric, v):
        self._cloth, self._v = cloth, v
        self.unknowns, space = cloth.state.vec.FV().NumPy(), cloth.state.space
        self._dofs = slice(space.Range(2).start, space.Range(3).stop)
        invariants = cloth.variables[4:7]
        self._dots = [cloth.points.field() for _ in range(3)]
        energy = fabric.energy(*invariants) / fabric.stiffness
        firsts = [energy.Diff(variable) for variable in invariants]
        dot = sum((w * dot for w, dot in zip(firsts, self._dots, strict=True)), ngs.CF(0.0))
        firsts_dot = [dot.Diff(variable) for variable in invariants]
        self._places, seconds = _second_derivatives(energy, invariants)
        self._places_dot, seconds_dot = _second_derivatives(dot, invariants)
        self._all, self._all_dot = (
            Stacked([energy, *firsts], seconds),
            Stacked(firsts_dot, seconds_dot),
        )

    # Of ψ alone -----------------------------------------------------------------------------

    def density(self):
        """W over kc, (points,)."""
        return self._law()[0]

    @of_state
    def stress(self):
        """P, (4, points)."""
        return self.density() * UNIT + self._slopes()

    @of_state
    def tangent(self):
        """Second derivatives of J W over J, (4, 4, points)."""
        (density, *firsts), slopes = self._law(), self._slopes()
        tangent = of_flat_area(density, slopes) + pushed_bend(self._strain(), firsts)
        return tangent + np.einsum("ain,ajn->ijn", self._strain_slopes(), self._stiffened())

    def stiffness(self):
        """The largest second derivative of W by C, over kc."""
        return np.abs(self._second()).max()

    # Once more along v ----------------------------------------------------------------------

    def work(self):
        """P : M, (points,), the derivative of J W along v over J."""
        return (self.stress() * self._spread()).sum(axis=0)

    @of_state
    def work_slopes(self):
        """The derivative of J P : M over J, (4, points)."""
        spread = self._spread().reshape(2, 2, -1)
        turned = np.einsum("ijn,mjn->imn", self.stress().reshape(2, 2, -1), spread)
        density_dot, slopes_dot, _ = self._dotted()
        stress_dot = density_dot * UNIT + slopes_dot
        return self._growth() * self.stress() + stress_dot - turned.reshape(4, -1)

    def work_tangent(self):
        """Second derivatives of J P : M over J, (4, 4, points)."""
        density_dot, slopes_dot, firsts_dot = self._dotted()
        strain_dot = self._strain_dot()
        strain_slopes_dot = pushed_slopes(strain_dot)
        tangent = of_flat_area(density_dot, slopes_dot) + pushed_bend(self._strain(), firsts_dot)
        tangent += pushed_bend(strain_dot, self._law()[1:])
        stiffened = np.einsum("abn,bin->ain", self._second(), strain_slopes_dot)
        stiffened += np.einsum("abn,bin->ain", self._second_dot(), self._strain_slopes())
        tangent += np.einsum("ain,ajn->ijn", self._strain_slopes(), stiffened)
        tangent += np.einsum("ain,ajn->ijn", strain_slopes_dot, self._stiffened())
        here = self.tangent()
        spread = self._spread().reshape(2, 2, -1)
        turned = np.einsum("ijxn,mjn->imxn", here.reshape(2, 2, 4, -1), spread).reshape(4, 4, -1)
        return tangent + self._growth() * here - turned - turned.swapaxes(0, 1)

    # How they are found ---------------------------------------------------------------------

    def _strain(self):
        return self._cloth.pushed_tensors()[0]

    def _strain_slopes(self):
        return self._cloth.slopes()[4:7]

    @of_state
    def _evaluated(self):
        self._cloth.update()
        return self._all.at(self._cloth.points)

    def _law(self):
        """W and its derivatives by C, (4, points)."""
        return self._evaluated()[0]

    @of_state
    def _second(self):
        """Second derivatives of W by C, (3, 3, points)."""
        return _symmetric(self._places, self._evaluated()[1])

    @of_state
    def _slopes(self):
        """Derivatives of W by Y, (4, points)."""
        return np.einsum("an,ain->in", self._law()[1:], self._strain_slopes())

    @of_state
    def _stiffened(self):
        """Derivatives of w by Y, (3, 4, points)."""
        return np.einsum("abn,bin->ain", self._second(), self._strain_slopes())

    def flat_v(self):
        """Derivatives of v's shape functions in the flat plane, a `Sampling`."""
        same = self._v is self._cloth.psi
        return self._cloth.flat() if same else self._v.flat(self._cloth.inverses())

    @of_state
    def _spread(self):
        """M, (4, points)."""
        return self.flat_v().at_points(self.unknowns[self._dofs].reshape(2, -1)).reshape(4, -1)

    def _growth(self):
        """tr M, (points,)."""
        return self._spread()[0] + self._spread()[3]

    @of_state
    def _strain_dot(self):
        """Ċ, (3, points)."""
        strain_dot = np.einsum("ain,in->an", self._strain_slopes(), self._spread())
        for field, row in zip(self._dots, strain_dot, strict=True):
            field.vec.FV().NumPy()[:] = row
        return strain_dot

    @of_state
    def _dotted(self):
        """The derivatives of W, of its slopes by Y and of w."""
        strain_dot, firsts = self._strain_dot(), self._law()[1:]
        firsts_dot, _ = self._evaluated_dot()
        slopes_dot = np.einsum("an,ain->in", firsts_dot, self._strain_slopes())
        slopes_dot += np.einsum("an,ain->in", firsts, pushed_slopes(strain_dot))
        return (firsts * strain_dot).sum(axis=0), slopes_dot, firsts_dot

    @of_state
    def _evaluated_dot(self):
        self._strain_dot()
        self._cloth.update()
        return self._all_dot.at(self._cloth.points)

    def _second_dot(self):
        return _symmetric(self._places_dot, self._evaluated_dot()[1])


def _second_derivatives(expression, variables):
    """Those of an expression by three variables that do not vanish, and their places (i, j)."""
    firsts = partial_derivatives([((), expression)], variables)
    seconds = partial_derivatives(firsts.items(), variables)
    upper = {(at[1], j): second for (at, j), second in seconds.items() if at[1] <= j}
    return list(upper), upper.values()


def _symmetric(places, values):
    """Second derivatives as a matrix, (3, 3, points)."""
    matrix = np.zeros((3, 3, values.shape[1]))
    for (i, j), each in zip(places, values, strict=True):
        matrix[i, j] = matrix[j, i] = each
    return matrix


def of_flat_area(density, slopes):
    """Second derivatives of J W over J, but for those of W itself."""
    sides = UNIT[:, None] * slopes
    return density * TURNING + sides + sides.swapaxes(0, 1)
