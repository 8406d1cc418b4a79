"""The Lagrangian of a scene with limits: equilibrium and barriers, with their multipliers."""

from functools import cache, cached_property

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException

from .kinematics import Kinematics, gradient, virtual_strain
from .lagrangian import Lagrangian, of_state
from .sampled_cloth import SampledCloth, SampledExpressions
from .sampling import Sampling, point_weights
from .virtual_work import VirtualWork

SOFTENING = 1e-8  # of the block of η for a factorisation without pivoting


class ConstrainedLagrangian(Lagrangian):
    """L(ψ, η) = E(ψ) + ∫ J S : L_η a − Σ ∫ z c dA, eq. (22) in intrinsic form, over kc.

    The second term is the virtual work of sliding the cloth along η (eq. 16); the third holds the
    multipliers z of every slack c of the scene's constraints, which the barrier makes μ/c.

    Parameters
    ----------
    multiplier_order : int
        Polynomial order of η.

    Others as for `Lagrangian`.

    Attributes
    ----------
    eta_flow : BaseMatrix
        As `flow`, for η.
    weights : ndarray, (points,)
        With which sums over the sampling points are integrals over the surface.
    slack_names : list of str
        The limit to which each slack belongs.
    psi_dofs : slice
        Where the unknowns of ψ are in `state`; those of η follow.
    direction : GridFunction
        A change of `state`, for `slack_changes`.
    """

    def __init__(self, scene, mesh, order, quadrature, inverse, multiplier_order):
        self._multiplier_order = multiplier_order
        super().__init__(scene, mesh, order, quadrature, inverse, gauss_newton=False)
        trial = self.fes.TrialFunction()
        cloth = self._kinematics(trial)
        area = self._frozen(ngs.sqrt(ngs.Det(scene.surface.metric)))
        self.weights = point_weights(self.points, self._dx, area)
        self._flat_weights = point_weights(self.points, self._dx)
        self._sampling = Sampling(self.fes.components[0], self.points, self._dx)
        tensors = self._metric, scene.fabric, lambda: self._curvature
        self._here = here = SampledCloth(self.state, self._sampling, self.points, *tensors)
        self._work = self._virtual_work(here)
        self._slacks_here = SampledExpressions(here, self._slacks(here))

        slacks = self._slacks(cloth)
        self.slack_names = [limit.name for limit in scene.constraints for _ in limit.slacks(cloth)]
        self._c, self._z, self._stiffness = (
            [ngs.GridFunction(self.points) for _ in slacks] for _ in range(3)
        )
        self.direction = ngs.GridFunction(self.fes)
        limits = area * self._frozen_limits(slacks)
        cost = cloth.jacobian * self._density(cloth)
        self._model = self._symbolic_energy(cost + limits + self._work.density(cloth))

        self.psi_dofs = slice(0, self.fes.Range(1).stop)
        # η are parameters; their metric makes lengths on the surface of them, and norms of these
        # that depend neither on the chart nor on the unit of length.
        norm = self._h1_matrix({0: ngs.Id(2), 2: self._metric})
        self._riesz = norm.Inverse(self.free, inverse="sparsecholesky")
        self.relaxed = False
        self.eta_flow = self._h1_matrix({2: self._metric})
        self._force, self._rest = (self.state.vec.CreateVector() for _ in range(2))

    # What the loop asks -------------------------------------------------------------------

    @property
    def relaxed(self):
        """Whether equilibrium is not asked for, and η stays as it is."""
        return self._relaxed

    @relaxed.setter
    def relaxed(self, relaxed):
        self._relaxed, self._moving = relaxed, ngs.BitArray(self.free)
        if relaxed:
            self._moving[self.psi_dofs.stop :] = False
        self._inside = ngs.Projector(self._moving, True)

    def slacks(self):
        """Values c of all slacks at the sampling points, (slacks, points)."""
        return self._slacks_here.values()

    def slack_changes(self):
        """Derivatives of all slacks along ψ of `direction`, (slacks, points)."""
        if not self.slack_names:
            return np.empty((0, self.points.ndof))
        change = [
            self._sampling.at_points(part.vec.FV().NumPy())[1:]
            for part in self.direction.components[:2]
        ]
        return np.einsum("sip,ip->sp", self._slacks_here.slopes(), np.concatenate(change))

    def rigid_step(self):
        """Move ψ to where ∇ψ is nearest to R √a, R being the rotation now nearest to ∇ψ √a⁻¹.

        This is a step to the flattening as rigid as possible of Liu et al. (2008): the mean of
        |∇ψ √a⁻¹ − R|² over the surface falls with each.
        """
        load, inverse = self._rigid
        self._rest.data = load.Assemble().vec - self.flow * self.state.vec
        self.state.vec.data += inverse * self._rest

    def take(self, coarse):
        """Interpolate ψ and η from the state of a coarser mesh. Returns whether J > 0."""
        for component, from_coarse in zip(self.state.components, coarse.components, strict=True):
            component.Set(from_coarse)
        self.state.vec.data = ngs.Projector(self.fes.FreeDofs(), True) * self.state.vec
        return self.least_jacobian() > 0

    def freeze(self, c, z, stiffness):
        """Take arrays (slacks, points) for `gradient` and `hessian` to use.

        Parameters
        ----------
        c : ndarray
            The slacks at the current state.
        z : ndarray
            Their multipliers.
        stiffness : ndarray
            The weights of ∇c ∇cᵀ in the matrix.
        """
        for fields, arrays in ((self._c, c), (self._z, z), (self._stiffness, stiffness)):
            for field, values in zip(fields, arrays, strict=True):
                field.vec.FV().NumPy()[:] = values

    def gradient(self, out):
        """Write ∇E + ∇(work) − Σ z ∇c at the current state, with the frozen z, to `out`."""
        out.data = self._cost_gradient()
        pull = self._work.psi_force() * self._flat_weights
        if self.slack_names:
            z = [field.vec.FV().NumPy() for field in self._z] * self.weights
            pull -= np.einsum("sp,sip->ip", z, self._slacks_here.slopes())
        loads = [self._sampling.transposed(part) for part in (pull[:2], pull[2:])]
        out.FV().NumPy()[:] += np.concatenate([*loads, self._work.eta_force()])

    def hessian(self):
        """The second derivative of the Lagrangian, with frozen z, c and stiffness."""
        self._work.freeze()
        matrix = super().hessian()
        self._work.add_coupling(matrix)
        return matrix

    def cost_gradient(self, out):
        """Write the derivative of `cost` to the vector `out`."""
        out.data = self._cost_gradient()

    @of_state
    def _cost_gradient(self):
        force = self.state.vec.CreateVector()
        self._energy.Apply(self.state.vec, force)
        return force

    def work(self):
        """The virtual work of sliding the cloth along η, over kc."""
        return self._work.value()

    def imbalance(self):
        """Dual norm of the in-plane force on the cloth inside the rim; zero while relaxed."""
        return 0.0 if self.relaxed else self._imbalance()

    @of_state
    def _imbalance(self):
        self._force[:] = 0
        self._force.FV().NumPy()[self.psi_dofs.stop :] = self._work.eta_force()
        return self.dual_norm(self._force)

    def dual_norm(self, force):
        """The norm of a derivative, dual to the H¹ seminorm on the surface."""
        square = ngs.InnerProduct(force, (self._riesz * force).Evaluate())
        return np.sqrt(max(square, 0.0))

    def solver(self, matrix):
        """Return a function (load, out) that writes the x with matrix x = load to `out`.

        LDLᵀ without pivoting needs a matrix without zeros on the diagonal (Vanderbei, 1995); it
        gets one with a small negative block for η, whose effect iterative refinement undoes. It
        takes a tenth of the time of LU with pivoting, which stands by for the rare failure; where
        that fails as well, x is not a number.
        """
        softened = None
        if self.inverse == "sparsecholesky":
            matrix.AsVector().data -= SOFTENING * self.eta_flow.AsVector()
            softened = matrix.Inverse(self._moving, inverse="sparsecholesky")
            matrix.AsVector().data += SOFTENING * self.eta_flow.AsVector()

        @cache
        def pivoted():
            return matrix.Inverse(self._moving, inverse="umfpack")

        def solve(load, out):
            if softened is not None and self._refine(matrix, softened, load, out):
                return
            try:
                out.data = pivoted() * load
            except NgException:  # singular, or not finite
                out[:] = np.nan

        return solve

    # How it is put together ---------------------------------------------------------------

    @cached_property
    def _rigid(self):
        """∫ R √a a⁻¹ : ∇v dA at the current ψ, and the inverse of `flow` on ψ."""
        metric, area = self._metric, ngs.sqrt(ngs.Det(self._metric))
        root = (metric + area * ngs.Id(2)) / ngs.sqrt(ngs.Trace(metric) + 2 * area)
        strain = gradient(*self._psi) * ngs.Inv(root)
        twice = strain + ngs.Cof(strain)  # a multiple of the rotation nearest to the strain
        rotation = twice / ngs.sqrt(ngs.Det(twice))
        target = (rotation * root * ngs.Cof(metric) / area).Compile()
        load = ngs.LinearForm(self.fes)
        load += ngs.InnerProduct(target, gradient(*self.fes.TestFunction()[:2])) * self._dx
        moving = ngs.BitArray(self.free)
        moving[self.psi_dofs.stop :] = False
        return load, self.flow.Inverse(moving, inverse="sparsecholesky")

    def _refine(self, matrix, inverse, load, out):
        """Iterate out ← out + inverse (load − matrix out) to 1e-10; whether that succeeded."""
        out[:] = 0
        self._rest.data = self._inside * load
        goal = 1e-10 * self._rest.Norm()
        for _ in range(8):
            out.data += inverse * self._rest
            self._rest.data = load - matrix * out
            self._rest.data = self._inside * self._rest
            size = self._rest.Norm()
            if size <= goal or not np.isfinite(size):
                break
        return size <= goal

    def _virtual_work(self, here):
        derivatives = [self._frozen_symmetric(d) for d in self.scene.surface.metric_derivatives]

        def strain(eta, eta_gradient):
            return virtual_strain(eta, eta_gradient, self._metric, derivatives)

        return VirtualWork(here, strain, self._sampling, self.points, self._dx)

    def _frozen_limits(self, slacks):
        """The energy whose Hessian at the current state is the limits' part of the matrix.

        z, the value c of the slack and the stiffness z/s are frozen.
        """
        frozen = zip(slacks, self._c, self._z, self._stiffness, strict=True)
        terms = (-z * slack + stiffness / 2 * (slack - c) ** 2 for slack, c, z, stiffness in frozen)
        return sum(terms, ngs.CF(0.0))

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
