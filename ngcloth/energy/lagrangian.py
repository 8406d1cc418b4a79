"""The Lagrangian of a scene without limits as an NGSolve `SymbolicEnergy`."""

import ngsolve as ngs
import numpy as np

from ..problem.kinematics import Kinematics, gradient
from .discretisation import Discretisation, of_state

BENDING = 1e-2  # its weight in `_uneven_bending`


class Lagrangian(Discretisation):
    """The Lagrangian of a scene without limits (eq. 22), its cost, over kc.

    Parameters
    ----------
    scene, sheet, order, quadrature, inverse
        As for `Discretisation`.
    gauss_newton : bool
        Whether `hessian` is the Gauss-Newton matrix of a Chebyshev scene, unless asked otherwise.
    """

    slack_names, multipliers = (), 0  # there are none

    def __init__(self, scene, sheet, order, quadrature, inverse, gauss_newton):
        super().__init__(scene, sheet, order, quadrature, inverse)
        here = self._kinematics(self.state.components)
        self._jacobian, self._shear = here.jacobian.Compile(), here.shear.Compile()
        self._stretches = ngs.CF((here.stretch1, here.stretch2)).Compile()

        cloth = self._kinematics(self.fes.TrialFunction())
        self._energy = self._symbolic_energy(cloth.jacobian * self._density(cloth))
        self.gauss_newton = gauss_newton
        if gauss_newton:
            self._squares = self._sum_of_squares(cloth, here)
        self._tie_break = _uneven_bending(self.fes) if scene.tie_break else None

        self.psi_dofs, self.multiplier_flow = slice(0, len(self.unknowns)), self.flow

    # What the loops ask -------------------------------------------------------------------

    @of_state
    def cost(self):
        """What is minimised, E or the scene's own cost, over kc and the meshed domain."""
        return self._energy.Energy(self.state.vec)

    def value(self):
        """The Lagrangian at the current state, divided by kc, over the meshed domain."""
        value = self.cost()
        if self._tie_break is not None:
            psi = self.state.vec
            value += self.mu / 2 * ngs.InnerProduct(psi, (self._tie_break * psi).Evaluate())
        return value

    def gradient(self, out):
        """Write the derivative of the Lagrangian at the current state to the vector `out`."""
        self._energy.Apply(self.state.vec, out)
        if self._tie_break is not None:
            out.data += self.mu * (self._tie_break * self.state.vec)

    def hessian(self, exact=False):
        """The second derivative of the Lagrangian, or its Gauss-Newton part unless `exact`.

        The matrix is assembled anew at each call, into the same memory.
        """
        model = self._energy
        if self.gauss_newton and not exact:
            model = self._squares
            for field, values in zip(
                self._frozen_roots, self.points.sample(self._roots), strict=True
            ):
                field.vec.FV().NumPy()[:] = values
        model.AssembleLinearization(self.state.vec)
        matrix = model.mat
        if self._tie_break is not None:
            matrix.AsVector().data += self.mu * self._tie_break.AsVector()
        return matrix

    @of_state
    def least_jacobian(self):
        """The least J over all integration points; NaN if it is not finite somewhere."""
        return self.points.sample(self._jacobian).min()

    def stiffness(self):
        """Of what couples ψ and v: zero, without v."""
        return 0.0

    def largest_shear(self):
        """The largest |γ| over all integration points."""
        return np.abs(self.points.sample(self._shear)).max()

    def largest_strain(self):
        """The largest |λ − 1| of both threads over all integration points."""
        return np.abs(self.points.sample(self._stretches) - 1).max()

    # How it is put together ---------------------------------------------------------------

    def _kinematics(self, components):
        psi = components[:2]
        tensors = self._metric, self.scene.fabric, lambda: self._curvature
        return Kinematics(gradient(*psi), *tensors, psi)

    def _sum_of_squares(self, cloth, here):
        """The energy whose Hessian at the current state is the Gauss-Newton matrix of E.

        A Chebyshev scene minimises a sum of squares Σ r² that vanishes at the solution. The
        Hessian of Σ (r − r̄)², r̄ frozen at the current state, is 2 Σ ∇r ∇rᵀ: never indefinite,
        and ever closer to the Hessian of E. On the hemisphere it takes 7 steps on any mesh where
        the Hessian of E takes 10 to 40.
        """

        def roots(state):
            scale = ngs.sqrt(state.jacobian / self.scene.fabric.stiffness)
            return [scale * root for root in self.scene.fabric.thread_roots(state.I4, state.I6)]

        self._roots = ngs.CF(tuple(roots(here))).Compile()
        self._frozen_roots = [self.points.field() for _ in range(2)]
        pairs = zip(roots(cloth), self._frozen_roots, strict=True)
        squares = [(root - frozen) ** 2 for root, frozen in pairs]
        return self._symbolic_energy(sum(squares[1:], squares[0]))


def _uneven_bending(space):
    """The matrix of ∫ |(∇∇ψ − its mean)/h|² + 0.01 |∇∇ψ|², element by element, of a compound space.

    h is the element's size: the first term stands for |∇∇∇ψ|². A net that bends evenly is smooth,
    and what is smooth is resolved. The second term is all that order 2 has.
    """
    form = ngs.BilinearForm(space, symmetric=True)
    constants, h = ngs.L2(space.mesh, order=0), ngs.specialcf.mesh_size
    for pair in zip(*space.TnT(), strict=True):
        u, v = (psi.Operator("hesse") for psi in pair)
        form += BENDING * ngs.InnerProduct(u, v) * ngs.dx
        for i in range(4):
            du, dv = (bending[i] - ngs.Interpolate(bending[i], constants) for bending in (u, v))
            form += du * dv / h**2 * ngs.dx
    return form.Assemble().mat
