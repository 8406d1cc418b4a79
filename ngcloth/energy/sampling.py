"""The sampling points, shape functions there, and matrices assembled from them."""

from copy import copy
from functools import cached_property

import ngsolve as ngs
import numpy as np
from ngsolve.comp import IntegrationRuleSpace, IntegrationRuleSpaceSurface

from ..geometry.sheet import mesh_points, planar_mesh

CORNERS = np.array([(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)])  # of NGSolve's reference triangle


class Points:
    """The integration points of a mesh: where limits hold, and over which all integrals are sums.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    degree : int
        Of the integration rule.

    Attributes
    ----------
    space : IntegrationRuleSpace
        Of fields of numbers at these points.
    dx : DifferentialSymbol
        The integral by this rule.
    """

    def __init__(self, mesh, degree):
        self._mesh, self._order, self._samples = mesh, (degree + 1) // 2, {}
        self.space = self._fields()
        self.dx = self._integral(self.space.GetIntegrationRules())
        self._number = self.space.ndof

    def _fields(self, **flags):
        return IntegrationRuleSpace(self._mesh, order=self._order, **flags)

    def _integral(self, rules):
        return ngs.dx(intrules=rules)

    def _interpolate(self, field, expression):
        field.Interpolate(expression)

    def __len__(self):
        return self._number

    def sample(self, expression):
        """Values of an expression, (components, points)."""
        n = expression.dim
        if n not in self._samples:  # all components in one pass, which a product of spaces is not
            samples = ngs.GridFunction(self._fields(dim=n))
            self._samples[n] = samples, samples.vec.FV().NumPy().reshape(-1, n)
        samples, numbers = self._samples[n]
        self._interpolate(samples, expression)
        return np.ascontiguousarray(numbers.T)

    def sample_surface(self, expression):
        """Values of an expression of the surface's own mesh, (components, points)."""
        return self.sample(expression)

    def field(self, values=0.0):
        """A field of one number at each point."""
        field = ngs.GridFunction(self.space)
        field.vec.FV().NumPy()[:] = values
        return field

    @cached_property
    def weights(self):
        """The weights of the rule in the parameter plane, (points,)."""
        form = ngs.LinearForm(self.space)
        form += self.space.TestFunction() * self.dx
        return form.Assemble().vec.FV().NumPy().copy()

    def shapes(self, space):
        """Derivatives of shape functions of an H1 space and their numbers, as of `Sampling`."""
        samples, triangles = self.space**2, space.mesh.ne
        trial, test = space.TrialFunction(), samples.TestFunction()
        form = ngs.BilinearForm(trialspace=space, testspace=samples)
        form += ngs.grad(trial) * test * self.dx
        entries, columns, _ = (part.NumPy() for part in form.Assemble().mat.CSR())
        weights = self.weights.reshape(triangles, -1, 1)
        at_one = weights.shape[1]
        shapes = entries.reshape(2, triangles, at_one, -1) / weights
        dofs = columns.reshape(2, triangles, at_one, -1)[0, :, 0].copy()  # not the form's memory
        return shapes.transpose(1, 0, 2, 3), dofs


class RimPoints(Points):
    """Points on the rim, seen from the triangles that touch it: limits hold there, too.

    Weights are of integrals along the rim.
    """

    @cached_property
    def triangles(self):
        """The numbers of the triangles at its edges, (edges,)."""
        return np.array([self._mesh[edge.edges[0]].elements[0].nr for edge in self._rim.Elements()])

    @property
    def _rim(self):
        return self._mesh.Boundaries("rim")

    def _fields(self, **flags):
        return IntegrationRuleSpaceSurface(
            self._mesh, order=self._order, definedon=self._rim, **flags
        )

    def _integral(self, rules):
        return ngs.ds(definedon=self._rim, intrules=rules)

    def _interpolate(self, field, expression):
        field.Interpolate(expression, definedon=self._rim)

    @property
    def seen(self):
        """The integral over the edges of all triangles, for fields of `on_edges`."""
        return ngs.dx(element_boundary=True, intrules=self.space.GetIntegrationRules())

    def on_edges(self):
        """Return a field on the edges of triangles, zero off the rim, and how to set it.

        An energy of ∇ψ on the rim is one over the edges of all triangles (`seen`), where fields of
        these points have no values: what is set there are polynomials that pass through them.
        """
        rule = self.space.GetIntegrationRules()[ngs.ET.SEGM]
        space = ngs.FacetFESpace(self._mesh, order=len(rule.weights) - 1)
        field, samples = ngs.GridFunction(space), self.field()
        trial, test = space.TnT()
        mass = ngs.BilinearForm(trial * test * self.dx).Assemble().mat
        invert = mass.Inverse(space.GetDofs(self._rim), inverse="sparsecholesky")
        load = ngs.LinearForm(samples * test * self.dx)

        def set_values(values):
            samples.vec.FV().NumPy()[:] = values
            field.vec.data = invert * load.Assemble().vec

        return field, set_values

    def shapes(self, space):
        """As of `Points`; with the edges on the rim, and the triangles there, for all triangles."""
        rule = self.space.GetIntegrationRules()[ngs.ET.SEGM]
        along = np.array(rule.points)[:, :1]
        shapes, dofs = [], []
        for edge, number in zip(self._rim.Elements(), self.triangles, strict=True):
            triangle = ngs.ElementId(ngs.VOL, int(number))
            corners = [vertex.nr for vertex in self._mesh[triangle].vertices]
            begin, end = (CORNERS[corners.index(vertex.nr)] for vertex in edge.vertices)
            element, map_to = space.GetFE(triangle), self._mesh.GetTrafo(triangle)
            mapped = [map_to(*point) for point in along * begin + (1 - along) * end]
            shapes.append([element.CalcDShape(at) for at in mapped])
            dofs.append(space.GetDofNrs(triangle))
        return np.array(shapes, dtype=float).transpose(0, 3, 1, 2), np.array(dofs)


class AddedPoints(Points):
    """Single points of triangles, at which limits are asked beside those of the rules.

    Fields of numbers live on a mesh of their own, one triangle about each point: NGSolve has none
    at some points of some triangles.

    Parameters
    ----------
    mesh : ngsolve.Mesh
    added : LimitPoints

    Attributes
    ----------
    triangles : ndarray, (points,)
        Their numbers.
    """

    def __init__(self, mesh, added):
        self.triangles, self._reference = added
        self._at = mesh_points(mesh, *added)
        (theta,) = np.array([ngs.CF((ngs.x, ngs.y))(self._at)])
        size = np.abs(theta).max(initial=1e-9)
        corners = (theta[:, None] + size * (CORNERS - CORNERS.mean(axis=0))).reshape(-1, 2)
        triangles = np.arange(len(corners)).reshape(-1, 3)
        no_edges = np.empty((0, 2), dtype=int), np.empty(0, dtype=str)
        super().__init__(planar_mesh(corners, triangles, *no_edges), 0)
        self._surface_mesh = mesh

    def sample_surface(self, expression):
        """Values of an expression of the surface's own mesh, (components, points)."""
        values = np.asarray(expression(self._at))
        return np.ascontiguousarray(values.reshape(len(self._at), -1).T)

    def shapes(self, space):
        """As of `Points`; with each point as a triangle of its own, that has it alone."""
        mesh, shapes, dofs = self._surface_mesh, [], []
        for triangle, reference in zip(self.triangles, self._reference, strict=True):
            number = ngs.ElementId(ngs.VOL, int(triangle))
            element, map_to = space.GetFE(number), mesh.GetTrafo(number)
            shapes.append(element.CalcDShape(map_to(*reference.tolist())))
            dofs.append(space.GetDofNrs(number))
        return np.array(shapes, dtype=float).transpose(0, 2, 1)[:, :, None], np.array(dofs)


class Sampling:
    """From scalar functions to their gradients at the sampling points, and transposed.

    Parameters
    ----------
    space : H1
        Of one order, on triangles.
    points : Points

    Attributes
    ----------
    shapes : ndarray, (triangles, 2, points of a triangle, dofs of a triangle)
        Derivatives of the shape functions.
    dofs : ndarray, (triangles, dofs of a triangle)
        Their numbers in `space`, ascending, so that all points of a triangle have the same.
    """

    def __init__(self, space, points):
        shapes, dofs = points.shapes(space)
        order = np.argsort(dofs, axis=1)
        self.dofs = np.take_along_axis(dofs, order, axis=1)
        self.shapes = np.take_along_axis(shapes, order[:, None, None], axis=3)
        self._ndof = space.ndof

    def flat(self, inverses):
        """The same with derivatives in the flat plane, given G⁻¹ at the points, (2, 2, points)."""
        triangles, _, at_one, _ = self.shapes.shape
        by_triangle = inverses.reshape(2, 2, triangles, at_one)
        flat = copy(self)
        flat.shapes = np.einsum("tmqa,mjtq->tjqa", self.shapes, by_triangle)
        return flat

    def at_points(self, functions):
        """Gradients, (functions, 2, points), of functions (functions, dofs)."""
        triangles, _, at_one, n = self.shapes.shape
        coefficients = np.asarray(functions)[:, self.dofs].transpose(1, 2, 0)
        samples = self.shapes.reshape(triangles, -1, n) @ coefficients
        samples = samples.reshape(triangles, 2, at_one, -1).transpose(3, 1, 0, 2)
        return samples.reshape(len(functions), 2, -1)

    def transposed(self, samples):
        """`at_points` transposed, from (functions, 2, points) to (functions, dofs)."""
        functions = len(samples)
        triangles, _, at_one, n = self.shapes.shape
        samples = samples.reshape(functions, 2, triangles, at_one).transpose(2, 1, 3, 0)
        shapes = self.shapes.reshape(triangles, -1, n).transpose(0, 2, 1)
        loads = shapes @ samples.reshape(triangles, -1, functions)
        numbers = self.dofs.ravel()
        return np.array(
            [np.bincount(numbers, load.ravel(), self._ndof) for load in np.moveaxis(loads, 2, 0)]
        )

    def blocks(self, tangent, left=None):
        """Matrices of the triangles for a symmetric bilinear form in gradients of two functions.

        Parameters
        ----------
        tangent : ndarray, (4, 4, points)
            The form at the points, its weights included; the derivatives of the first component
            of a function come before those of the second.
        left : Sampling, optional
            Of the functions that number the rows, by default those that number the columns.

        Returns
        -------
        ndarray, (triangles, 2 dofs of a triangle, 2 dofs of a triangle)
        """
        left, slopes = left or self, self.shapes
        triangles, _, at_one, n = slopes.shape
        tangent = tangent.reshape(2, 2, 2, 2, triangles, at_one)
        rows = left.shapes.reshape(triangles, 2 * at_one, -1).transpose(0, 2, 1)
        blocks = np.empty((triangles, 2, rows.shape[1], 2, n))
        for i, k in ((0, 0), (0, 1), (1, 1)) if left is self else np.ndindex(2, 2):
            scaled = np.einsum("jltq,tlqb->tjqb", tangent[i, :, k], slopes)
            blocks[:, i, :, k] = rows @ scaled.reshape(triangles, -1, n)
        if left is self:
            blocks[:, 1, :, 0] = blocks[:, 0, :, 1].transpose(0, 2, 1)
        return blocks.reshape(triangles, 2 * rows.shape[1], 2 * n)


def places(matrix, rows, columns):
    """Where the entries of matrices of the triangles are among those of a sparse matrix.

    Parameters
    ----------
    matrix : SparseMatrix
        With these entries among others.
    rows, columns : ndarray, (triangles, n)
        The numbers of the rows and columns of each.

    Returns
    -------
    ndarray, (triangles, rows, columns)
    """
    _, known, starts = (np.array(part, dtype=np.int64) for part in matrix.CSR())
    numbers = np.repeat(np.arange(matrix.height), np.diff(starts)) * matrix.width + known
    sought = rows[:, :, None].astype(np.int64) * matrix.width + columns[:, None, :]
    return np.searchsorted(numbers, sought.ravel()).reshape(sought.shape)
