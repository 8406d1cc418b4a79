"""The Lagrangian of a scene with limits: equilibrium and barriers, with their multipliers."""

from functools import cached_property

import ngsolve as ngs
import numpy as np

from ..problem.constraints import RIM_SHARE
from ..problem.kinematics import Kinematics, gradient, virtual_strain
from .discretisation import Discretisation, of_state
from .sampled_cloth import SampledCloth, SampledExpressions, symmetric_products
from .sampled_limits import SampledLimits
from .sampling import RimPoints, Sampling, places
from .virtual_work import VirtualWork


class ConstrainedLagrangian(Discretisation):
    """L(ψ, η) = E(ψ) + ∫ J S : L_η a − Σ ∫ z c dA, eq. (22) in intrinsic form, over kc.

    The second term is the virtual work of sliding the cloth along η (eq. 16); the third holds the
    multipliers z of every slack c of the scene's constraints, which the barrier makes μ/c.

    `symbolic_energy` is all of it as one NGSolve `SymbolicEnergy`, but for the limits on the rim.
    The loops use its values and derivatives by ∇ψ at the sampling points, where each is a short
    expression, and assemble them: the same numbers to rounding, in a fraction of the time.

    The limits hold at points on the rim as well as inside. Where threads are taut there, and limits
    are not, the energy is too small by what the cloth gains between the rim and the first points
    inside: an error of first order in the size of the triangles.

    Parameters
    ----------
    multiplier_order : int
        Polynomial order of η.

    Others as for `Discretisation`.

    Attributes
    ----------
    eta_flow : BaseMatrix
        As `flow`, for η.
    weights : ndarray, (points,)
        With which the points at which limits are sampled count in barriers: those inside, where
        sums are integrals over the surface, and then those on the rim.
    inside : ndarray of bool, (points,)
        Which of these points are not on the rim.
    slack_names : list of str
        The limit to which each slack belongs.
    psi_dofs : slice
        Where the unknowns of ψ are in `state`; those of η follow.
    multipliers : int
        How many unknowns of η move.
    direction : GridFunction
        A change of `state`, for `slack_changes`.
    """

    def __init__(self, scene, mesh, order, quadrature, inverse, multiplier_order):
        self._multiplier_order = multiplier_order
        super().__init__(scene, mesh, order, quadrature, inverse)
        self._flat_weights = self.points.weights
        self._sampling = Sampling(self.fes.components[0], self.points)
        tensors = self._metric, scene.fabric, lambda: self._curvature
        self._here = here = SampledCloth(self.state, self._sampling, self.points, *tensors)
        self._law = SampledExpressions(
            here,
            density=[self._density(here)],
            stress=[w / scene.fabric.stiffness for w in here.energy_slopes],
            slacks=self._slacks(here),
        )
        self._work = VirtualWork(here, self._law, self._strain, self._sampling, self.points)
        self.slack_names = [limit.name for limit in scene.constraints for _ in limit.slacks(here)]
        area = self._flat_weights * self._surface_area.vec.FV().NumPy()
        self._limits = [SampledLimits(self._law, self._sampling, area)]
        if self.slack_names:
            self._limits.append(self._limits_on_rim(quadrature))
        self.weights = np.concatenate([limits.weights for limits in self._limits])
        self.inside = np.arange(len(self.weights)) < len(self.points)
        self.direction = ngs.GridFunction(self.fes)

        self.psi_dofs = slice(0, self.fes.Range(1).stop)
        # η are parameters; their metric makes lengths on the surface of them, and norms of these
        # that depend neither on the chart nor on the unit of length.
        self.eta_flow = self._h1_matrix({2: self._metric})
        psi, eta = self._free_parts()
        self._psi_riesz = self.flow.Inverse(psi, inverse="sparsecholesky")
        self._eta_riesz = self.eta_flow.Inverse(eta, inverse="sparsecholesky")
        self.multipliers = eta.NumSet()
        self._matrix = self.flow.CreateMatrix()
        self._places = self._places_of_blocks()
        self._force, self._rest = (self.state.vec.CreateVector() for _ in range(2))

    def symbolic_energy(self, c, z, stiffness):
        """The Lagrangian as one `SymbolicEnergy` of ψ and η, with what `hessian` freezes.

        Parameters
        ----------
        c, z, stiffness : ndarray, (slacks, points)
            The slacks at the current state, their multipliers, and the weights of ∇c ∇cᵀ. Those on
            the rim are left out: NGSolve has no energy of ∇ψ on the boundary.

        Returns
        -------
        BilinearForm
        """
        inside = slice(len(self.points))
        trial = self.fes.TrialFunction()
        tensors = self._metric, self.scene.fabric, lambda: self._curvature
        cloth = Kinematics(gradient(*trial[:2]), *tensors)
        strain = self._strain(ngs.CF(tuple(trial[2:])), gradient(*trial[2:]))
        density = self._density(cloth) + cloth.power(strain) / self.scene.fabric.stiffness
        density *= cloth.jacobian
        for slack, *arrays in zip(self._slacks(cloth), c, z, stiffness, strict=True):
            value, multiplier, weight = (self.points.field(row[inside]) for row in arrays)
            limit = -multiplier * slack + weight / 2 * (slack - value) ** 2
            density += self._surface_area * limit
        return self._symbolic_energy(density)

    # What the loop asks -------------------------------------------------------------------

    def slacks(self):
        """Values c of all slacks where limits are sampled, (slacks, points)."""
        return np.concatenate([limits.values() for limits in self._limits], axis=1)

    def slack_changes(self):
        """Derivatives of all slacks along ψ of `direction`, (slacks, points)."""
        direction = self.direction.vec.FV().NumPy()[self.psi_dofs].reshape(2, -1)
        return np.concatenate([limits.changes(direction) for limits in self._limits], axis=1)

    def rigid_step(self):
        """Move ψ to where ∇ψ is nearest to R √a, R being the rotation now nearest to ∇ψ √a⁻¹.

        This is a step to the flattening as rigid as possible of Liu et al. (2008): the mean of
        |∇ψ √a⁻¹ − R|² over the surface falls with each.
        """
        self._rest.data = self._rigid.Assemble().vec - self.flow * self.state.vec
        self.state.vec.data += self._psi_riesz * self._rest

    def take(self, coarse):
        """Interpolate ψ and η from the state of a coarser mesh. Returns whether J > 0."""
        for component, from_coarse in zip(self.state.components, coarse.components, strict=True):
            component.Set(from_coarse)
        self.state.vec.data = ngs.Projector(self.fes.FreeDofs(), True) * self.state.vec
        return self.least_jacobian() > 0

    @of_state
    def cost(self):
        """What is minimised, E or the scene's own cost, over kc and the meshed domain."""
        return (self._flat_weights * self._here.jacobians() * self._law.values("density")).sum()

    @of_state
    def least_jacobian(self):
        """The least J over all integration points; NaN if it is not finite somewhere."""
        return self._here.jacobians().min()

    def gradient(self, z, out):
        """Write ∇E + ∇(work) − Σ z ∇c at the current state to the vector `out`.

        Parameters
        ----------
        z : ndarray, (slacks, points)
            The multipliers of the limits.
        out : BaseVector
            Of the unknowns of `state`.
        """
        force = self._psi_force() + sum(limits.loads(*part) for limits, *part in self._by_place(z))
        out.FV().NumPy()[:] = np.concatenate([force, self._work.eta_force()])

    def hessian(self, z, stiffness):
        """The second derivative of E + work − Σ z c + ½ Σ stiffness (c − c̄)², c̄ = c frozen.

        The matrix is assembled anew at each call, into the same memory.

        Parameters
        ----------
        z, stiffness : ndarray, (slacks, points)
            The multipliers of the limits, and the weights of ∇c ∇cᵀ.

        Returns
        -------
        BaseMatrix
        """
        inside, *rim = self._by_place(z, stiffness)
        psi = [
            self._sampling.blocks(self._tangent(*inside)),
            *(limits.blocks(*values) for limits, *values in rim),
        ]
        coupling = self._work.coupling_blocks()
        blocks = np.concatenate(
            [block.ravel() for block in (*psi, coupling, coupling.transpose(0, 2, 1))]
        )
        entries = self._matrix.AsVector().FV().NumPy()
        entries[:] = np.bincount(self._places, blocks, len(entries))
        return self._matrix

    def cost_gradient(self, out):
        """Write the derivative of `cost` to the vector `out`."""
        out[:] = 0
        (density,), (slopes,) = self._law.values("density"), self._law.slopes("density")
        out.FV().NumPy()[self.psi_dofs] = self._loads(self._weighted(density, slopes))

    def work(self):
        """The virtual work of sliding the cloth along η, over kc."""
        return self._work.value()

    @of_state
    def imbalance(self):
        """Dual norm of the in-plane force on the cloth inside the rim."""
        self._force[:] = 0
        self._force.FV().NumPy()[self.psi_dofs.stop :] = self._work.eta_force()
        return _dual_norm(self._force, self._eta_riesz)

    def stationarity(self, z):
        """Dual norm of the derivative by ψ of the Lagrangian with these multipliers z."""
        self.gradient(z, self._force)
        return _dual_norm(self._force, self._psi_riesz)

    def dual_norm(self, force):
        """The norm of a derivative, dual to the H¹ seminorm on the surface."""
        return np.hypot(*(_dual_norm(force, riesz) for riesz in (self._psi_riesz, self._eta_riesz)))

    def stiffness(self):
        """The greatest derivative of the stress by C, over kc: the size of what couples ψ and η."""
        return np.abs(self._law.partials("stress")).max(initial=1.0)

    # How it is put together ---------------------------------------------------------------

    @cached_property
    def _rigid(self):
        """∫ R √a a⁻¹ : ∇v dA at the current ψ, a linear form."""
        metric, area = self._metric, ngs.sqrt(ngs.Det(self._metric))
        root = (metric + area * ngs.Id(2)) / ngs.sqrt(ngs.Trace(metric) + 2 * area)
        strain = gradient(*self._psi) * ngs.Inv(root)
        twice = strain + ngs.Cof(strain)  # a multiple of the rotation nearest to the strain
        rotation = twice / ngs.sqrt(ngs.Det(twice))
        target = (rotation * root * ngs.Cof(metric) / area).Compile()
        load = ngs.LinearForm(self.fes)
        load += ngs.InnerProduct(target, gradient(*self.fes.TestFunction()[:2])) * self.points.dx
        return load

    def _free_parts(self):
        """The unknowns that move, of ψ and of η."""
        psi, eta = ngs.BitArray(self.free), ngs.BitArray(self.free)
        psi[self.psi_dofs.stop :] = eta[self.psi_dofs] = False
        return psi, eta

    def _limits_on_rim(self, degree):
        surface, points = self.scene.surface, RimPoints(self.state.space.mesh, degree)
        sampling = Sampling(self.fes.components[0], points)
        metric = self._frozen_symmetric(surface.metric, points)
        tensors = metric, self.scene.fabric, lambda: self._frozen_symmetric(curvature, points)
        curvature, along = surface.curvature, ngs.specialcf.tangential(2)
        cloth = SampledCloth(self.state, sampling, points, *tensors)
        (stretch,) = points.sample(ngs.sqrt(ngs.InnerProduct(metric * along, along)))
        length = points.weights * stretch
        weights = RIM_SHARE * self.area / length.sum() * length
        law = SampledExpressions(cloth, slacks=self._slacks(cloth))
        return SampledLimits(law, sampling, weights)

    def _by_place(self, *values):
        """The limits of each family of points, with its part of values (slacks, points)."""
        ends = np.cumsum([len(limits.weights) for limits in self._limits])[:-1]
        return zip(self._limits, *(np.split(value, ends, axis=1) for value in values), strict=True)

    @of_state
    def _psi_force(self):
        """Derivatives of E and work by ψ, (dofs of ψ,)."""
        return self._loads(self._weighted(*self._flat_density()))

    def _weighted(self, density, slopes):
        """Derivatives of J times a density per flat area, with the weights of the points."""
        here = self._here
        return self._flat_weights * (here.jacobians() * slopes + density * here.jacobian_slopes())

    @of_state
    def _flat_density(self):
        """Energy and work per flat area, and its derivatives by ∇ψ, (points,) and (4, points)."""
        (energy,), (slopes,) = self._law.values("density"), self._law.slopes("density")
        return energy + self._work.density(), slopes + self._work.slopes()

    def _tangent(self, limits, z, stiffness):
        """Second derivatives by ∇ψ of what is integrated inside, weighted, (4, 4, points)."""
        here, law, work = self._here, self._law, self._work
        jacobian, turning = (
            self._flat_weights * j for j in (here.jacobians(), here.jacobian_slopes())
        )
        density, slopes = self._flat_density()
        sliding = work.sliding()
        weights = {"density": jacobian[None], "stress": jacobian * sliding.entries}
        tangent = limits.tangent(z, stiffness, **weights)
        tangent += sliding.bend(jacobian * law.values("stress"))
        tangent += symmetric_products(
            [slopes, *(jacobian * law.slopes("stress"))], [turning, *sliding.slopes]
        )
        bent = self._flat_weights * density  # d²J, of J = G11 G22 − G12 G21
        for i, j, sign in ((0, 3, 1), (3, 0, 1), (1, 2, -1), (2, 1, -1)):
            tangent[i, j] += sign * bent
        return tangent

    def _loads(self, pull):
        """The forces on ψ, (dofs of ψ,), of what acts on ∇ψ at the points, (4, points)."""
        return self._sampling.transposed(pull.reshape(2, 2, -1)).ravel()

    def _places_of_blocks(self):
        """Where in the matrix the blocks of ψ and ψ, η and ψ, ψ and η of all triangles belong."""

        def numbers(components, dofs):
            return np.concatenate([self.fes.Range(i).start + dofs for i in components], axis=1)

        psi, *rim = (numbers((0, 1), limits.dofs) for limits in self._limits)
        eta = numbers((2, 3), self._work.eta.dofs)
        pairs = (psi, psi), *((of_rim, of_rim) for of_rim in rim), (eta, psi), (psi, eta)
        return np.concatenate([places(self._matrix, *pair) for pair in pairs])

    @cached_property
    def _surface_area(self):
        (area,) = self._frozen(ngs.sqrt(ngs.Det(self._metric)))
        return area

    @cached_property
    def _metric_derivatives(self):
        return [self._frozen_symmetric(d) for d in self.scene.surface.metric_derivatives]

    def _strain(self, eta, eta_gradient):
        """L_η a."""
        return virtual_strain(eta, eta_gradient, self._metric, self._metric_derivatives)

    def _spaces(self, mesh, order, mirrors):
        rims = [f"rim|{line}" if line else "rim" for line in mirrors]
        eta = [ngs.H1(mesh, order=self._multiplier_order, dirichlet=rim) for rim in rims]
        return super()._spaces(mesh, order, mirrors) + eta

    @cached_property
    def _curvature(self):
        return self._frozen_symmetric(self.scene.surface.curvature)

    def _slacks(self, cloth):
        return [slack for limit in self.scene.constraints for slack in limit.slacks(cloth)]


def _dual_norm(force, riesz):
    square = ngs.InnerProduct(force, (riesz * force).Evaluate())
    return np.sqrt(max(square, 0.0))
