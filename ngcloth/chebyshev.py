"""The exact Chebyshev net by its hyperbolic equation: an oracle that uses no finite element.

A cloth of inextensible threads is a map θ(u, v) from the flat cloth to the parameter plane, u and v
being arc lengths along warp and weft, hence the material coordinates X1 and X2. Without stiffness
in shear it solves θ_uv + Γ(θ)(θ_u, θ_v) = 0, and two crossing threads determine it.
"""

import ngsolve as ngs
import numpy as np
from numpy.polynomial import chebyshev, legendre, polynomial

from .errors import InputError, check_integer
from .geometry.file_surface import FileSurface

MOST_BLOCKS, HIGHEST = 1000, 64


class ChebyshevNet:
    """The Chebyshev net of a surface, spanned by one warp and one weft thread.

    Solves the Goursat problem θ_uv + Γ(θ)(θ_u, θ_v) = 0 by collocation at Chebyshev nodes, block by
    block, to rounding error where the blocks resolve the surface (`stretch_error` tells).

    The net is *valid* at (u, v) if it could be solved there, and its threads have collapsed (become
    parallel) neither there nor at a node between there and the origin. It is not solved in blocks
    that leave the region where the surface can be evaluated, nor in those that depend on them:
    smaller blocks lose less. Where the net is not valid its methods return nan.

    Parameters
    ----------
    surface : Surface
        The surface to be covered.
    warp, weft : callable
        ``warp(u)`` and ``weft(v)`` return the points θ(u, 0) and θ(0, v), shape (n, 2), at arc
        lengths of shape (n,); nan where the thread has ended.
    extent : (float, float)
        Ends U and V of the threads, of either sign: one net covers one quadrant.
    blocks, degree : int, optional
        Number of blocks along each thread, at most 1000, and polynomial degree of each in u and in
        v, at most 64.

    Raises
    ------
    InputError
        If the threads return no points, do not cross at u = v = 0, or have not unit speed; or if
        not even the first block could be solved.
    """

    def __init__(self, surface, warp, weft, extent, blocks=6, degree=14):
        if np.shape(extent) != (2,) or not np.all(np.isfinite(extent)) or not np.all(extent):
            raise InputError("extent", extent, "two finite lengths other than 0")
        self.surface, self.extent = surface, np.array(extent, dtype=float)
        self.blocks = check_integer("blocks", blocks, 1, MOST_BLOCKS)
        self.degree = check_integer("degree", degree, 2, HIGHEST)
        self._geometry = _Geometry(surface)

        nodes, vander = -np.cos(np.pi * np.arange(degree + 1) / degree), chebyshev.chebvander
        self._series = series = np.linalg.inv(vander(nodes, degree))
        self._integral = vander(nodes, degree + 1) @ chebyshev.chebint(series, lbnd=-1)
        self._integral /= 2 * blocks
        self._derivative = vander(nodes, degree - 1) @ chebyshev.chebder(series) * (2 * blocks)
        self._nodes = (np.arange(blocks)[:, None] + (1 + nodes) / 2) / blocks

        # θ, θ_u, θ_v at the nodes p, q of block i, j are _net[i, j, p, q], i and j from 1 on.
        # Blocks 0 hold only their last edge, a thread: so every block has its two neighbours.
        self._net = np.full(2 * (blocks + 1,) + 2 * (degree + 1,) + (3, 2), np.nan)
        self._net[1:, 0, :, -1, :2] = self._thread("warp", warp, self.extent[0])
        self._net[0, 1:, -1, :, ::2] = self._thread("weft", weft, self.extent[1])
        (origin, first, _), (start, _, second) = self._net[1, 0, 0, -1], self._net[0, 1, -1, 0]
        if np.abs(start - origin).max() > 1e-9 * self._geometry.size.max():
            raise InputError("weft", tuple(start), f"must begin where warp does, {tuple(origin)}")
        if abs(self._geometry.product(origin, first, second)) > 1 - 1e-9:
            raise InputError("weft", tuple(second), "must cross the warp, not touch it")
        self._orientation = np.sign(_cross(first, second))
        for diagonal in range(2, 2 * blocks + 1):
            i = np.arange(max(1, diagonal - blocks), min(diagonal - 1, blocks) + 1)
            self._solve(i, diagonal - i)

        self._fields = self._net[1:, 1:].swapaxes(1, 2).reshape(2 * (self._nodes.size,) + (3, 2))
        valid = np.logical_and.accumulate(self._crosses(self._fields), axis=0)
        self._valid_nodes = np.logical_and.accumulate(valid, axis=1)
        if not self._valid_nodes[self.degree, self.degree]:
            raise InputError("blocks", blocks, "more of them: the first one could not be solved")

    @classmethod
    def symmetric(cls, surface, extent=None, **options):
        """The net whose threads are the centre lines of the parameter domain.

        Those of a mirror symmetric surface are geodesics, and mirror the quadrant that is solved.

        Parameters
        ----------
        surface : Surface
            The surface to be covered: the warp along θ1, the weft along θ2, from the centre.
        extent : (float, float), optional
            Default: the arc lengths from the centre to the rim.
        **options
            `blocks` and `degree`.

        Returns
        -------
        ChebyshevNet
        """
        (warp, end1), (weft, end2) = (_centre_line(surface, axis) for axis in (0, 1))
        return cls(surface, warp, weft, (end1, end2) if extent is None else extent, **options)

    def theta(self, u, v):
        """Parameter points θ(u, v), shape (..., 2), of material coordinates (broadcast)."""
        return self._sample(np.stack(np.broadcast_arrays(u, v), axis=-1))[..., 0, :]

    def shear(self, u, v):
        """Cosine γ = a(θ_u, θ_v) of the angle between the threads, shape (...), likewise."""
        fields = self._sample(np.stack(np.broadcast_arrays(u, v), axis=-1))
        return self._geometry.product(*np.moveaxis(fields, -2, 0))

    def valid(self, u, v):
        """Whether the net is valid at material coordinates (broadcast), boolean, shape (...)."""
        return np.isfinite(self.theta(u, v)).all(axis=-1)

    def material(self, theta):
        """Flat position (u, v) of parameter points, the inverse of `theta` by Newton's method.

        Parameters
        ----------
        theta : array_like, (..., 2)
            Parameter points. The images of rim points outline the patch.

        Returns
        -------
        ndarray, (..., 2)
            nan for points that the valid net does not reach. Near a collapse the net overlaps
            itself: a point that it covers twice gives one of its two positions, or nan.
        """
        theta = np.asarray(theta, dtype=float)
        points = theta.reshape(-1, 2)
        parts = np.array_split(points, 1 + len(points) // 1000)
        return np.concatenate([self._locate(part) for part in parts]).reshape(theta.shape)

    @property
    def stretch_error(self):
        """Largest |a(θ_u, θ_u) − 1| or |a(θ_v, θ_v) − 1| at the nodes of the valid net.

        The equation conserves both and nothing enforces them: a fair measure of the error.
        """
        theta, *tangents = self._fields[self._valid_nodes].swapaxes(0, 1)
        return max(np.abs(self._geometry.product(theta, t, t) - 1).max() for t in tangents)

    def _thread(self, name, thread, length):
        """Points and tangents of a thread at the nodes of its blocks, (blocks, nodes, 2, 2)."""
        points = np.array(thread(length * self._nodes.ravel()), dtype=float)
        if points.shape != (self._nodes.size, 2):
            raise InputError(name, points.shape, "must return points of shape (n, 2)")
        points = points.reshape(self._nodes.shape + (2,))
        points[~self._geometry.inside(points).all(axis=1)] = np.nan
        tangents = self._derivative @ (points - points[:, :1]) / length
        speed = np.sqrt(self._geometry.product(points, tangents, tangents))
        if np.isnan(speed[0]).any():
            raise InputError(name, tuple(points[0, 0]), "must begin well within the domain")
        if np.nanmax(np.abs(speed - 1)) > 1e-8:
            worst = float(speed.flat[np.nanargmax(np.abs(speed - 1))])
            raise InputError(name, worst, "must have speed 1 in the metric of the surface")
        return np.stack([points, tangents], axis=-2)

    def _solve(self, i, j):
        """Solve mutually independent blocks (i, j) from their left and lower edges."""
        below, left = self._net[i, j - 1, :, -1], self._net[i - 1, j, -1]
        ready = np.isfinite(below[..., :2, :] + left[..., 2:, :]).all(axis=(1, 2, 3))
        i, j, below, left = i[ready], j[ready], below[ready, :, None], left[ready, None]

        # Picard's iteration for the mixed derivative: an integral equation of Volterra type, so it
        # converges faster than any geometric sequence.
        (u, v), mixed = self.extent, np.zeros((len(i), self.degree + 1, self.degree + 1, 2))
        for _ in range(60):
            first = below[..., 1, :] + v * np.einsum("qr,kprc->kpqc", self._integral, mixed)
            second = left[..., 2, :] + u * np.einsum("pr,krqc->kpqc", self._integral, mixed)
            theta = below[..., 0, :] + v * np.einsum("qr,kprc->kpqc", self._integral, second)
            last, mixed = mixed, self._geometry.mixed_derivative(theta, first, second)
            change = np.abs(self.extent).max() / self.blocks * np.abs(mixed - last)
            change = change.max(axis=(1, 2, 3)) / np.abs([first, second]).max(axis=(0, 2, 3, 4))
            if np.all((change < 1e-14) | np.isnan(change)):
                break
        solved = (change < 1e-14) & self._geometry.inside(theta).all(axis=(1, 2))
        self._net[i[solved], j[solved]] = np.stack([theta, first, second], axis=-2)[solved]

    def _crosses(self, fields):
        """Whether the threads cross in the sense they do at the origin; False where nan."""
        return _cross(fields[..., 1, :], fields[..., 2, :]) * self._orientation > 0

    def _sample(self, position):
        """θ, θ_u, θ_v at flat positions (..., 2), shape (..., 3, 2), nan where not valid."""
        places = (position / self.extent).reshape(-1, 2)
        places[(np.abs(places - 0.5) > 0.5 + 1e-12).any(axis=-1)] = np.nan
        fields, known = np.full((len(places), 3, 2), np.nan), np.nan_to_num(places)
        # A point on an edge belongs to the block before, which never depends on the one after.
        block = np.ceil(known * self.blocks).clip(1, self.blocks).astype(int)
        local = 2 * (places * self.blocks - block) + 1
        weights = chebyshev.chebvander(local, self.degree) @ self._series
        for i, j in np.unique(block, axis=0):
            here = (block == (i, j)).all(axis=1)
            across = np.tensordot(weights[here, 0], self._net[i, j], 1)
            fields[here] = np.einsum("kq,kqfc->kfc", weights[here, 1], across)
        before = (np.searchsorted(self._nodes.ravel(), known) - 1).clip(0)
        valid = self._valid_nodes[before[:, 0], before[:, 1]] & self._crosses(fields)
        fields[~valid] = np.nan
        return fields.reshape(position.shape[:-1] + (3, 2))

    def _locate(self, points):
        """Flat positions of parameter points, both of shape (n, 2)."""
        size, ends = self._geometry.size, np.sort([0 * self.extent, self.extent], axis=0)
        nodes = np.stack(np.meshgrid(*np.outer(self.extent, self._nodes), indexing="ij"), axis=-1)
        coarse = np.zeros_like(self._valid_nodes)
        coarse[::3, ::3] = self._valid_nodes[::3, ::3]
        nodes, fields = nodes[coarse], self._fields[coarse]
        # Begin at the node from which Newton's first step is the shortest: near a collapse the
        # node nearest in the parameter plane may lie on another sheet of the net.
        steps = _solve2(fields[:, 1], fields[:, 2], points[:, None] - fields[:, 0])
        position = nodes[np.square(steps).sum(axis=-1).argmin(axis=1)]
        fields, damping = self._sample(position), np.ones(len(points))
        for _ in range(60):
            gap = points - fields[:, 0]
            error = np.abs(gap / size).max(axis=-1)
            p = np.flatnonzero((error > 1e-14) & (damping > 1e-4))
            if not p.size:
                break
            step = damping[p, None] * _solve2(fields[p, 1], fields[p, 2], gap[p])
            trial = np.clip(position[p] + step, *ends)
            trial_fields = self._sample(trial)
            better = np.abs((points[p] - trial_fields[:, 0]) / size).max(axis=-1) < error[p]
            position[p[better]], fields[p[better]] = trial[better], trial_fields[better]
            damping[p] = np.where(better, 1.0, damping[p] / 2)
        position[~(error < 1e-11)] = np.nan
        return position


class _Geometry:
    """Metric and Christoffel symbols of a surface, at arrays of points that may be nan."""

    def __init__(self, surface):
        if isinstance(surface, FileSurface):
            allowed = "a surface with a chart; for one from a file, solve a Scene with Net()"
            raise InputError("surface", surface, allowed)
        low, high = np.array(surface.domain.box, dtype=float).T
        self.middle, self.size = (low + high) / 2, high - low
        self._surface = surface
        # Compiled, an expression takes a tenth of the time, with the same values.
        self._metric = surface.metric.Compile()
        self._derivatives = [surface.metric.Diff(theta).Compile() for theta in (ngs.x, ngs.y)]

    def inside(self, theta):
        """Whether the surface can be evaluated at points (..., 2); False for nan."""
        return np.all(np.abs(theta - self.middle) <= self.size, axis=-1)

    def product(self, theta, first, second):
        """a(θ)(first, second), shape (...)."""
        return np.einsum("...i,...ij,...j", first, self._evaluate(self._metric, theta), second)

    def mixed_derivative(self, theta, p, q):
        """θ_uv = −Γ(p, q), (..., 2), with a_kl Γ^l_ij = ½ (∂_i a_jk + ∂_j a_ik − ∂_k a_ij)."""
        a = self._evaluate(self._metric, theta)
        da = np.stack([self._evaluate(each, theta) for each in self._derivatives], axis=-3)
        symbols = (da.swapaxes(-3, -2) + da.swapaxes(-3, -1) - da) / 2
        with np.errstate(all="ignore"):  # what overflows, or a singular metric, becomes nan
            lowered = np.einsum("...kij,...i,...j->...k", symbols, p, q)
            return -_solve2(a[..., 0], a[..., 1], lowered)

    def _evaluate(self, expression, theta):
        # Picard's iterates may stray: beyond its region the surface is continued by constants.
        theta = np.where(np.isnan(theta), self.middle, theta)
        theta = np.clip(theta, self.middle - self.size, self.middle + self.size)
        return self._surface.evaluate(expression, theta)


def _centre_line(surface, axis):
    """The centre line of the domain along one θ axis as a thread, and its length to the rim."""
    geometry, direction = _Geometry(surface), np.eye(2)[axis]
    x, weights = legendre.leggauss(64)

    def speed(t):
        theta = geometry.middle + t[..., None] * direction
        return np.sqrt(geometry.product(theta, direction, direction))

    def length(t):
        return t / 2 * (speed(t[:, None] * (1 + x) / 2) @ weights)

    reach = geometry.size[axis] * np.linspace(-1, 1, 101)  # the rim is the 75th
    lengths = length(reach)
    known = np.isfinite(lengths)

    def thread(s):
        t = np.interp(s, lengths[known], reach[known], left=np.nan, right=np.nan)
        for _ in range(6):
            t = t - (length(t) - s) / speed(t)
        return geometry.middle + t[:, None] * direction

    return thread, float(lengths[75])


def sphere_angle(z):
    """Angle ω(u, v) = g(uv) between the threads on the unit sphere with geodesic axes.

    g solves z g'' + g' + sin g = 0, g(0) = π/2: g = π/2 − z + z³/18 − 0.00388… z⁵ + …

    Parameters
    ----------
    z : array_like
        Products uv, |z| <= 2. The threads collapse at `SPHERE_COLLAPSE`, where g = 0.

    Returns
    -------
    ndarray, of the shape of `z`
        In radians.

    Raises
    ------
    InputError
        If |z| > 2: the radius of convergence of the series is 2.9.
    """
    z = np.asarray(z, dtype=float)
    if not np.all(np.abs(z) <= 2):
        raise InputError("z", z, "numbers, -2 <= z <= 2")
    return polynomial.polyval(z, _SPHERE_SERIES)


def sphere_singular_portion():
    """Portion p* of the unit sphere whose Chebyshev patch is the first to reach a collapse.

    The cap is centred where the geodesic axes cross. By symmetry the diagonal u = v = s is a great
    circle, run through at speed |φ_u + φ_v| = 2 cos(g(s²)/2). Its length α up to the collapse
    s² = z* is a polar angle, and p* = (1 − cos α)/2.

    Returns
    -------
    float
        Area of the cap over area of the sphere.
    """
    x, weights = legendre.leggauss(40)
    end = np.sqrt(SPHERE_COLLAPSE)
    speed = 2 * np.cos(sphere_angle((end * (1 + x) / 2) ** 2) / 2)
    return float((1 - np.cos(end / 2 * weights @ speed)) / 2)


def _sphere_series(terms=110):
    """Taylor coefficients of g, from (k + 1)² g_{k+1} = −(sin g)_k and (e^{ig})' = i g' e^{ig}."""
    g, e = np.zeros(terms), np.zeros(terms, dtype=complex)
    g[0], e[0] = np.pi / 2, 1j
    for k in range(1, terms):
        g[k] = -e[k - 1].imag / k**2
        orders = np.arange(1, k + 1)
        e[k] = 1j * (orders * g[orders]) @ e[k - orders] / k
    return g


def _cross(p, q):
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]


def _solve2(column1, column2, right):
    """Solve 2 × 2 systems by Cramer's rule, which a singular one does not stop."""
    numerators = np.stack([_cross(right, column2), _cross(column1, right)], axis=-1)
    return numerators / _cross(column1, column2)[..., None]


def _sphere_collapse():
    """The first zero z* of g, by Newton's method."""
    z, slope = 2.0, polynomial.polyder(_SPHERE_SERIES)
    for _ in range(8):
        z -= float(sphere_angle(z) / polynomial.polyval(z, slope))
    return z


_SPHERE_SERIES = _sphere_series()
SPHERE_COLLAPSE = _sphere_collapse()
