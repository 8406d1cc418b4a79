"""Triangulations of a smooth surface near facets, of any size and order, and refined."""

from dataclasses import dataclass

import ngsolve as ngs
import numpy as np
from netgen.geom2d import SplineGeometry
from scipy.spatial import cKDTree

from ._kernel import lattice
from .file_surface import Level
from .flatten import gradients
from .sheet import planar_mesh

FINER = 0.8  # of the usual element size in the flat copy, where facets are stretched
RESTRICTED = 1000  # places where the mesher is told so


@dataclass(frozen=True)
class Rim:
    """The edges of a triangulation that lie on stretches of the rim.

    Attributes
    ----------
    ends : ndarray of int, (r, 2)
        Their vertices.
    stretch : ndarray of int, (r,)
    s : ndarray, (r, 2)
        The lengths along the stretch at their ends.
    """

    ends: np.ndarray
    stretch: np.ndarray
    s: np.ndarray

    def halved(self, middles):
        """The two halves of each edge, given the new vertices between (r,)."""
        s = self.s.mean(axis=1)
        return Rim(
            np.concatenate(
                [np.stack([self.ends[:, 0], middles], 1), np.stack([middles, self.ends[:, 1]], 1)]
            ),
            np.tile(self.stretch, 2),
            np.concatenate([np.stack([self.s[:, 0], s], 1), np.stack([s, self.s[:, 1]], 1)]),
        )


class Remesher:
    """Makes triangulations whose nodes lie on the smooth surface.

    The first vertices are placed by the flat copy of the facets; all other nodes by projection in
    space, so that the shapes of facets do not show in them.

    Parameters
    ----------
    points : ndarray, (n, 3)
    triangles : ndarray of int, (m, 3)
    flat : ndarray, (n, 2)
    jets : Jets
    curves : RimCurves
    """

    def __init__(self, points, triangles, flat, jets, curves):
        self._points, self._flat, self._jets, self._curves = points, flat, jets, curves
        none = np.zeros((0, 2), dtype=int)
        self._mesh = planar_mesh(flat, triangles, none, np.zeros(0, dtype=str))
        self._place = ngs.GridFunction(ngs.H1(self._mesh, order=1, dim=3))
        self._place.vec.FV().NumPy()[:] = points.ravel()
        slopes = gradients(points, triangles, flat)
        stretch = np.linalg.svd(slopes, compute_uv=False)
        self._middles, self._stretch = flat[triangles].mean(axis=1), stretch[:, 0]
        self._shrunk = 1 / np.sqrt(np.mean(stretch.prod(axis=1)))

    def levels(self, maxh, orders, count):
        """As `FileSurface.levels`."""
        vertices, triangles, rim = self._coarsest(maxh)
        parents = np.full((len(vertices), 2), -1)
        levels = []
        for _ in range(count):
            if levels:
                vertices, triangles, rim, parents = self._refined(vertices, triangles, rim)
            nodes = {order: self._nodes(vertices, triangles, rim, order) for order in orders}
            levels.append(Level(vertices, triangles, parents, {}, nodes))
        return levels

    def _coarsest(self, maxh):
        """Vertices, triangles and rim of a mesh of the flat outline, laid on the surface."""
        geometry, outline, stretches, lengths = SplineGeometry(), [], [], []
        for numbers in self._curves.rims:
            corners = []
            for number in numbers:
                flat, s = self._knots(number, maxh, 4 if len(numbers) == 1 else 2)
                corners += flat[:-1].tolist()
                stretches += [number] * len(s[1:])
                lengths += list(zip(s[:-1], s[1:], strict=True))
            names = [geometry.AppendPoint(*corner) for corner in corners]
            for begin, end in zip(names, names[1:] + names[:1], strict=True):
                line = ["line", begin, end]
                geometry.Append(line, leftdomain=1, rightdomain=0, bc=begin + 1)
            outline += [corners, np.roll(corners, -1, axis=0)]
        begin, end = np.concatenate(outline[::2]), np.concatenate(outline[1::2])

        size = maxh / self._stretch
        small = np.flatnonzero(size < FINER * maxh * self._shrunk)
        for i in small[:: len(small) // RESTRICTED + 1]:
            geometry.RestrictH((*self._middles[i], 0), size[i])
        mesh = geometry.GenerateMesh(maxh=maxh * self._shrunk)
        flat = np.array(mesh.Coordinates())
        triangles = mesh.Elements2D().NumPy()["nodes"][:, :3].astype(int) - 1
        segments = mesh.Elements1D().NumPy()
        line, ends = segments["index"] - 1, segments["nodes"][:, :2].astype(int) - 1
        along = np.linalg.norm(flat[ends] - begin[line, None], axis=-1)
        along /= np.linalg.norm(end - begin, axis=-1)[line, None]
        low, high = np.array(lengths)[line].T[:, :, None]
        rim = Rim(ends, np.array(stretches)[line], low + along * (high - low))
        return self._laid(flat, rim), triangles, rim

    def _knots(self, number, maxh, least):
        """Points about `maxh` apart on a stretch, in the flat copy, and their lengths."""
        stretch, length = self._curves.stretches[number], self._curves.lengths[number]
        s = np.linspace(0, length[-1], max(int(np.ceil(length[-1] / maxh)), least) + 1)
        return np.stack([np.interp(s, length, self._flat[stretch, i]) for i in (0, 1)], -1), s

    def _laid(self, flat, rim):
        vertices = np.empty((len(flat), 3))
        inner = np.setdiff1d(np.arange(len(flat)), rim.ends)
        found = self._mesh(*flat[inner].T)
        outside = found["nr"] < 0  # within a facet of the rim, which is no straight line
        at = np.empty((len(inner), 3))
        at[~outside] = self._place(found[~outside])
        at[outside] = self._points[cKDTree(self._flat).query(flat[inner][outside])[1]]
        vertices[inner] = self._jets.project(at)
        for end in (0, 1):
            vertices[rim.ends[:, end]] = self._on_rim(rim.stretch, rim.s[:, end])
        return vertices

    def _on_rim(self, stretch, s):
        """Points of the rim at lengths `s` (n,) of stretches (n,)."""
        at = np.empty((len(s), 3))
        for number in np.unique(stretch):
            here = stretch == number
            at[here] = self._curves(number, s[here])
        return self._jets.project(at)  # else noise would part the rim from the surface

    def _refined(self, vertices, triangles, rim):
        """Each triangle in four; new vertices, and their parents, after those that were there."""
        edges, edge = _edges(triangles)
        new = len(vertices) + edge.reshape(-1, 3)  # beyond each corner
        a, b, c = triangles.T
        ab, bc, ca = new[:, 2], new[:, 0], new[:, 1]
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        on_rim = _find(edges, rim.ends)
        middles = self._jets.project(vertices[edges].mean(axis=1))
        middles[on_rim] = self._along(vertices, rim, np.array([0.5]))[:, 0]
        parents = np.concatenate([np.full((len(vertices), 2), -1), edges])
        triangles = np.concatenate([np.stack(part, axis=-1) for part in parts])
        rim = rim.halved(len(vertices) + on_rim)
        return np.concatenate([vertices, middles]), triangles, rim, parents

    def _along(self, vertices, rim, t):
        """Points (r, n, 3) at fractions `t` (n,) or (r, n) of edges on the rim."""
        t = np.broadcast_to(t, (len(rim.ends), np.shape(t)[-1]))
        s = rim.s[:, :1] + t * np.diff(rim.s, axis=1)
        stretch = np.repeat(rim.stretch, t.shape[1])
        curve = self._on_rim(stretch, s.ravel()).reshape(*t.shape, 3)
        # At a corner, two curves come as near to each other as noise lets them.
        begin, end = (
            vertices[rim.ends[:, i]] - self._on_rim(rim.stretch, rim.s[:, i]) for i in (0, 1)
        )
        return curve + (1 - t)[:, :, None] * begin[:, None] + t[:, :, None] * end[:, None]

    def _nodes(self, vertices, triangles, rim, order):
        """The nodes of triangles, (m, nodes of a triangle, 3), on the surface and on its rim."""
        points = np.column_stack([lattice(order), 1 - lattice(order).sum(axis=1)])
        start = np.einsum("ni,mij->mnj", points, vertices[triangles])
        edges, edge = _edges(triangles)
        rim_edge = np.full(len(edges), -1)
        rim_edge[_find(edges, rim.ends)] = np.arange(len(rim.ends))
        rim_edge, fixed = rim_edge[edge].reshape(-1, 3), np.zeros(start.shape[:2], dtype=bool)
        for i in range(3):
            here = np.flatnonzero(rim_edge[:, i] >= 0)
            number = rim_edge[here, i]
            edge_rim = Rim(rim.ends[number], rim.stretch[number], rim.s[number])
            one, two = points[:, i - 2], points[:, i - 1]
            both = one + two
            t = two / np.where(both > 0, both, 1)
            backward = edge_rim.ends[:, 0] != triangles[here, i - 2]
            t = np.where(backward[:, None], 1 - t, t)
            ends = vertices[edge_rim.ends]
            chord = (1 - t)[:, :, None] * ends[:, None, 0] + t[:, :, None] * ends[:, None, 1]
            off = self._along(vertices, edge_rim, t) - chord
            start[here] += both[:, None] ** order * off  # a polynomial if the rim is one
            fixed[here] |= points[:, i] == 0
        fixed |= points.max(axis=1) == 1
        start[~fixed] = self._projected(start[~fixed])
        return start

    def _projected(self, points):
        """Projected, each point once that neighbours share, to rounding."""
        digits = np.round(points / (1e-9 * np.ptp(self._points)))
        _, first, number = np.unique(digits, axis=0, return_index=True, return_inverse=True)
        return self._jets.project(points[first])[number.reshape(-1)]


def _edges(triangles):
    """Edges (e, 2) by ascending vertices, and those beyond each corner of the triangles, (3m,)."""
    ends = np.sort(triangles[:, [[1, 2], [2, 0], [0, 1]]].reshape(-1, 2), axis=1)
    edges, edge = np.unique(ends, axis=0, return_inverse=True)
    return edges, edge.reshape(-1)


def _find(edges, ends):
    """The numbers of edges (e, 2), in the order of `_edges`, with these ends (r, 2)."""
    size = edges.max() + 1
    low, high = np.sort(ends, axis=1).T
    return np.searchsorted(edges[:, 0] * size + edges[:, 1], low * size + high)
