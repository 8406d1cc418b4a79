"""Finite elements by NumPy and SciPy: continuous piecewise polynomials, their sparse matrices.

A certificate shares with the solver neither spaces nor assembly nor factorisations.
"""

from functools import cached_property

import numpy as np

from ..geometry.sheet import mesh_points
from . import bernstein

SIDES = ((0, 1), (1, 2), (2, 0))  # of a triangle, by its corners


class Triangles:
    """Which triangles, sides and vertices of a mesh meet.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Of triangles.

    Attributes
    ----------
    vertices : ndarray, (triangles, 3)
        Their numbers.
    sides : ndarray, (triangles, 3)
        Numbers of their `SIDES`.
    """

    def __init__(self, mesh):
        self.mesh = mesh
        self.vertices = mesh.ngmesh.Elements2D().NumPy()["nodes"][:, :3].astype(np.int64) - 1
        self._sides, numbers = np.unique(
            self._key(self.vertices[:, SIDES]).ravel(), return_inverse=True
        )
        self.sides = numbers.reshape(-1, 3)

    def __len__(self):
        return len(self.vertices)

    def _key(self, pairs):
        """One number for two vertices, (..., 2)."""
        return pairs.min(axis=-1) * self.mesh.nv + pairs.max(axis=-1)

    def boundary(self, name):
        """The numbers of the sides on boundaries of this name."""
        edges = self.mesh.ngmesh.Elements1D().NumPy()
        known = np.array([name == each for each in self.mesh.GetBoundaries()], dtype=bool)
        chosen = edges["nodes"][known[edges["index"] - 1], :2].astype(np.int64) - 1
        return np.searchsorted(self._sides, self._key(chosen))

    def touching(self, sides):
        """Triangle and number among its `SIDES` of each that is in `sides`, both (n,)."""
        return np.nonzero(np.isin(self.sides, sides))

    @cached_property
    def ranks(self):
        """In which order to eliminate what belongs to each vertex, side and triangle, (n,).

        Minimum degree is sought among these, and not among many unknowns of each; it takes a tenth
        of the time, and those of one stay together.
        """
        from scipy.sparse import coo_matrix, eye
        from scipy.sparse.linalg import splu

        vertices, sides = self.mesh.nv, len(self._sides)
        of_triangle = np.arange(len(self))[:, None]
        parts = [self.vertices, vertices + self.sides, vertices + sides + of_triangle]
        parts = np.concatenate(parts, axis=1)
        n, size = parts.shape[1], vertices + sides + len(self)
        rows, columns = np.repeat(parts, n, axis=1).ravel(), np.tile(parts, (1, n)).ravel()
        graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(size, size))
        matrix = (graph + 100.0 * size * eye(size)).tocsc()
        symmetric = {"SymmetricMode": True}
        return splu(matrix, permc_spec="MMD_AT_PLUS_A", options=symmetric).perm_c

    def mapped(self, triangles, reference):
        """Mesh points of NGSolve at reference points (n, 2) of triangles (n,)."""
        return mesh_points(self.mesh, triangles, reference)

    def at_lattice(self, degree):
        """Mesh points at the `lattice` of each triangle, one triangle after another."""
        points = bernstein.lattice(degree)
        numbers = np.repeat(np.arange(len(self)), len(points))
        return self.mapped(numbers, np.tile(points, (len(self), 1)))


class Space:
    """Continuous functions that are polynomials of one order on each triangle.

    Attributes
    ----------
    dofs : ndarray, (triangles, n)
        The numbers of their Bernstein coefficients; neighbours share those of a side.
    ndof : int
    """

    def __init__(self, triangles, order):
        self.order, self._triangles, self._known = order, triangles, {}
        alphas, vertices = bernstein.exponents(order), triangles.vertices
        first, more = triangles.mesh.nv, order - 1
        self.dofs = np.empty((len(triangles), len(alphas)), dtype=np.int64)
        parts = [np.arange(first)]  # to which each belongs: vertices, then sides, then triangles
        self.dofs[:, bernstein.corners(order)] = vertices
        for side, (a, b) in enumerate(SIDES):
            inside = np.flatnonzero(
                (alphas[:, a] > 0) & (alphas[:, b] > 0) & (alphas[:, 3 - a - b] == 0)
            )
            rises = vertices[:, a] < vertices[:, b]
            along = np.where(rises[:, None], alphas[inside, a], alphas[inside, b])
            self.dofs[:, inside] = first + more * triangles.sides[:, [side]] + along - 1
        parts.append(first + np.repeat(np.arange(triangles.sides.max() + 1), more))
        first += more * (triangles.sides.max() + 1)
        inside = np.flatnonzero((alphas > 0).all(axis=1))
        numbers = np.arange(len(triangles) * len(inside)).reshape(len(triangles), -1)
        self.dofs[:, inside] = first + numbers
        self.ndof = first + numbers.size
        before = triangles.mesh.nv + triangles.sides.max() + 1
        parts.append(before + np.repeat(np.arange(len(triangles)), len(inside)))
        self._parts = np.concatenate(parts)

    @property
    def ranks(self):
        """In which order to eliminate the unknowns, (ndof,), with ties."""
        return self._triangles.ranks[self._parts]

    def on(self, *names):
        """Which functions do not vanish on boundaries of these names, (ndof,) bool."""
        there = np.zeros(self.ndof, dtype=bool)
        for name in names:
            there[self._on(name)] = True
        return there

    def _on(self, name):
        """The numbers of these, of one boundary."""
        if name not in self._known:
            numbers, alphas = [], bernstein.exponents(self.order)
            triangles, which = self._triangles.touching(self._triangles.boundary(name))
            for side, (a, b) in enumerate(SIDES):
                on_side = alphas[:, 3 - a - b] == 0
                numbers.append(self.dofs[np.ix_(triangles[which == side], on_side)].ravel())
            self._known[name] = np.concatenate(numbers)
        return self._known[name]

    @cached_property
    def pairs(self):
        """Numbers of the coefficients of two functions, (triangles, 2 n)."""
        return np.concatenate([self.dofs, self.ndof + self.dofs], axis=1)


def assembled(size, rows, columns, values):
    """The sparse square matrix with these entries; those at one place are summed."""
    from scipy.sparse import coo_matrix  # takes time, and sets filters of warnings

    return coo_matrix((values, (rows, columns)), shape=(size, size)).tocsc()


def restricted(chosen, *matrices):
    """Rows and columns of matrices that have the same entries, all in one go."""
    from scipy.sparse import csc_matrix

    first = matrices[0]
    numbers = csc_matrix((np.arange(first.nnz), first.indices, first.indptr), first.shape)
    numbers = numbers[chosen][:, chosen]
    places = numbers.indices, numbers.indptr
    return [csc_matrix((each.data[numbers.data], *places), numbers.shape) for each in matrices]


def factorised(matrix):
    """SciPy's LU of a symmetric matrix with pivots from its diagonal alone, in its order: LDLᵀ.

    Raises
    ------
    RuntimeError
        If a pivot is zero.
    """
    from scipy.sparse.linalg import splu

    symmetric = {"SymmetricMode": True}
    return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=symmetric)


def negative_pivots(factors):
    """How many eigenvalues of a factorised symmetric matrix are negative (Sylvester's law)."""
    return int((factors.U.diagonal() < 0).sum())


def parts_of_square(matrix, load):
    """bᵀA⁻¹b of a positive definite matrix, as a sum of one part ≥ 0 for each unknown, (n,).

    With A = LDLᵀ they are (L⁻¹b)²/D: those of the first unknowns sum up to what these give alone.
    """
    factors, turned = factorised(matrix), np.empty(len(load))
    turned[factors.perm_c] = factors.solve(load)
    upper = factors.U  # D Lᵀ
    return ((upper @ turned) ** 2 / upper.diagonal())[factors.perm_c]
