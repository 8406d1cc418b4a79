"""Forms in ψ and v as sparse matrices, solved for changes of ψ that the scene allows."""

from functools import cached_property

import numpy as np

from ..geometry.nearest import nearest_on_sheet
from ..problem.fabric import of_place
from ..problem.warp import parameter_direction
from .changes import with_place
from .elements import Space, assembled, factorised, negative_pivots
from .patch import Points

SOFT = 1e-13  # on the diagonal of v, over what couples it to ψ, for lack of pivoting
REFINEMENTS = 4  # that undo this, or a shift


class System:
    """Forms in ψ of an order, and v, as vectors and sparse matrices.

    Attributes
    ----------
    psi : slice
        Where ψ is among the unknowns; v follows, in scenes that are held to equilibrium.
    size : int
    """

    def __init__(self, point, order):
        self._point, patch = point, point.patch
        self._space = Space(patch.triangles, order)
        self.psi, self.size = slice(0, 2 * self._space.ndof), 2 * self._space.ndof
        self._v = None
        if point.scene.in_equilibrium:
            self._v = Space(patch.triangles, point.degree)
            self.size += 2 * self._v.ndof
        ranks = [space.ranks for space in (self._space, self._v) if space for _ in (0, 1)]
        self._order = np.argsort(np.concatenate(ranks), kind="stable")

    def v_by_triangle(self, v):
        """Coefficients of v, (triangles, 2, n)."""
        return np.moveaxis(v.reshape(2, -1)[:, self._v.dofs], 0, 1)

    def load(self, points, slopes):
        """The vector of a form by Z, (n, 4), weights included."""
        values = points.loads(self._space.order, slopes)
        numbers = self._space.pairs[points.triangles]
        return np.bincount(numbers.ravel(), values.ravel(), self.size)

    def matrix(self, inside, beside=0.0, coupled=1.0):
        """The matrix of forms by Z at the points inside and those beside, (n, 4, 4), weighted.

        With it comes, `coupled` times, the derivative of dE[v] by ψ and v, both ways round. All
        matrices have the same entries, some of them zero; rows are those of unknowns as they are
        eliminated.
        """
        point, order = self._point, self._space.order
        blocks = point.inside.blocks(order, order, inside)
        if np.ndim(beside):
            points = point.patch.beside
            np.add.at(blocks, points.triangles, points.blocks(order, order, beside))
        parts = [blocks.ravel(), *2 * [coupled * self._coupling]]
        return assembled(self.size, *self._places, np.concatenate(parts))

    @cached_property
    def _coupling(self):
        """Entries of the derivative of dE[v] by ψ and v."""
        point = self._point
        if self._v is None:
            return np.empty(0)
        tangent = point.flat_areas[:, None, None] * point.energy[2]
        return point.inside.blocks(self._space.order, self._v.order, tangent).ravel()

    @cached_property
    def _places(self):
        """Rows and columns of all entries."""
        place = np.argsort(self._order)
        psi = place[self._space.pairs]
        pairs = [(psi, psi)]
        if self._v is not None:
            v = place[self.psi.stop + self._v.pairs]
            pairs.append((psi, v))
        rows = [np.repeat(rows, columns.shape[1], axis=1).ravel() for rows, columns in pairs]
        columns = [np.tile(columns, (1, rows.shape[1])).ravel() for rows, columns in pairs]
        # The last ones both ways round.
        return np.concatenate([*rows, *columns[1:]]), np.concatenate([*columns, *rows[1:]])

    def free(self, flips=(0, 0)):
        """The unknowns to solve for, as they are eliminated, and their rows in a `matrix`.

        Of a component held nowhere all but one vertex are, unless the fabric feels the place.

        Component i is odd across mirror i and even across the other, and so vanishes on one of
        them; a flip turns both round. The four pairs of flips are the four symmetries of a change
        of a symmetric patch, and the Hessian does not mix them.
        """
        held = []
        for space, rim in ((self._space, ()), (self._v, ("rim",))):
            for i in (0, 1) if space else ():
                odd = [f"mirror{j + 1}" for j in (0, 1) if (i == j) != bool(flips[j])]
                held.append(space.on(*rim, *(odd if self._point.scene.symmetric else ())))
                if not (held[-1].any() or of_place(self._point.scene.fabric)):
                    held[-1][0] = True
        rows = np.flatnonzero(~np.concatenate(held)[self._order])
        return self._order[rows], rows

    def factorised(self, matrix, free):
        """Factors of a matrix of the free unknowns, with a little on the diagonal of v.

        Where the block of ψ is positive the softened matrix is quasi-definite, and so has an LDLᵀ
        in any order (Vanderbei, 1995).
        """
        from scipy.sparse import diags

        on_v = free >= self.psi.stop
        softening = SOFT * np.abs(self._coupling).max(initial=0.0)
        factors = factorised(matrix - diags(softening * on_v, format="csc"))
        return Factors(factors, None if self._normal is None else self._normal[free])

    @cached_property
    def _normal(self):
        """Of the condition on ψ by a given direction of the warp, (∇ψ d)2 = 0; None without."""
        scene, patch = self._point.scene, self._point.patch
        if scene.warp is None or scene.symmetric:
            return None
        theta, _, tangents = nearest_on_sheet(patch.sheet, np.array(scene.at))
        place = patch.sheet.mesh(*theta)
        points = Points(patch, np.array([place.nr]), np.array([[place.pnt[:2]]]), None)
        along = points.gradient[0] @ parameter_direction(tangents, scene.warp)
        of_fall = np.array([[0.0, 0.0, *along]])
        return self.load(points, with_place(of_fall, 1) if of_place(scene.fabric) else of_fall)

    def solved(self, matrix, load):
        """The solution, zero where it is not free."""
        (free, rows), solution = self.free(), np.zeros(self.size)
        matrix = matrix[rows][:, rows]
        solution[free] = refined(self.factorised(matrix, free), matrix, load[free])
        return solution


class Factors:
    """Factors of a symmetric matrix, on vectors that keep normal·x = 0 if there is a normal."""

    def __init__(self, factors, normal):
        self._factors, self._normal = factors, normal
        if normal is not None:
            self._response = factors.solve(normal)
            self._compliance = normal @ self._response

    @property
    def negative(self):
        """How many eigenvalues are negative."""
        held = self._normal is not None and self._compliance < 0
        return negative_pivots(self._factors) - held

    def solve(self, load):
        """The solution of a system."""
        solution = self._factors.solve(load)
        if self._normal is not None:
            solution -= self._normal @ solution / self._compliance * self._response
        return solution


def refined(factors, matrix, load):
    """The solution of a system, given factors of a matrix that is nearly its own."""
    solution = np.zeros_like(load)
    for _ in range(REFINEMENTS):
        solution += factors.solve(load - matrix @ solution)
    return solution
