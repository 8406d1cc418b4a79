"""The patch of a result as polynomials on triangles, and the cloth at points of them as numbers."""

from functools import cached_property

import ngsolve as ngs
import numpy as np

from ..problem.constraints import RIM_SHARE
from ..problem.fabric import of_curvature, of_place
from ..problem.kinematics import Kinematics
from . import bernstein, changes
from .elements import SIDES, Triangles
from .numbers import Numbers

LITTLE = 1e-2  # of the mean square of a change of ψ, over the area, in a norm
CORNERS = np.array([(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)])


class Patch:
    """ψ on its triangles, by Bernstein coefficients.

    Attributes
    ----------
    psi : ndarray, (triangles, 2, n)
    order : int
        Of ψ.
    triangles : Triangles
    """

    def __init__(self, result):
        self.scene, self.sheet = result.scene, result.sheet
        self.order, self.degree = result.settings["order"], result.settings["quadrature"]
        self.triangles = Triangles(result.state.space.mesh)
        points = self.triangles.at_lattice(self.order)
        values = ngs.CF(tuple(result.state.components[:2]))(points)
        values = values.reshape(len(self.triangles), -1, 2).swapaxes(1, 2)
        self.psi = values @ bernstein.fit(self.order).T
        self._added = result.limit_points

    @cached_property
    def inside(self):
        """The points of the solver's rule, over which its integrals are sums."""
        return self.by_rule(self.degree)

    def by_rule(self, degree):
        """The points of a rule of this degree, or the next even one, in all triangles."""
        rule = ngs.IntegrationRule(ngs.TRIG, self._even(degree))
        numbers = np.arange(len(self.triangles))
        shape = len(numbers), len(rule.points)
        reference = np.broadcast_to(np.array(rule.points)[:, :2], (*shape, 2))
        return Points(self, numbers, reference, np.broadcast_to(rule.weights, shape))

    @cached_property
    def beside(self):
        """Where limits hold beside `inside`: points of a rule along the rim, and those added.

        Weights are those of barriers: `RIM_SHARE` of the area along the rim, and that of a mean
        point of the triangle at points that the solve added, `Result.limit_points`.
        """
        rule = ngs.IntegrationRule(ngs.SEGM, self._even(self.degree))
        triangles, number = self.triangles.touching(self.triangles.boundary("rim"))
        along = np.array(rule.points)[:, :1]
        begin, end = CORNERS[np.array(SIDES)[number]].swapaxes(0, 1)[:, :, None]
        reference = (begin + along * (end - begin)).reshape(-1, 2)
        rim = len(reference)
        numbers, added = self._added
        numbers = np.concatenate([np.repeat(triangles, len(along)), numbers])
        points = Points(self, numbers, np.concatenate([reference, added])[:, None], None)
        sides = np.zeros((len(numbers), 2))
        sides[:rim] = np.repeat((end - begin)[:, 0], len(along), axis=0)
        lengths = points.lengths(sides)[:rim] * np.tile(rule.weights, len(triangles))
        areas = self.inside.areas()
        share = RIM_SHARE * areas.sum() / lengths.sum() * lengths
        mean = areas.mean(axis=1)[numbers[rim:]]
        points.weights = np.concatenate([share, mean])[:, None]
        return points

    @staticmethod
    def _even(degree):
        return 2 * ((degree + 1) // 2)


class Points:
    """The cloth at points of triangles, in groups of the same triangle.

    Where the axes are not named (groups, points), numbers are by point, (n, …).

    Parameters
    ----------
    patch : Patch
    triangles : ndarray, (groups,)
    reference : ndarray, (groups, points, 2)
    weights : ndarray, (groups, points)
        Of integrals over the reference triangle.
    """

    def __init__(self, patch, triangles, reference, weights):
        self.patch, self.triangles = patch, triangles
        self.reference, self.weights = reference, weights
        self._shapes, self._placed = {}, of_place(patch.scene.fabric)
        numbers = np.repeat(triangles, reference.shape[1])
        self.mapped = patch.triangles.mapped(numbers, reference.reshape(-1, 2))
        expressions = ngs.CF((ngs.x, ngs.y, ngs.specialcf.JacobianMatrix(2))).Compile()
        values = expressions(self.mapped)
        self.theta, element = values[:, :2], values[:, 2:].reshape(-1, 2, 2)
        slopes = np.einsum(
            "gpxn,gin->gpix", self._reference_shapes(patch.order), patch.psi[triangles]
        ).reshape(-1, 2, 2)
        self._to_flat = _inverse(slopes)
        self.gradient = slopes @ _inverse(element)  # G
        self._from_chart = element @ self._to_flat  # G⁻¹
        self.jacobian = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]

    @property
    def shape(self):
        """(groups, points)."""
        return self.reference.shape[:2]

    def _reference_shapes(self, order):
        one = self.reference if self.reference.strides[0] else self.reference[:1]
        shapes = bernstein.slopes(order, one)
        return np.broadcast_to(shapes, (*self.shape, *shapes.shape[2:]))

    def functions_of(self, order):
        """Functions of an order, (groups, points, n)."""
        return bernstein.basis(order, self.reference)

    def shapes(self, order):
        """Their derivatives in the flat plane, (groups, points, 2, n); their values, if felt."""
        if order not in self._shapes:
            to_flat = self._to_flat.reshape(*self.shape, 2, 2).swapaxes(2, 3)
            shapes = to_flat @ self._reference_shapes(order)
            if self._placed:
                functions = self.functions_of(order)
                functions = np.broadcast_to(functions, (*self.shape, functions.shape[-1]))
                shapes = np.concatenate([shapes, functions[:, :, None]], axis=2)
            self._shapes[order] = shapes
        return self._shapes[order]

    def gradients(self, order, coefficients):
        """Z of two functions given by coefficients (groups, 2, n): (n, 4)."""
        shapes = self.shapes(order).swapaxes(2, 3)
        return (coefficients[:, None] @ shapes).reshape(-1, 2 * shapes.shape[-1])

    def loads(self, order, slopes):
        """Vectors of the groups, (groups, 2 n), of a form by Z, (n, 4), weights included."""
        shapes, groups = self.shapes(order), len(self.triangles)
        slopes = slopes.reshape(*self.shape, 2, -1).swapaxes(1, 2).reshape(groups, 2, -1)
        return (slopes @ shapes.reshape(groups, -1, shapes.shape[-1])).reshape(groups, -1)

    def blocks(self, left, right, tangent):
        """Matrices of the groups, of a form by Z of pairs of functions of two orders.

        Parameters
        ----------
        left, right : int
            The orders.
        tangent : ndarray, (n, 4, 4)
            Weights included.

        Returns
        -------
        ndarray, (groups, 2 n of the left, 2 n of the right)
        """
        groups, points = self.shape
        rows, columns = self.shapes(left), self.shapes(right)
        (parts, m), n = rows.shape[-2:], columns.shape[-1]
        rows = rows.reshape(groups, parts * points, m).swapaxes(1, 2)
        tangent = tangent.reshape(groups, points, 2, parts, 2, parts)
        whole = np.empty((groups, 2, m, 2, n))
        for i, k in np.ndindex(2, 2):
            scaled = tangent[:, :, i, :, k] @ columns
            whole[:, i, :, k] = rows @ scaled.reshape(groups, parts * points, n)
        return whole.reshape(groups, 2 * m, 2 * n)

    def pushed(self, tensor):
        """T = G⁻ᵀ t G⁻¹ of a tensor of the surface, as 11, 22, 12: (n, 3)."""
        values = np.asarray(tensor.Compile()(self.mapped)).reshape(-1, 2, 2)
        pushed = self._from_chart.swapaxes(1, 2) @ values @ self._from_chart
        return np.stack([pushed[:, 0, 0], pushed[:, 1, 1], pushed[:, 0, 1]], axis=1)

    @cached_property
    def strain(self):
        """C, (n, 3)."""
        return self.pushed(self.patch.sheet.metric)

    @cached_property
    def stretch(self):
        """√det C, area on the surface over flat area, (n,)."""
        return np.sqrt(self.strain[:, 0] * self.strain[:, 1] - self.strain[:, 2] ** 2)

    def flat_areas(self):
        """Those of the flat patch for which the points stand, (groups, points)."""
        return self.weights * self.jacobian.reshape(self.shape)

    def areas(self):
        """Those of the surface, (groups, points)."""
        return self.flat_areas() * self.stretch.reshape(self.shape)

    def lengths(self, along):
        """Lengths on the surface of vectors (n, 2) of the reference triangle, (n,)."""
        flat = np.linalg.solve(self._to_flat, along[:, :, None])[:, :, 0]
        c11, c22, c12 = self.strain.T
        square = c11 * flat[:, 0] ** 2 + 2 * c12 * flat[:, 0] * flat[:, 1] + c22 * flat[:, 1] ** 2
        return np.sqrt(square)

    def norm(self):
        """The H¹ seminorm on the surface, √det C C⁻¹ : ∇uᵀ∇w, by Z: (n, 4, 4).

        Where the place X is felt, it tells whether all of the cloth is moved, which the seminorm
        does not: `LITTLE` of w·w over the area is added.
        """
        c11, c22, c12 = self.strain.T / self.stretch
        tensor = np.moveaxis(np.array([[c22, -c12], [-c12, c11]]), -1, 0)
        whole = np.einsum("ik,njl->nijkl", np.eye(2), tensor).reshape(-1, 4, 4)
        if self._placed:
            whole = changes.with_place(whole, 2)
            whole += LITTLE / self.areas().sum() * changes.along_w(self.stretch)
        return whole

    def functions(self, make):
        """Values and derivatives by Z of functions of the cloth.

        Parameters
        ----------
        make : callable
            Returns a list of expressions of a `Kinematics`.

        Returns
        -------
        values, first, second : ndarray, (functions, n), (functions, n, 4), (functions, n, 4, 4)
        """
        cloth = _Tabled(self)
        expressions = make(cloth)
        numbers, firsts, seconds = cloth.known
        values, slopes, bends = self.table.derivatives(expressions, numbers, 2)
        pairs = [
            changes.chained(slopes[:, row], bends[:, row], firsts, seconds)
            for row in range(len(expressions))
        ]
        first, second = (np.array(part) for part in zip(*pairs, strict=True))
        return values.T, first, second

    @cached_property
    def table(self):
        """For numbers at these points."""
        return Numbers(self.theta)

    @cached_property
    def _tensors(self):
        """C, and K = G⁻ᵀ b G⁻¹ if the fabric resists bending: list of (n, 3)."""
        if of_curvature(self.patch.scene.fabric):
            return [self.strain, self.pushed(self.patch.sheet.curvature)]
        return [self.strain]

    @cached_property
    def felt(self):
        """How what `law` depends on changes with ψ."""
        return changes.Felt(self._tensors, self._placed)

    @cached_property
    def place(self):
        """X = ψ, (n, 2)."""
        functions = self.functions_of(self.patch.order)
        return (functions @ self.patch.psi[self.triangles].swapaxes(1, 2)).reshape(-1, 2)

    def law(self, highest):
        """W and its derivatives up to an order, over kc: by C, and then by K and X, if felt."""
        fabric, felt = self.patch.scene.fabric, list(self._tensors)
        if self._placed:
            felt.append(self.place)
        numbers = self.table.variables(np.concatenate(felt, axis=1))
        tensors = self.table.derivatives([fabric.energy(*numbers)], numbers, highest)
        return [tensor[:, 0] / fabric.stiffness for tensor in tensors]


class _Tabled(Kinematics):
    """The cloth at points, as expressions of numbers there that can be differentiated by them."""

    def __init__(self, points):
        self._points = points
        sheet, fabric = points.patch.sheet, points.patch.scene.fabric
        self._numbers, n = [], len(points.theta)
        firsts = np.zeros((n, 2, 2, 2, 2))
        for i in (0, 1):
            firsts[:, i, :, i] = points.gradient.swapaxes(1, 2)  # ∂(Z G)_ix/∂Z_ij = G_jx
        self._firsts, self._seconds = [firsts.reshape(n, 4, 4)], [np.zeros((n, 4, 4, 4))]
        gradient = ngs.CF(self._new(points.gradient.reshape(n, 4)), dims=(2, 2))
        self._place = points.table.variables(points.place) if of_place(fabric) else []
        super().__init__(gradient, sheet.metric, fabric, lambda: sheet.curvature, self._place)

    def pushed(self, tensor):
        """As for `Kinematics`, of tensors that do not depend on ψ."""
        pushed = self._points.pushed(tensor)
        self._firsts.append(changes.first(pushed)), self._seconds.append(changes.second(pushed))
        return self._new(pushed)

    def _new(self, values):
        numbers = self._points.table.variables(values)
        self._numbers += numbers
        return tuple(numbers)

    @property
    def known(self):
        """The numbers, and their derivatives by Z, (n, numbers, 4) and (n, numbers, 4, 4)."""
        both = [np.concatenate(parts, axis=1) for parts in (self._firsts, self._seconds)]
        if self._place:
            both = map(changes.and_of_place, both)
        return self._numbers + self._place, *both


def _inverse(matrices):
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    return np.moveaxis(np.array([[d, -b], [-c, a]]) / (a * d - b * c), -1, 0)
