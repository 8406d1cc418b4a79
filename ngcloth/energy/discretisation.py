"""A scene on a mesh: the compound H1 space, the state, and geometry as numbers."""

from functools import cached_property, wraps

import ngsolve as ngs
import numpy as np

from ..errors import InputError
from ..problem.constraints import LimitPoints
from ..problem.fabric import of_place
from ..problem.kinematics import gradient
from ..problem.warp import HeldDirection, HeldInverse
from .sampling import Points

FAR = 100  # sizes of the surface


def of_state(evaluate):
    """Make a method keep its last value, and return it for as long as `unknowns` are the same."""
    name = f"_kept_{evaluate.__name__}"

    @wraps(evaluate)
    def kept(self):
        now = self.unknowns.tobytes()  # compared faster than numbers are
        at, value = getattr(self, name, (None, None))
        if at != now:
            value = evaluate(self)
            setattr(self, name, (now, value))
        return value

    return kept


class Discretisation:
    """What all scenes need on a mesh.

    Parameters
    ----------
    scene : Scene
    sheet : Sheet
        The surface on the mesh, which is curved to `order` if it has curved edges.
    order : int
        Polynomial order of ψ.
    quadrature : int
        Degree of the integration rule, the same for every term and every feasibility check.
    inverse : str
        NGSolve's name of the direct solver.

    Attributes
    ----------
    state : GridFunction
        The current ψ.
    unknowns : ndarray, (dofs,)
        The numbers of `state`, in the memory of these.
    mu : float
        Weight of the term that the outer loop drives to zero.
    points : Points
        Where all integrals are sampled.
    free : BitArray
        The unknowns that move.
    area : float
        Of the surface over the mesh.
    flow : BaseMatrix
        Inner product of the gradient flow.
    held : HeldDirection or None
        The direction of the warp, if it is given.
    """

    limit_points = LimitPoints()  # of scenes with limits

    def __init__(self, scene, sheet, order, quadrature, inverse):
        self.scene, self.sheet, self.inverse, self.mu = scene, sheet, inverse, 0.0
        self.order = order
        mesh = sheet.mesh
        mirrors = ("mirror1", "mirror2") if scene.symmetric else ("", "")
        self.fes = ngs.FESpace(self._spaces(mesh, order, mirrors))
        self.state = ngs.GridFunction(self.fes, name="state")
        self.unknowns = self.state.vec.FV().NumPy()
        self.free = self._free_dofs()
        for component, value in zip(self._psi, scene.start_expression(), strict=True):
            component.Set(value)
        if scene.symmetric:
            # Set leaves its projection error on the mirror lines, where nothing would remove it.
            self.state.vec.data = ngs.Projector(self.free, True) * self.state.vec
        self.held = None  # mirrors hold the direction by themselves
        if scene.warp is not None and not scene.symmetric:
            self.held = HeldDirection(self.fes, sheet, scene.warp, scene.at)
        self.turn()

        self.points = Points(mesh, quadrature)
        # Geometry enters as numbers at the integration points, not as expressions of θ: any
        # chart then costs what the simplest one does.
        self._metric = self._frozen_symmetric(sheet.metric)
        self.area = ngs.Integrate(ngs.sqrt(ngs.Det(self._metric)) * self.points.dx, mesh)
        self.flow = self._h1_matrix(0)

    @property
    def adrift(self):
        """Whether ψ is far from where it began, in cloth that differs from place to place."""
        if self.scene.symmetric or not of_place(self.scene.fabric):
            return False
        return max(abs(part.vec.FV().NumPy()[0]) for part in self._psi) > FAR * np.sqrt(self.area)

    def turn(self):
        """Rotate ψ, where the direction of the warp is given, until it has that."""
        if self.held:
            self.held.turn(self._psi)

    def keeping(self, inverse):
        """The inverse of a matrix, among changes of ψ that keep the direction of the warp."""
        return HeldInverse(inverse, self.held.normal) if self.held else inverse

    def _spaces(self, mesh, order, mirrors):
        return [ngs.H1(mesh, order=order, dirichlet=line) for line in mirrors]

    @property
    def _psi(self):
        return self.state.components[:2]

    def _free_dofs(self):
        """All degrees of freedom but those on mirror lines; without mirrors, but one vertex.

        Energies do not change under translations of ψ, so holding one vertex takes nothing away,
        unless the fabric depends on the place.
        """
        free = ngs.BitArray(self.fes.FreeDofs())
        if not (self.scene.symmetric or of_place(self.scene.fabric)):
            free.Clear(self.fes.Range(0).start)
            free.Clear(self.fes.Range(1).start)
        return free

    def _frozen(self, *expressions, points=None):
        points = points or self.points
        values = points.sample_surface(ngs.CF(expressions).Compile())
        if not np.isfinite(values).all():
            allowed = "finite with its derivatives at all integration points"
            raise InputError("surface", self.scene.surface, allowed)
        return [points.field(row) for row in values]

    def _frozen_symmetric(self, tensor, points=None):
        t11, t12, t22 = self._frozen(tensor[0, 0], tensor[0, 1], tensor[1, 1], points=points)
        return ngs.CF((t11, t12, t12, t22), dims=(2, 2))

    @cached_property
    def _curvature(self):
        return self._frozen_symmetric(self.sheet.curvature)

    def _density(self, cloth):
        """What is minimised per flat area, over kc."""
        cost = self.scene.cost
        return cost(cloth) / self.scene.fabric.stiffness if cost else self._strain_energy(cloth)

    def _strain_energy(self, cloth):
        """W over kc."""
        return cloth.energy / self.scene.fabric.stiffness

    def _symbolic_energy(self, density):
        form = ngs.BilinearForm(self.fes, symmetric=True)
        form += ngs.Variation(density.Compile() * self.points.dx)
        return form

    def _h1_matrix(self, first):
        """The H¹ seminorm on the surface of the component `first` of the space and the next.

        ∫ √det a  a^{αβ} ∂αψ·∂βψ does not depend on the chart; where the chart is conformal it is
        the paper's ∫ ∇ψ:∇ψ (eq. 23).
        """
        weight = ngs.Cof(self._metric) / ngs.sqrt(ngs.Det(self._metric))
        form = ngs.BilinearForm(self.fes, symmetric=True)
        u, v = (gradient(*pair[first : first + 2]) for pair in self.fes.TnT())
        form += ngs.InnerProduct(u * weight, v) * self.points.dx
        return form.Assemble().mat
