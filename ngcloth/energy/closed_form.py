"""The Lagrangian of a scene with limits from numbers at the sampling points: the fast way."""

from functools import cached_property

import ngsolve as ngs
import numpy as np

from .constrained import ConstrainedLagrangian
from .discretisation import of_state
from .sampled_cloth import SampledCloth, SampledExpressions
from .sampled_limits import SampledLimits
from .sampling import AddedPoints, Sampling, places
from .strain_energy import UNIT, StrainEnergy, of_flat_area


class ClosedFormLagrangian(ConstrainedLagrangian):
    """What the loops ask of a `ConstrainedLagrangian`, assembled from short expressions.

    It depends on ∇ψ through C, G⁻ᵀ b G⁻¹ and G alone, whose derivatives are closed forms, and on ∇v
    linearly. To rounding these are the numbers of the automatic linearisation, which evaluates the
    whole density for each pair of the eight derivatives of ψ and v, in a fraction of the time.
    """

    def __init__(self, *arguments):
        super().__init__(*arguments)
        scene, (psi, _, v, _) = self.scene, self.fes.components
        tensors = self._metric, scene.fabric, lambda: self._curvature
        self._here = SampledCloth(self.state, Sampling(psi, self.points), self.points, *tensors)
        same = v.globalorder == psi.globalorder
        self._v = self._here.psi if same else Sampling(v, self.points)
        self._strain = StrainEnergy(self._here, scene.fabric, self._v)
        if scene.cost:
            self._own_cost = SampledExpressions(self._here, [self._density(self._here)])
        self._flat_weights, area = self.points.weights, self.weights[: len(self.points)]
        self._limits = [SampledLimits(self._here, self._slacks(self._here), area)]
        self._matrix = self.flow.CreateMatrix()
        if self.slack_names:
            self._limits.append(self._limits_at(self.rim_points, self.parts[1]))
        self._places = self._places_of_blocks()

    def slacks(self):
        """Values c of all slacks where limits are sampled, (slacks, points)."""
        return np.concatenate([limits.values() for limits in self._limits], axis=1)

    def slack_changes(self):
        """Derivatives of all slacks along ψ of `direction`, (slacks, points)."""
        direction = self.direction.vec.FV().NumPy()[self.psi_dofs]
        return np.concatenate([limits.changes(direction) for limits in self._limits], axis=1)

    @of_state
    def cost(self):
        """What is minimised, E or the scene's own cost, over kc and the meshed domain."""
        density = self._own_cost.values()[0] if self.scene.cost else self._strain.density()
        return self._flat_weights @ (self._here.jacobians() * density)

    def work(self):
        """DE(ψ)[v], over kc: zero in equilibrium."""
        return self._flat_weights @ (self._here.jacobians() * self._strain.work())

    @of_state
    def least_jacobian(self):
        """The least J over all integration points; NaN if it is not finite somewhere."""
        return self._here.jacobians().min()

    def stiffness(self):
        """The greatest derivative of the stress by C, over kc: the size of what couples ψ and v."""
        return max(self._strain.stiffness(), 1.0)

    def gradient(self, z, out):
        """Write ∇E + ∇(dE[v]) − Σ z ∇c at the current state to the vector `out`.

        Parameters
        ----------
        z : ndarray, (slacks, points)
            The multipliers of the limits.
        out : BaseVector
            Of the unknowns of `state`.
        """
        force = self._psi_force() + sum(limits.loads(part) for limits, part in self._by_place(z))
        out.FV().NumPy()[:] = np.concatenate([force, self._multiplier_force()])

    def multiplier_force(self, out):
        """Write dE(ψ), tested with v, to the vector `out`, whose part of ψ becomes zero."""
        out[:] = 0
        out.FV().NumPy()[self.psi_dofs.stop :] = self._multiplier_force()

    def cost_gradient(self, out):
        """Write the derivative of `cost` to the vector `out`."""
        out[:] = 0
        out.FV().NumPy()[self.psi_dofs] = self._loads(self._cost_slopes())

    def hessian(self, z, stiffness):
        """The second derivative of E + dE[v] − Σ z c + ½ Σ stiffness (c − c̄)², c̄ = c frozen.

        The matrix is assembled anew at each call, into the same memory.

        Parameters
        ----------
        z, stiffness : ndarray, (slacks, points)
            The multipliers of the limits, and the weights of ∇c ∇cᵀ.

        Returns
        -------
        BaseMatrix
        """
        inside, *others = self._by_place(z, stiffness)
        tangent = self._measure() * (self._cost_tangent() + self._strain.work_tangent())
        tangent += inside[0].tangent(*inside[1:])
        coupling = self._measure() * self._strain.tangent()
        blocks = [
            self._here.flat().blocks(tangent),
            *(limits.cloth.flat().blocks(limits.tangent(*values)) for limits, *values in others),
            self._here.flat().blocks(coupling, self._strain.flat_v()),
        ]
        blocks.append(blocks[-1].transpose(0, 2, 1))
        entries = self._matrix.AsVector().FV().NumPy()
        values = np.concatenate([block.ravel() for block in blocks])
        entries[:] = np.bincount(self._places, values, len(entries))
        return self._matrix

    # How it is put together ---------------------------------------------------------------

    def _ask_at_limit_points(self):
        points = AddedPoints(self.sheet.mesh, self.limit_points)
        self._limits[2:] = [self._limits_at(points, self.parts[2])]
        self._places = self._places_of_blocks()

    def _limits_at(self, points, part):
        sheet = self.sheet

        def frozen(tensor):
            on_rim = points is self.rim_points
            tensor = ngs.BoundaryFromVolumeCF(tensor) if on_rim else tensor
            return self._frozen_symmetric(tensor, points)

        tensors = frozen(sheet.metric), self.scene.fabric, lambda: frozen(sheet.curvature)
        sampling = Sampling(self.fes.components[0], points)
        cloth = SampledCloth(self.state, sampling, points, *tensors)
        return SampledLimits(cloth, self._slacks(cloth), self.weights[part])

    def _by_place(self, *values):
        """The limits of each family of points, with its part of values (slacks, points)."""
        return [
            (limits, *(value[:, part] for value in values))
            for limits, part in zip(self._limits, self.parts, strict=False)
        ]

    def _measure(self):
        """Flat area, with the weights of the points."""
        return self._flat_weights * self._here.jacobians()

    def _cost_slopes(self):
        """Derivatives of J times what is minimised, over J, (4, points)."""
        if not self.scene.cost:
            return self._strain.stress()
        return self._own_cost.values() * UNIT + self._own_cost.slopes()[0]

    def _cost_tangent(self):
        """Second derivatives of J times what is minimised, over J, (4, 4, points)."""
        if not self.scene.cost:
            return self._strain.tangent()
        own = self._own_cost
        bend = own.bend(np.ones((1, len(self.points))))
        return of_flat_area(own.values()[0], own.slopes()[0]) + bend

    @of_state
    def _psi_force(self):
        """Derivatives of E and dE[v] by ψ, (dofs of ψ,)."""
        return self._loads(self._cost_slopes() + self._strain.work_slopes())

    @of_state
    def _multiplier_force(self):
        """dE(ψ), (dofs of v,)."""
        stress = self._measure() * self._strain.stress()
        return self._strain.flat_v().transposed(stress.reshape(2, 2, -1)).ravel()

    def _loads(self, slopes):
        """The forces on ψ, (dofs of ψ,), of what acts on Y per flat area, (4, points)."""
        loads = self._measure() * slopes
        return self._here.flat().transposed(loads.reshape(2, 2, -1)).ravel()

    def _places_of_blocks(self):
        """Where in the matrix the blocks of ψ and ψ, v and ψ, ψ and v of all triangles belong."""
        psi, v_and_psi, psi_and_v = self._places_by_triangle
        others = [psi[limits.cloth.points.triangles] for limits in self._limits[1:]]
        return np.concatenate([part.ravel() for part in (psi, *others, v_and_psi, psi_and_v)])

    @cached_property
    def _places_by_triangle(self):
        """The same for each triangle, (triangles, rows, columns)."""

        def numbers(components, dofs):
            return np.concatenate([self.fes.Range(i).start + dofs for i in components], axis=1)

        psi, v = numbers((0, 1), self._here.psi.dofs), numbers((2, 3), self._v.dofs)
        return [places(self._matrix, *pair) for pair in ((psi, psi), (v, psi), (psi, v))]
