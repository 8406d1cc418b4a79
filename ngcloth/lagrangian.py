"""A scene on a mesh: the compound H1 space, and the energies that this scene needs."""

from functools import wraps

import ngsolve as ngs
import numpy as np
from ngsolve.comp import IntegrationRuleSpace

from .errors import InputError
from .kinematics import Kinematics, gradient

BENDING = 1e-2  # its weight in `_uneven_bending`


def of_state(evaluate):
    """Make a method keep its last value, and return it for as long as `self.state` is the same."""
    name = f"_kept_{evaluate.__name__}"

    @wraps(evaluate)
    def kept(self):
        state = self.state.vec.FV().NumPy()
        at, value = getattr(self, name, (None, None))
        if at is None or not np.array_equal(at, state):
            value = evaluate(self)
            setattr(self, name, (state.copy(), value))
        return value

    return kept


class Lagrangian:
    """The Lagrangian of a scene (eq. 22) as an NGSolve `SymbolicEnergy`, divided by kc.

    Parameters
    ----------
    scene : Scene
    mesh : ngsolve.Mesh
        Curved to `order`.
    order : int
        Polynomial order of ψ.
    quadrature : int
        Degree of the integration rule, the same for every term and every feasibility check.
    inverse : str
        NGSolve's name of the direct solver.
    gauss_newton : bool
        Whether `hessian` is the Gauss-Newton matrix of a Chebyshev scene, unless asked otherwise.

    Attributes
    ----------
    state : GridFunction
        The current ψ.
    mu : float
        Weight of the term that the outer loop drives to zero.
    flow : BaseMatrix
        Inner product of the gradient flow.
    """

    def __init__(self, scene, mesh, order, quadrature, inverse, gauss_newton):
        self.scene, self.inverse, self.mu = scene, inverse, 0.0
        mirrors = ("mirror1", "mirror2") if scene.symmetric else ("", "")
        self.fes = ngs.FESpace(self._spaces(mesh, order, mirrors))
        self.state = ngs.GridFunction(self.fes, name="state")
        self.free = self._free_dofs()
        for component, value in zip(self._psi, scene.start_expression(), strict=True):
            component.Set(value)
        if scene.symmetric:
            # Set leaves its projection error on the mirror lines, where nothing would remove it.
            self.state.vec.data = ngs.Projector(self.free, True) * self.state.vec

        self.points = IntegrationRuleSpace(mesh, order=(quadrature + 1) // 2)
        self._dx = ngs.dx(intrules=self.points.GetIntegrationRules())
        # Geometry enters as numbers at the integration points, not as expressions of θ: any
        # chart then costs what the simplest one does.
        self._metric = self._frozen_symmetric(scene.surface.metric)
        self.area = ngs.Integrate(ngs.sqrt(ngs.Det(self._metric)) * self._dx, mesh)
        self.flow = self._h1_matrix({0: ngs.Id(2)})

        here = self._kinematics(self.state.components)
        self._jacobian, self._shear = here.jacobian.Compile(), here.shear.Compile()
        self._stretches = here.stretch1.Compile(), here.stretch2.Compile()
        self._probe = ngs.GridFunction(self.points)

        cloth = self._kinematics(self.fes.TrialFunction())
        self._energy = self._symbolic_energy(cloth.jacobian * self._density(cloth))
        self._model, self.gauss_newton = self._energy, gauss_newton
        if gauss_newton:
            self._squares = self._sum_of_squares(cloth, here)
        self._tie_break = _uneven_bending(self.fes) if scene.tie_break else None

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
        model = self._model
        if self.gauss_newton and not exact:
            model = self._squares
            for field, expression in self._roots:
                field.Interpolate(expression)
        model.AssembleLinearization(self.state.vec)
        matrix = model.mat
        if self._tie_break is not None:
            matrix.AsVector().data += self.mu * self._tie_break.AsVector()
        return matrix

    @of_state
    def least_jacobian(self):
        """The least J over all integration points; NaN if it is not finite somewhere."""
        self._probe.Interpolate(self._jacobian)
        return self._probe.vec.FV().NumPy().min()

    def largest_shear(self):
        """The largest |γ| over all integration points."""
        self._probe.Interpolate(self._shear)
        return np.abs(self._probe.vec.FV().NumPy()).max()

    def largest_strain(self):
        """The largest |λ − 1| of both threads over all integration points."""
        largest = 0.0
        for stretch in self._stretches:
            self._probe.Interpolate(stretch)
            largest = max(largest, np.abs(self._probe.vec.FV().NumPy() - 1).max())
        return largest

    # How it is put together ---------------------------------------------------------------

    def _spaces(self, mesh, order, mirrors):
        return [ngs.H1(mesh, order=order, dirichlet=line) for line in mirrors]

    @property
    def _psi(self):
        return self.state.components[:2]

    def _kinematics(self, components):
        return Kinematics(gradient(*components[:2]), self._metric)

    def _free_dofs(self):
        """All degrees of freedom but those on mirror lines; without mirrors, but one vertex.

        Energies do not change under translations of ψ, so holding one vertex takes nothing away.
        """
        free = ngs.BitArray(self.fes.FreeDofs())
        if not self.scene.symmetric:
            free.Clear(self.fes.Range(0).start)
            free.Clear(self.fes.Range(1).start)
        return free

    def _frozen(self, expression):
        values = ngs.GridFunction(self.points)
        values.Interpolate(expression.Compile())
        if not np.isfinite(values.vec.FV().NumPy()).all():
            allowed = "finite with its derivatives at all integration points"
            raise InputError("chart", self.scene.surface.chart, allowed)
        return values

    def _frozen_symmetric(self, tensor):
        t11, t12, t22 = (self._frozen(tensor[i]) for i in ((0, 0), (0, 1), (1, 1)))
        return ngs.CF((t11, t12, t12, t22), dims=(2, 2))

    def _density(self, cloth):
        fabric, cost = self.scene.fabric, self.scene.cost
        density = fabric.energy(cloth.I4, cloth.I6, cloth.I8) if cost is None else cost(cloth)
        return density / fabric.stiffness

    def _symbolic_energy(self, density):
        form = ngs.BilinearForm(self.fes, symmetric=True)
        form += ngs.Variation(density.Compile() * self._dx)
        return form

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

        self._roots = [(ngs.GridFunction(self.points), root.Compile()) for root in roots(here)]
        squares = [
            (r - frozen) ** 2 for r, (frozen, _) in zip(roots(cloth), self._roots, strict=True)
        ]
        return self._symbolic_energy(sum(squares[1:], squares[0]))

    def _h1_matrix(self, products):
        """The H¹ seminorm on the surface of pairs of components of the space.

        ∫ √det a  a^{αβ} ∂αψ·∂βψ does not depend on the chart; where the chart is conformal it is
        the paper's ∫ ∇ψ:∇ψ (eq. 23). `products` has the inner product (2, 2) of each pair, by the
        number of its first component.
        """
        weight = ngs.Cof(self._metric) / ngs.sqrt(ngs.Det(self._metric))
        trial, test = self.fes.TnT()
        form = ngs.BilinearForm(self.fes, symmetric=True)
        for i, product in products.items():
            u, v = (gradient(*pair[i : i + 2]) for pair in (trial, test))
            form += ngs.InnerProduct(product * u * weight, v) * self._dx
        return form.Assemble().mat


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
