"""Triangles in space laid in the plane: Tutte's embedding, then as rigid as possible."""

import numpy as np
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import splu

# As rigid as possible is a chart and a start, and no answer: steps end early.
ITERATIONS, SETTLED = 30, 1e-3
SHRUNK = 1e-6  # area of a triangle over what it was, of a chart that is of no use


class FlatteningError(Exception):
    """Triangles so thin that rounding flips them in the plane."""


def flatten(points, triangles, rims):
    """Lay a surface of disk shape in the plane, without flips and without overlap.

    Parameters
    ----------
    points : ndarray, (n, 3)
        Vertices.
    triangles : ndarray of int, (m, 3)
        All oriented alike.
    rims : list of ndarray
        The vertices around each rim, as `Topology.rims` has them.

    Returns
    -------
    ndarray, (n, 2)
        Where each point goes. Triangles are counter-clockwise; as far as that can be, lengths are
        kept, and the first coordinate runs along the x axis of space.

    Raises
    ------
    FlatteningError
        If rounding flips triangles, as where a rim is short for what hangs on it.
    """
    lengths = [np.linalg.norm(np.roll(points[r], -1, axis=0) - points[r], axis=1) for r in rims]
    outer = int(np.argmax([length.sum() for length in lengths]))
    filled, covered = points, triangles
    for number, rim in enumerate(rims):
        if number != outer:  # Tutte's theorem is for disks without holes: fill them
            covered = np.concatenate([covered, _fan(rim, len(filled))])
            filled = np.concatenate([filled, points[rim].mean(axis=0)[None]])
    tutte = _tutte(filled, covered, rims[outer], lengths[outer])[: len(points)]
    areas = _areas(points, triangles)
    tutte = tutte * np.sqrt(areas.sum() / _flat_areas(tutte, triangles).sum())
    flat = _as_rigid_as_possible(points, triangles, tutte)
    if not is_embedding(flat, triangles, rims):
        flat = tutte
        shrunk = (_flat_areas(flat, triangles) < SHRUNK * areas).any()
        if shrunk or not is_embedding(flat, triangles, rims):
            around = lengths[outer].sum() / np.sqrt(4 * np.pi * areas.sum())
            raise FlatteningError(
                "laid flat, its triangles overlap by rounding; its rim is "
                f"{around:.0%} of that of a flat disk of its area: cut it open, take less of it, "
                "or repair needles"
            )
    return _turned(points, triangles, flat)


def is_embedding(flat, triangles, rims):
    """Whether no triangle is flipped or flat, and no rim crosses itself or another one."""
    sides = flat[triangles] - flat[np.roll(triangles, 1, axis=1)]
    thick = _flat_areas(flat, triangles) / (sides**2).sum(axis=(1, 2))  # small ones are as good
    return bool(thick.min() > 1e-6 and not _crossing(flat, rims))


def between_mirrors(flat, triangles, rims, first, second):
    """A flat surface moved so that two parts of its rim lie along two sides of one quadrant.

    Parameters
    ----------
    flat, triangles, rims
        As of `flatten`, and what it returns.
    first, second : ndarray of int
        Vertices of the mirror lines θ1 = 0 and θ2 = 0, one of them in common.

    Returns
    -------
    ndarray, (n, 2)
        With θ1 > 0 where the mirror lines do not meet, and θ2 of one sign.

    Raises
    ------
    FlatteningError
        If that flips triangles, or some of them leave the quadrant.
    """
    (corner,) = np.intersect1d(first, second)
    flat = flat - flat[corner]
    x, y = flat[second].mean(axis=0)
    flat = flat @ np.array([[x, -y], [y, x]]) / np.hypot(x, y)
    n, ends = len(flat), triangles[:, [0, 1, 1, 2, 2, 0, 1, 0, 2, 1, 0, 2]].reshape(-1, 2)
    beside = coo_matrix((np.ones(len(ends)), tuple(ends.T)), shape=(n, n)).tocsr()
    laplacian = (diags(beside.sum(axis=1).A1) - beside).tocsr()
    for axis, line in enumerate((first, second)):
        free, off = np.setdiff1d(np.arange(n), line), flat[:, axis].copy()
        off[free] = splu(laplacian[free][:, free].tocsc()).solve(
            -laplacian[free][:, line] @ off[line]
        )
        flat[:, axis] -= off
    others = [np.delete(flat[:, axis], line) for axis, line in enumerate((first, second))]
    within = others[0].min() > 0 and others[1].min() * others[1].max() > 0
    if not (within and is_embedding(flat, triangles, rims)):
        raise FlatteningError("its mirror lines, laid straight, fold it")
    return flat


def _fan(rim, centre):
    return np.stack([np.roll(rim, -1), rim, np.full(len(rim), centre)], axis=-1)


def _tutte(points, triangles, rim, lengths):
    """The rim on a circle, each inner point a convex combination of its neighbours.

    The weights are mean values, so that a flat and convex surface would stay as it is.
    """
    angle = 2 * np.pi * np.cumsum(lengths) / lengths.sum()
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    angles = corner_angles(points, triangles)
    rows, columns, weights = [], [], []
    for i in range(3):
        here = triangles[:, i]
        for j in (i - 1, i - 2):
            there = triangles[:, j]
            length = np.linalg.norm(points[here] - points[there], axis=1)
            rows.append(here), columns.append(there)
            weights.append(np.tan(angles[:, i] / 2) / length)
    n = len(points)
    entries = np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))
    weight = coo_matrix(entries, shape=(n, n)).tocsr()
    weight = weight.multiply(1 / weight.sum(axis=1).A1[:, None]).tocsr()
    inner = np.setdiff1d(np.arange(n), rim)
    flat = np.empty((n, 2))
    flat[rim] = circle
    matrix = -weight[inner][:, inner]
    matrix.setdiag(1)
    flat[inner] = splu(matrix.tocsc()).solve(weight[inner][:, rim] @ circle)
    return flat


def _as_rigid_as_possible(points, triangles, flat):
    """Least squares of the change of edges under the best rotation of each triangle, by turns."""
    n, corners = len(points), _corners(points, triangles)
    cotangents = 1 / np.tan(corner_angles(points, triangles))
    rows, columns, weights = [], [], []
    for i in range(3):
        for here, there in ((i - 2, i - 1), (i - 1, i - 2)):
            rows.append(triangles[:, here]), columns.append(triangles[:, there])
            weights.append(cotangents[:, i])
    entries = np.concatenate(weights), (np.concatenate(rows), np.concatenate(columns))
    weight = coo_matrix(entries, shape=(n, n)).tocsr()
    laplacian = -weight
    laplacian.setdiag(weight.sum(axis=1).A1)
    solver = splu(laplacian[1:][:, 1:].tocsc())  # the first point stays
    for _ in range(ITERATIONS):
        across = np.zeros((len(triangles), 2, 2))
        for i in range(3):
            was = corners[:, i - 1] - corners[:, i - 2]
            now = flat[triangles[:, i - 1]] - flat[triangles[:, i - 2]]
            across += cotangents[:, i, None, None] * now[:, :, None] * was[:, None, :]
        cosine = across[:, 0, 0] + across[:, 1, 1]
        sine = across[:, 1, 0] - across[:, 0, 1]
        size = np.hypot(cosine, sine)
        rotation = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(-1, 2, 2)
        rotation /= np.where(size > 0, size, 1)[:, None, None]
        load = np.zeros((n, 2))
        for i in range(3):
            was = corners[:, i - 1] - corners[:, i - 2]
            pull = cotangents[:, i, None] * np.einsum("nij,nj->ni", rotation, was)
            for j, sign in ((i - 1, 1), (i - 2, -1)):
                for k in range(2):
                    load[:, k] += np.bincount(triangles[:, j], sign * pull[:, k], n)
        before, flat = flat - flat[0], np.concatenate([flat[:1] * 0, solver.solve(load[1:])])
        if np.abs(flat - before).max() < SETTLED * np.abs(flat).max():
            break
    return flat


def _turned(points, triangles, flat):
    """Centred, and turned so that θ1 runs along x, or along y where x leaves the surface."""
    areas = _flat_areas(flat, triangles)
    jacobian = np.einsum("n,nij->ij", areas, gradients(points, triangles, flat))
    left, _, right = np.linalg.svd(jacobian, full_matrices=False)
    frame = left @ right  # the mean tangents along θ1 and θ2, made orthonormal
    along = frame[int(np.linalg.norm(frame[0]) < 0.5)]
    rotation = np.array([along, [-along[1], along[0]]]) / np.linalg.norm(along)
    middle = flat[triangles].mean(axis=1)
    return (flat - areas @ middle / areas.sum()) @ rotation.T


def gradients(points, triangles, flat):
    """∂φ/∂θ on each triangle, (m, 3, 2)."""
    in_space = np.diff(points[triangles], axis=1).transpose(0, 2, 1)
    in_plane = np.diff(flat[triangles], axis=1).transpose(0, 2, 1)
    return in_space @ np.linalg.inv(in_plane)


def _corners(points, triangles):
    """Each triangle (m, 3, 2) in its own plane."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    along = np.linalg.norm(b - a, axis=1)
    e1 = (b - a) / along[:, None]
    x = np.sum((c - a) * e1, axis=1)
    y = np.linalg.norm(np.cross(b - a, c - a), axis=1) / along
    zero = np.zeros_like(x)
    return np.stack([zero, zero, along, zero, x, y], axis=-1).reshape(-1, 3, 2)


def corner_angles(points, triangles):
    """The angles (m, 3) of the triangles; needles are taken a little thicker than they are."""
    angles = []
    for i in range(3):
        one, two = (points[triangles[:, j]] - points[triangles[:, i]] for j in (i - 2, i - 1))
        across = np.linalg.norm(np.cross(one, two), axis=1)
        angles.append(np.arctan2(across, np.sum(one * two, axis=1)))
    return np.clip(np.stack(angles, axis=-1), 1e-3, np.pi - 1e-3)


def _areas(points, triangles):
    a, b, c = points[triangles].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _flat_areas(flat, triangles):
    a, b, c = flat[triangles].transpose(1, 0, 2)
    return _cross(b - a, c - a) / 2


def _cross(one, two):
    return one[..., 0] * two[..., 1] - one[..., 1] * two[..., 0]


def _crossing(flat, rims):
    """Whether edges of the rims cross each other."""
    begin = np.concatenate([flat[rim] for rim in rims])
    end = np.concatenate([flat[np.roll(rim, -1)] for rim in rims])
    for a, b in zip(begin, end, strict=True):
        one = _cross(b - a, begin - a) * _cross(b - a, end - a) < 0
        two = _cross(end - begin, a - begin) * _cross(end - begin, b - begin) < 0
        if np.any(one & two):
            return True
    return False
