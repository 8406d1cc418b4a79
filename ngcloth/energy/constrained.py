"""The Lagrangian of a scene with limits: energy, equilibrium, and limits with their multipliers."""

from functools import cached_property
from itertools import pairwise

import ngsolve as ngs
import numpy as np

from ..geometry.sheet import mesh_points
from ..problem.constraints import RIM_SHARE, LimitPoints
from ..problem.kinematics import Kinematics, gradient
from .discretisation import Discretisation, of_state
from .sampling import CORNERS, RimPoints


class ConstrainedLagrangian(Discretisation):
    """L(ψ, v) = E(ψ) + dE(ψ)[v] − Σ ∫ z c dA over kc, eq. (22) in the flat plane.

    The second term is the change of the energy as ψ moves by v, which vanishes on the rim: the
    pinned cloth is in equilibrium where it is zero for all v (eq. 16, whose η is that sliding seen
    on the surface, v = ∇ψ·η). The third holds the multipliers z of every slack c of the scene's
    limits, which the barrier makes μ/c. A scene's own cost takes the place of E in the first.

    `symbolic_energy` states all of it, and is the definition. How its value and derivatives are
    found is left to `AutomaticLagrangian` and `ClosedFormLagrangian`.

    The limits hold at points on the rim as well as inside. Where threads are taut there, and limits
    are not, the energy is too small by what the cloth gains between the rim and the first points
    inside: an error of first order in the size of the triangles. What they miss between all these
    points, single ones make up for: see `add_limit_points`.

    Parameters
    ----------
    multiplier_order : int
        Polynomial order of v.

    Others as for `Discretisation`.

    Attributes
    ----------
    multiplier_flow : BaseMatrix
        As `flow`, for v.
    weights : ndarray, (points,)
        With which the points at which limits are sampled count in barriers: those inside, where
        sums are integrals over the surface, those on the rim, and those that were added.
    parts : list of slice
        Which of these points are inside, on the rim, and added.
    limit_points : LimitPoints
        Those that were added, none at first.
    slack_names : list of str
        The limit to which each slack belongs.
    rim_points : RimPoints
        In scenes with limits.
    psi_dofs : slice
        Where the unknowns of ψ are in `state`; those of v follow.
    multipliers : int
        How many unknowns of v move.
    direction : GridFunction
        A change of `state`, for `slack_changes`.
    """

    def __init__(self, scene, sheet, order, quadrature, inverse, multiplier_order):
        self._multiplier_order = multiplier_order
        super().__init__(scene, sheet, order, quadrature, inverse)
        self.direction = ngs.GridFunction(self.fes)
        surface_area = self.points.sample(ngs.sqrt(ngs.Det(self._metric)))[0]
        self.weights = self.points.weights * surface_area
        self.slack_names = [
            limit.name for limit in scene.constraints for _ in limit.slacks(self._cloth)
        ]
        if self.slack_names:
            self.rim_points = RimPoints(sheet.mesh, quadrature)
            metric = ngs.BoundaryFromVolumeCF(sheet.metric)
            length = self.rim_points.weights * self.rim_points.sample(_stretch_along_rim(metric))[0]
            self._rim_share = RIM_SHARE * self.area / length.sum()
            self.weights = np.concatenate([self.weights, self._rim_share * length])
        self._rule_weights = self.weights

        self.psi_dofs = slice(0, self.fes.Range(1).stop)
        self.multiplier_flow = self._h1_matrix(2)
        psi, v = self._free_parts()
        self.multipliers = v.NumSet()
        self._riesz = self.flow.Inverse(psi, inverse="sparsecholesky")
        self._psi_riesz = self.keeping(self._riesz)
        self._v_riesz = self.multiplier_flow.Inverse(v, inverse="sparsecholesky")
        self._force, self._rest = (self.state.vec.CreateVector() for _ in range(2))

    @property
    def parts(self):  # noqa: D102
        ends = 0, len(self.points), len(self._rule_weights), len(self.weights)
        return [slice(*pair) for pair in pairwise(ends)]

    def add_limit_points(self, added):
        """Ask limits at more points, which come last and in this order; those it has are left out.

        Parameters
        ----------
        added : LimitPoints
            In any order.

        Notes
        -----
        In barriers a point counts as the mean one of the rule in its triangle does.
        """
        known, self.limit_points = self.limit_points, self.limit_points.joined(added)
        if len(known.triangles) == len(self.limit_points.triangles):
            return
        inside = self.weights[self.parts[0]].reshape(self.sheet.mesh.ne, -1).mean(axis=1)
        weights = inside[self.limit_points.triangles]
        self.weights = np.concatenate([self._rule_weights, weights])
        self._ask_at_limit_points()

    def rim_vertices(self):
        """The corners on the rim of all triangles, `LimitPoints`.

        Triangles that touch the rim in one point have no edge there whose points would be asked.
        """
        mesh = self.sheet.mesh
        on_rim = {vertex for edge in mesh.Boundaries("rim").Elements() for vertex in edge.vertices}
        corners = [
            (element.nr, at)
            for element in mesh.Elements()
            for vertex, at in zip(element.vertices, CORNERS, strict=True)
            if vertex in on_rim
        ]
        triangles, reference = zip(*corners, strict=True)
        return LimitPoints(np.array(triangles), np.array(reference))

    def slacks_at(self, points):
        """Values of all slacks, and what counts as one in each, (slacks, points).

        Of limits that do not tell, that is what a strain of one changes it by; infinite where that
        is nothing, since nothing would make up for such a slack.

        Parameters
        ----------
        points : LimitPoints
            Anywhere.
        """
        at = mesh_points(self.sheet.mesh, *points)
        slacks, scales = self._anywhere_expressions
        values = np.asarray(slacks(at)).reshape(len(at), -1).T
        sizes = np.ones_like(values)
        for size, row, scale in zip(sizes, values, scales, strict=True):
            size[:] = scale(row, at)
        return values, np.where(sizes > 0, sizes, np.inf)

    def symbolic_energy(self, inside, on_rim, added=()):
        """The Lagrangian as one `SymbolicEnergy` of ψ and v.

        Each limit is −z c + ½ k (c − c̄)², whose Hessian at c = c̄ is that of an interior point with
        slack variables s, k = z/s.

        Parameters
        ----------
        inside, on_rim : list of (c̄, z, k)
            Fields of these numbers for each slack, at the points inside and on the rim.
        added : list of (reference, triangles, weights, list of (c̄, z, k)), optional
            Points that were added, by their place in the reference triangle: coordinates, a
            BitArray, and fields of numbers on these triangles.

        Returns
        -------
        BilinearForm
        """
        trial = self.fes.TrialFunction()
        cloth = self._kinematics(*trial[:2])
        energy = cloth.jacobian * self._strain_energy(cloth)
        work = cloth.change(energy, *trial[2:])  # dE[v]
        density = cloth.jacobian * self._density(cloth) + work
        density += self._surface_area * sum(map(_limit, self._slacks(cloth), inside), ngs.CF(0.0))
        lagrangian = self._symbolic_energy(density)
        if self.slack_names:
            slacks = self._slacks(self._anywhere(*trial[:2]))
            at_rim = sum(map(_limit, slacks, on_rim), ngs.CF(0.0))
            at_rim *= self._rim_share * _stretch_along_rim(self.sheet.metric)
            lagrangian += ngs.Variation(at_rim.Compile() * self.rim_points.seen)
        slacks = self._slacks(self._anywhere(*trial[:2])) if added else ()
        for reference, triangles, weights, numbers in added:
            rule = {ngs.ET.TRIG: ngs.IntegrationRule([reference], [1.0])}
            at_points = weights * sum(map(_limit, slacks, numbers), ngs.CF(0.0))
            at_points /= ngs.Det(ngs.specialcf.JacobianMatrix(2))
            dx = ngs.dx(definedonelements=triangles, intrules=rule)
            lagrangian += ngs.Variation(at_points.Compile() * dx)
        return lagrangian

    # What the loop asks -------------------------------------------------------------------

    def rigid_step(self):
        """Move ψ to where ∇ψ is nearest to R √a, R being the rotation now nearest to ∇ψ √a⁻¹.

        This is a step to the flattening as rigid as possible of Liu et al. (2008): the mean of
        |∇ψ √a⁻¹ − R|² over the surface falls with each.
        """
        self._rest.data = self._rigid.Assemble().vec - self.flow * self.state.vec
        self.state.vec.data += self._riesz * self._rest
        self.turn()

    def take(self, coarse):
        """Interpolate ψ and v from the state of a coarser mesh. Returns whether J > 0."""
        for component, from_coarse in zip(self.state.components, coarse.components, strict=True):
            component.Set(from_coarse)
        self.state.vec.data = ngs.Projector(self.fes.FreeDofs(), True) * self.state.vec
        self.turn()
        return self.least_jacobian() > 0

    @of_state
    def imbalance(self):
        """Dual norm of the in-plane force on the cloth inside the rim."""
        self.multiplier_force(self._force)
        return _dual_norm(self._force, self._v_riesz)

    def stationarity(self, z):
        """Dual norm of the derivative by ψ of the Lagrangian with these multipliers z."""
        self.gradient(z, self._force)
        return _dual_norm(self._force, self._psi_riesz)

    def dual_norm(self, force):
        """The norm of a derivative, dual to the H¹ seminorm on the surface."""
        return np.hypot(*(_dual_norm(force, riesz) for riesz in (self._psi_riesz, self._v_riesz)))

    # How it is put together ---------------------------------------------------------------

    @cached_property
    def _rigid(self):
        """∫ R √a a⁻¹ : ∇w dA at the current ψ, a linear form."""
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
        """The unknowns that move, of ψ and of v."""
        psi, v = ngs.BitArray(self.free), ngs.BitArray(self.free)
        psi[self.psi_dofs.stop :] = v[self.psi_dofs] = False
        return psi, v

    def _spaces(self, mesh, order, mirrors):
        rims = [f"rim|{line}" if line else "rim" for line in mirrors]
        v = [ngs.H1(mesh, order=self._multiplier_order, dirichlet=rim) for rim in rims]
        return super()._spaces(mesh, order, mirrors) + v

    def _kinematics(self, *psi):
        tensors = self._metric, self.scene.fabric, lambda: self._curvature
        return Kinematics(gradient(*psi), *tensors, psi)

    @cached_property
    def _cloth(self):
        """The cloth of the current ψ."""
        return self._kinematics(*self._psi)

    @cached_property
    def _surface_area(self):
        (area,) = self._frozen(ngs.sqrt(ngs.Det(self._metric)))
        return area

    def _slacks(self, cloth):
        return [slack for limit in self.scene.constraints for slack in limit.slacks(cloth)]

    @cached_property
    def _anywhere_expressions(self):
        """All slacks; and of each a function of its values and points: what counts as one."""
        cloth, slacks, scales = self._anywhere(*self._psi), [], []
        for limit in self.scene.constraints:
            for slack in limit.slacks(cloth):
                slacks.append(slack)
                scales.append(_scale(limit, slack, cloth.gradient))
        return ngs.CF(tuple(slacks)).Compile(), scales

    def _anywhere(self, psi1, psi2):
        """The cloth off the integration points, where geometry enters as expressions."""
        sheet = self.sheet
        tensors = sheet.metric, self.scene.fabric, lambda: sheet.curvature
        return Kinematics(gradient(psi1, psi2), *tensors, (psi1, psi2))


def _stretch_along_rim(metric):
    """Length on the surface over length in the parameter plane."""
    along = ngs.specialcf.tangential(2)
    return ngs.sqrt(ngs.InnerProduct(metric * along, along))


def _scale(limit, slack, slope):
    if hasattr(limit, "scale"):
        return lambda values, at: limit.scale(values)
    strain = ngs.Norm(slack.Diff(slope) * slope.trans).Compile()
    return lambda values, at: np.asarray(strain(at)).ravel()


def _limit(slack, numbers):
    c, z, k = numbers
    return -z * slack + k / 2 * (slack - c) ** 2


def _dual_norm(force, riesz):
    square = ngs.InnerProduct(force, (riesz * force).Evaluate())
    return np.sqrt(max(square, 0.0))
