"""The Lagrangian of a scene with limits by NGSolve's automatic linearisation alone."""

from functools import cached_property

import ngsolve as ngs
import numpy as np

from ..geometry.sheet import mesh_points
from ..problem.kinematics import gradient
from .constrained import ConstrainedLagrangian
from .discretisation import of_state


class AutomaticLagrangian(ConstrainedLagrangian):
    """What the loops ask of a `ConstrainedLagrangian`, from its `symbolic_energy` as it stands.

    NGSolve differentiates the whole density, twice, for each triangle anew: several times slower
    than `ClosedFormLagrangian`, and what that is held to.
    """

    def __init__(self, *arguments):
        super().__init__(*arguments)
        inside = [[self.points.field() for _ in range(3)] for _ in self.slack_names]
        on_rim = [[self.rim_points.on_edges() for _ in range(3)] for _ in self.slack_names]
        self._numbers, self._added = (inside, on_rim), []
        self._matrix = self.flow.CreateMatrix()
        self._state_lagrangian()

        cloth = self._cloth
        energy = cloth.jacobian * self._strain_energy(cloth)
        self._cost = (cloth.jacobian * self._density(cloth)).Compile()
        self._work = cloth.change(energy, *self.state.components[2:]).Compile()
        self._jacobian = cloth.jacobian.Compile()
        trial = self._kinematics(*self.fes.TrialFunction()[:2])
        self._cost_energy = self._symbolic_energy(trial.jacobian * self._density(trial))
        seconds = [w.Diff(i) for w in cloth.energy_slopes for i in (cloth.I4, cloth.I6, cloth.I8)]
        self._seconds = (ngs.CF(tuple(seconds)) / self.scene.fabric.stiffness).Compile()

    def slacks(self):
        """Values c of all slacks where limits are sampled, (slacks, points)."""
        return self._at_limits(self._slack_values)

    def slack_changes(self):
        """Derivatives of all slacks along ψ of `direction`, (slacks, points)."""
        return self._at_limits(self._slack_slopes)

    @of_state
    def cost(self):
        """What is minimised, E or the scene's own cost, over kc and the meshed domain."""
        return self.points.weights @ self.points.sample(self._cost)[0]

    def work(self):
        """DE(ψ)[v], over kc: zero in equilibrium."""
        return self.points.weights @ self.points.sample(self._work)[0]

    @of_state
    def least_jacobian(self):
        """The least J over all integration points; NaN if it is not finite somewhere."""
        return self.points.sample(self._jacobian).min()

    def stiffness(self):
        """The greatest derivative of the stress by C, over kc: the size of what couples ψ and v."""
        return max(np.abs(self.points.sample(self._seconds)).max(), 1.0)

    def gradient(self, z, out):
        """Write ∇E + ∇(dE[v]) − Σ z ∇c at the current state to the vector `out`."""
        self._freeze(z, np.zeros_like(z))
        self._lagrangian.Apply(self.state.vec, out)

    def multiplier_force(self, out):
        """Write dE(ψ), tested with v, to the vector `out`, whose part of ψ becomes zero."""
        self._lagrangian.Apply(self.state.vec, out)
        out.FV().NumPy()[self.psi_dofs] = 0

    def cost_gradient(self, out):
        """Write the derivative of `cost` to the vector `out`."""
        self._cost_energy.Apply(self.state.vec, out)

    def hessian(self, z, stiffness):
        """The second derivative of E + dE[v] − Σ z c + ½ Σ stiffness (c − c̄)², c̄ = c frozen."""
        self._freeze(z, stiffness)
        self._lagrangian.AssembleLinearization(self.state.vec)
        # Factors are of this matrix, and the Lagrangian is stated anew with every limit point.
        self._matrix.AsVector().data = self._lagrangian.mat.AsVector()
        return self._matrix

    # How it is put together ---------------------------------------------------------------

    def _state_lagrangian(self):
        inside, on_rim = self._numbers
        edges = [[field for field, _ in numbers] for numbers in on_rim]
        added = [each for each, _ in self._added]
        self._lagrangian = self.symbolic_energy(inside, edges, added)

    def _ask_at_limit_points(self):
        """State the Lagrangian anew, with a term for each place in the reference triangle."""
        triangles, reference = self.limit_points
        mesh, weights = self.sheet.mesh, self.weights[self.parts[2]]
        constants, self._added = ngs.L2(mesh, order=0), []
        for place in np.unique(reference, axis=0):
            there = np.flatnonzero((reference == place).all(axis=1))
            marked = ngs.BitArray(mesh.ne)
            marked[:] = False
            for number in triangles[there]:
                marked[int(number)] = True
            weight, *fields = (
                ngs.GridFunction(constants) for _ in range(1 + 3 * len(self.slack_names))
            )
            weight.vec.FV().NumPy()[triangles[there]] = weights[there]
            numbers = [fields[i : i + 3] for i in range(0, len(fields), 3)]
            self._added.append(((tuple(place), marked, weight, numbers), there))
        self._state_lagrangian()

    def _freeze(self, z, stiffness):
        """Set c̄ to the current slacks, z and k to these, (slacks, points)."""
        here, there = self._numbers
        inside, on_rim, added = self.parts
        for row, numbers in enumerate(zip(self.slacks(), z, stiffness, strict=True)):
            for field, (_, set_edges), values in zip(here[row], there[row], numbers, strict=True):
                field.vec.FV().NumPy()[:] = values[inside]
                set_edges(values[on_rim])
            for (*_, fields), which in self._added:
                for field, values in zip(fields[row], numbers, strict=True):
                    triangles = self.limit_points.triangles[which]
                    field.vec.FV().NumPy()[triangles] = values[added][which]

    def _at_limits(self, expressions):
        if not self.slack_names:
            return np.empty((0, len(self.weights)))
        inside, on_rim, anywhere = expressions
        values = [self.points.sample(inside), self.rim_points.sample(on_rim)]
        if len(self.limit_points.triangles):
            points = mesh_points(self.sheet.mesh, *self.limit_points)
            values.append(np.asarray(anywhere(points)).reshape(len(points), -1).T)
        return np.concatenate(values, axis=1)

    @cached_property
    def _slack_values(self):
        return self._compiled(lambda slack, slope: slack)

    @cached_property
    def _slack_slopes(self):
        change = gradient(*self.direction.components[:2])
        return self._compiled(lambda slack, slope: slack.Diff(slope, change))

    def _compiled(self, function):
        """A function of slacks and ∇ψ as expressions to sample: inside, on the rim, anywhere."""

        def compiled(cloth):
            values = (function(slack, cloth.gradient) for slack in self._slacks(cloth))
            return ngs.CF(tuple(values)).Compile()

        inside, anywhere = compiled(self._cloth), compiled(self._anywhere(*self._psi))
        return inside, ngs.BoundaryFromVolumeCF(anywhere), anywhere
