"""The Lagrangian of a scene with limits: equilibrium and barriers, with their multipliers."""

from functools import cached_property

import ngsolve as ngs
import numpy as np

from .kinematics import Kinematics, gradient, virtual_strain
from .lagrangian import Lagrangian

# Multipliers z of a slack c are kept within this factor of μ/c, the value they tend to.
DUAL_RANGE = 1e4


class ConstrainedLagrangian(Lagrangian):
    """L(ψ, η) = E(ψ) + ∫ J S : L_η a − μ Σ ∫ log c dA, eq. (22) in intrinsic form, over kc.

    The second term is the virtual work of sliding the cloth along η (eq. 16), the third the
    barrier of every slack c of the scene's constraints.

    Parameters
    ----------
    multiplier_order : int
        Polynomial order of η.

    Others as for `Lagrangian`.
    """

    def __init__(self, scene, mesh, order, quadrature, inverse, multiplier_order):
        self._multiplier_order = multiplier_order
        super().__init__(scene, mesh, order, quadrature, inverse, gauss_newton=False)
        trial = self.fes.TrialFunction()
        cloth, here = self._kinematics(trial), self._kinematics(self.state.components)
        weight = self._frozen(ngs.sqrt(ngs.Det(scene.surface.metric)))

        self._barrier_weight = ngs.Parameter(0.0)
        slacks = self._slacks(cloth)
        self.slack_names = [limit.name for limit in scene.constraints for _ in limit.slacks(cloth)]
        self.c = [ngs.GridFunction(self.points) for _ in slacks]
        self.z = [ngs.GridFunction(self.points) for _ in slacks]
        self._c_here = [slack.Compile() for slack in self._slacks(here)]
        self.direction = ngs.GridFunction(self.fes)
        sliding = gradient(*self.direction.components[:2])
        self._dc_here = [
            slack.Diff(here.gradient, sliding).Compile() for slack in self._slacks(here)
        ]

        elastic = cloth.jacobian * self._strain_energy(cloth)
        barrier = sum((ngs.log(slack) for slack in slacks), ngs.CF(0.0))
        self._objective = self._symbolic_energy(elastic - self._barrier_weight * weight * barrier)
        derivatives = [self._frozen_symmetric(d) for d in scene.surface.metric_derivatives]
        eta = ngs.CF(tuple(trial[2:]))
        strain = virtual_strain(eta, gradient(*trial[2:]), self._metric, derivatives)
        stress = cloth.contravariant_stress / scene.fabric.stiffness
        sliding_work = cloth.jacobian * ngs.InnerProduct(stress, strain)
        self._work = self._symbolic_energy(sliding_work)

        # The energy whose Hessian at the current state is the primal-dual matrix: z and c̄ are
        # frozen, so that z/c̄ ∇c∇cᵀ − z ∇²c stands where the barrier alone has μ/c̄² and μ/c̄.
        primal_dual = sum(
            (
                -z * slack + z / (2 * c) * (slack - c) ** 2
                for slack, c, z in zip(slacks, self.c, self.z, strict=True)
            ),
            ngs.CF(0.0),
        )
        self._model = self._symbolic_energy(elastic + weight * primal_dual)
        self._model += ngs.Variation(sliding_work.Compile() * self._dx)

        self.psi_dofs = slice(0, self.fes.Range(1).stop)
        norm = self._h1_matrix(range(len(trial)))
        self._riesz = norm.Inverse(self.free, inverse="sparsecholesky")
        self._force = self.state.vec.CreateVector()

    # What the loop asks -------------------------------------------------------------------

    def set_mu(self, mu):
        """Set the weight of the barrier."""
        self.mu = mu
        self._barrier_weight.Set(mu)

    def value(self):
        """The Lagrangian at the current state, divided by kc, over the meshed domain."""
        return self.objective() + self._work.Energy(self.state.vec)

    def objective(self):
        """E and barriers at the current state, divided by kc, over the meshed domain."""
        return self._objective.Energy(self.state.vec)

    def objective_gradient(self, out):
        """Write the derivative of `objective` to the vector `out`."""
        self._objective.Apply(self.state.vec, out)

    def gradient(self, out):
        """Write the derivative of the Lagrangian at the current state to the vector `out`."""
        self._objective.Apply(self.state.vec, out)
        self._work.Apply(self.state.vec, self._force)
        out.data += self._force

    def dual_residual(self):
        """Norm of ∇E + ∇(work) − Σ z ∇c per √area: stationarity with the multipliers z, η."""
        self._model.Apply(self.state.vec, self._force)
        self._force.FV().NumPy()[self.psi_dofs.stop :] = 0
        return self._dual_norm(self._force) / np.sqrt(self.area)

    def imbalance(self):
        """Dual norm of the in-plane force on the cloth inside the rim."""
        self._work.Apply(self.state.vec, self._force)
        self._force.FV().NumPy()[self.psi_dofs] = 0
        return self._dual_norm(self._force)

    def slacks_here(self):
        """Values of all slacks at the sampling points, a list of arrays."""
        return [self._values(slack) for slack in self._c_here]

    def slack_changes(self):
        """Derivatives of all slacks along ψ of `direction`, a list of arrays."""
        return [self._values(change) for change in self._dc_here]

    def freeze(self, slacks):
        """Take `slacks` as the c̄ of the primal-dual matrix."""
        for field, values in zip(self.c, slacks, strict=True):
            field.vec.FV().NumPy()[:] = values

    def multipliers(self):
        """The arrays of z, to be changed in place."""
        return [field.vec.FV().NumPy() for field in self.z]

    def bound_multipliers(self, slacks):
        """Bring z back to within a factor of μ/c."""
        for z, c in zip(self.multipliers(), slacks, strict=True):
            np.clip(z, self.mu / (DUAL_RANGE * c), DUAL_RANGE * self.mu / c, out=z)

    # How it is put together ---------------------------------------------------------------

    def _spaces(self, mesh, order, mirrors):
        rims = [f"rim|{line}" if line else "rim" for line in mirrors]
        eta = [ngs.H1(mesh, order=self._multiplier_order, dirichlet=rim) for rim in rims]
        return super()._spaces(mesh, order, mirrors) + eta

    def _kinematics(self, components):
        return Kinematics(
            gradient(*components[:2]),
            self._metric,
            self.scene.fabric,
            lambda: self._curvature,
        )

    @cached_property
    def _curvature(self):
        return self._frozen_symmetric(self.scene.surface.curvature)

    def _slacks(self, cloth):
        return [slack for limit in self.scene.constraints for slack in limit.slacks(cloth)]

    def _values(self, expression):
        self._probe.Interpolate(expression)
        return self._probe.vec.FV().NumPy().copy()

    def _dual_norm(self, force):
        square = ngs.InnerProduct(force, (self._riesz * force).Evaluate())
        return np.sqrt(max(square, 0.0))
