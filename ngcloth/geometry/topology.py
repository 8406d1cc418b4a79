"""Triangles in space: their edges, rims and parts, one orientation, and what is no disk."""

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components
from scipy.spatial import cKDTree

CLOSED = "a closed surface, which has no rim to pin; choose some of its faces, or cut it"


@dataclass(frozen=True)
class Topology:
    """What hangs together in a set of triangles.

    Attributes
    ----------
    vertices, edges, triangles : int
        How many.
    parts : int
        Pieces that no edge connects.
    rims : list of ndarray
        The vertices around each rim in order, the surface on their left; empty if some edge
        has three triangles or more, or some rim touches a rim in a vertex.
    crowded : int
        Edges with three triangles or more.
    pinched : int
        Vertices in which two fans of triangles touch, and nothing more.
    orientable : bool
        Whether there is a side.
    """

    vertices: int
    edges: int
    triangles: int
    parts: int
    rims: list
    crowded: int
    pinched: int
    orientable: bool

    @property
    def euler(self):
        """The Euler number, V − E + F: 1 of a disk, less one for each hole."""
        return self.vertices - self.edges + self.triangles

    @property
    def fault(self):
        """Why this is no disk, with or without holes, and what to do; None if it is one."""
        holes = len(self.rims) - 1
        if self.crowded:
            return f"three faces or more meet in {self.crowded} edges; choose those on one side"
        if self.parts > 1:
            return f"{self.parts} loose parts; choose one of them, or faces that share edges"
        if self.pinched:
            return f"faces that meet in {self.pinched} vertices alone; choose those with edges"
        if not self.orientable:
            return "a surface of one side, as a Möbius strip; cut it open"
        if not self.rims:
            return CLOSED
        if self.euler != 1 - holes:
            handles = (2 - self.euler - len(self.rims)) // 2
            return f"a surface with handles ({handles}); cut it open"
        return None

    def __str__(self):
        return f"Euler number {self.euler}, {len(self.rims)} rims, {self.parts} parts"


def topology(triangles):
    """Look at triangles (n, 3), and orient them alike.

    Parameters
    ----------
    triangles : ndarray of int, (n, 3)
        By the numbers of their vertices.

    Returns
    -------
    Topology
    ndarray of bool, (n,)
        Which triangles are to be turned for all to be oriented alike. Within each part, fewer
        than half are.
    """
    ends = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edges, edge, count = np.unique(
        np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    edge, triangle = edge.reshape(-1), np.repeat(np.arange(len(triangles)), 3)
    forward = ends[:, 0] < ends[:, 1]

    inner = np.flatnonzero(count[edge] == 2)
    pairs = inner[np.argsort(edge[inner], kind="stable")].reshape(-1, 2)
    alike = forward[pairs[:, 0]] != forward[pairs[:, 1]]
    one, two = triangle[pairs].T
    turned, parts = _turned(len(triangles), one, two, alike)
    orientable = bool(np.all((turned[one] == turned[two]) == alike))

    rims, corners = [], np.unique(triangles)
    pinched = _pinched(triangles, one, two, edge[pairs[:, 0]], edges, len(corners))
    crowded = int(np.sum(count > 2))
    if orientable and not pinched and not crowded:
        single = count[edge] == 1
        directed = np.where(turned[triangle, None], ends[:, ::-1], ends)[single]
        rims = _loops(directed)
    found = Topology(
        len(corners), len(edges), len(triangles), parts, rims, crowded, pinched, orientable
    )
    return found, turned


def _turned(n, one, two, alike):
    """Flood fill over neighbours, the larger side of each part as it was; and how many parts."""
    links = np.concatenate([one, two]), np.concatenate([two, one])
    graph = coo_matrix((np.tile(np.where(alike, 1, 2), 2), links), shape=(n, n)).tocsr()
    parts, part = connected_components(graph, directed=False)
    turned = np.zeros(n, dtype=bool)
    for first in np.unique(part, return_index=True)[1]:
        order, before = breadth_first_order(graph, first, directed=False)
        order, before = order[1:], before[order[1:]]
        if not len(order):
            continue
        against = np.asarray(graph[order, before]).reshape(-1) == 2
        for here, there, other in zip(order, before, against, strict=True):
            turned[here] = turned[there] ^ other
    flips = np.bincount(part, turned, parts) > np.bincount(part, minlength=parts) / 2
    return turned ^ flips[part], parts


def _pinched(triangles, one, two, edge, edges, vertices):
    """How many more fans of triangles there are than vertices."""
    n = len(triangles)
    corner = np.arange(3 * n).reshape(n, 3)
    links = []
    for end in edges[edge].T:  # corners of neighbours at one vertex belong to one fan
        here = corner[one, np.argmax(triangles[one] == end[:, None], axis=1)]
        there = corner[two, np.argmax(triangles[two] == end[:, None], axis=1)]
        links.append((here, there))
    here, there = np.concatenate(links, axis=1)
    graph = coo_matrix((np.ones(len(here)), (here, there)), shape=(3 * n, 3 * n))
    fans, _ = connected_components(graph, directed=False)
    return int(fans - vertices)


def _loops(directed):
    """The closed walks along directed edges (n, 2), each vertex with one edge in and one out."""
    following = dict(directed.tolist())
    loops = []
    while following:
        start, vertex = following.popitem()
        loop = [start]
        while vertex != start:
            loop.append(vertex)
            vertex = following.pop(vertex)
        loops.append(np.array(loop))
    return loops


def clean(points, triangles, merge=True):
    """Merge points that coincide, and drop facets of fewer than three, or that come twice.

    Points within 1e-7 of the size of the whole are one. The points that no facet uses go.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Vertices.
    triangles : ndarray of int, (m, 3)
        By the numbers of their vertices.
    merge : bool, optional
        Whether to merge points. Default True.

    Returns
    -------
    points, triangles : ndarray
    """
    if merge:
        points, triangles = _merged(points, triangles)
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    triangles = triangles[np.sort(first)]
    used, number = np.unique(triangles, return_inverse=True)
    return points[used], number.reshape(-1, 3)


def _merged(points, triangles):
    points, number = np.unique(points, axis=0, return_inverse=True)
    triangles = number.reshape(-1)[triangles]
    close = 1e-7 * np.linalg.norm(np.ptp(points, axis=0))
    pairs = cKDTree(points).query_pairs(close, output_type="ndarray")
    n = len(points)
    graph = coo_matrix((np.ones(len(pairs)), tuple(pairs.T)), shape=(n, n))
    _, number = connected_components(graph, directed=False)
    _, first, number = np.unique(number, return_index=True, return_inverse=True)
    return points[first], number.reshape(-1)[triangles]
