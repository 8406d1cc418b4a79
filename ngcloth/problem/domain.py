"""Parameter domains U: where the chart of a surface lives."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError, check_integer, check_number

# OpenCascade merges points within 1e-7; Netgen leaves parts of far larger or thinner faces bare.
SMALLEST, LARGEST, LONGEST = 1e-5, 1e6, 1e4
MOST = 2**20  # points of a rim
BISECTIONS = 52  # down to rounding
INWARDS = 1e-9  # of the way to the middle of a triangle
CHUNK = 300_000  # pairs of a point and an edge that are looked at in one pass


class Domain:
    """A piece of the parameter plane without holes, mirror symmetric about its centre lines.

    A domain of one's own supplies `box`, `contains`, `rim` and `_shape`, as the two below do. Its
    face is one, with one closed rim; a `Surface` refuses any other.
    """

    holes = 0
    quarter = (1, 1)  # the signs of θ − centre in the quarter that is meshed in scenes with mirrors

    @property
    def centre(self):
        """The point (θ1, θ2) in which the two mirror lines cross."""
        (low1, high1), (low2, high2) = self.box
        return np.array([(low1 + high1) / 2, (low2 + high2) / 2])

    @property
    def diameter(self):
        """Length of the diagonal of the bounding box over √2; twice the radius of a disk."""
        return float(np.linalg.norm(np.ptp(np.array(self.box), axis=1)) / np.sqrt(2))

    def sample(self, n=25):
        """Points of an n × n grid that lie in the closed domain, and of the rim, shape (m, 2)."""
        grid = np.stack(np.meshgrid(*(np.linspace(*side, n) for side in self.box)), axis=-1)
        grid = grid.reshape(-1, 2)
        return np.concatenate([grid[self.contains(grid)], self.rim(4 * n)])

    def brought_in(self, theta):
        """Points `theta`, (n, 2), those outside moved to the rim, towards the centre."""
        outside = ~self.contains(theta)
        way = theta[outside] - self.centre
        low, high = np.zeros(len(way)), np.ones(len(way))
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            within = self.contains(self.centre + middle[:, None] * way)
            low, high = np.where(within, middle, low), np.where(within, high, middle)
        theta = theta.copy()
        theta[outside] = self.centre + low[:, None] * way
        return theta

    def check_face(self):
        """Raise `InputError` unless the face to be meshed is one, and has no holes."""
        shape = self._shape()
        if len(shape.faces) != 1 or len(shape.wires) != 1:
            found = f"there are {len(shape.faces)}, with {len(shape.wires)} closed rims"
            raise InputError("domain", self, f"one connected piece without holes; {found}")

    def face(self, symmetric=False):
        """The OpenCascade face to be meshed, its edges named "rim", "mirror1" or "mirror2".

        With `symmetric` it is the quarter beyond both mirror lines; "mirror1" is its edge on the
        line θ1 = centre, "mirror2" the one on θ2 = centre.
        """
        from netgen.occ import MoveTo

        face = self._shape()
        c1, c2 = self.centre
        if symmetric:
            (_, high1), (_, high2) = self.box
            face = face * MoveTo(c1, c2).Rectangle(2 * (high1 - c1), 2 * (high2 - c2)).Face()
        tiny = 1e-9 * self.diameter
        for edge in face.edges:
            middle1, middle2, _ = edge.center
            edge.name = "rim"
            if symmetric and abs(middle1 - c1) < tiny:
                edge.name = "mirror1"
            elif symmetric and abs(middle2 - c2) < tiny:
                edge.name = "mirror2"
        return face


@dataclass(frozen=True)
class Disk(Domain):
    """The disk |θ| < radius, 1e-5 <= radius <= 1e6."""

    radius: float = 1.0

    def __post_init__(self):
        radius = check_number("radius", self.radius, SMALLEST, LARGEST)
        object.__setattr__(self, "radius", radius)

    @property
    def box(self):
        """Bounding box ((low1, high1), (low2, high2))."""
        return ((-self.radius, self.radius), (-self.radius, self.radius))

    def contains(self, theta, tolerance=1e-9):
        """Whether points `theta`, shape (..., 2), lie in the closed disk; a boolean array."""
        return np.hypot(theta[..., 0], theta[..., 1]) <= self.radius * (1 + tolerance)

    def rim(self, n):
        """`n` points around the rim, counter-clockwise from (radius, 0), shape (n, 2)."""
        n = check_integer("n", n, 1, MOST)
        t = 2 * np.pi * np.arange(n) / n
        return self.radius * np.stack([np.cos(t), np.sin(t)], axis=-1)

    def _shape(self):
        from netgen.occ import Circle

        return Circle((0, 0), self.radius).Face()


@dataclass(frozen=True)
class Rectangle(Domain):
    """The rectangle side1 × side2, each side a pair (low, high).

    Sides are at least 1e-5 long, one at most 1e4 times as long as the other, and their ends at
    most 1e6.
    """

    side1: tuple
    side2: tuple

    def __post_init__(self):
        for name in ("side1", "side2"):
            side = getattr(self, name)
            if not isinstance(side, tuple | list | np.ndarray) or len(side) != 2:
                raise InputError(name, side, "a pair of finite numbers, low < high")
            low, high = (check_number(name, end) for end in side)
            if not low < high:
                raise InputError(name, side, "a pair of finite numbers, low < high")
            if high - low < SMALLEST or max(-low, high) > LARGEST:
                allowed = f"at least {SMALLEST:g} long, its ends at most {LARGEST:g}"
                raise InputError(name, side, allowed)
            object.__setattr__(self, name, (low, high))
        width, height = np.ptp(np.array(self.box), axis=1)
        if max(width, height) > LONGEST * min(width, height):
            allowed = f"a side at most {LONGEST:g} times as long or as short as side1"
            raise InputError("side2", self.side2, allowed)

    @property
    def box(self):
        """Bounding box ((low1, high1), (low2, high2))."""
        return (self.side1, self.side2)

    def contains(self, theta, tolerance=1e-9):
        """Whether points `theta`, shape (..., 2), lie in the closed rectangle; a boolean array."""
        low, high = np.array(self.box).T
        slack = tolerance * (high - low)
        return np.all((theta >= low - slack) & (theta <= high + slack), axis=-1)

    def rim(self, n):
        """`n` points around the rim, counter-clockwise from the middle of the right side, (n, 2).

        They are equally spaced along each side, and nearly so from side to side. Six points or
        more always meet the four corners.
        """
        n = check_integer("n", n, 1, MOST)
        (low1, high1), (low2, high2) = self.box
        width, height = high1 - low1, high2 - low2
        middle = (low2 + high2) / 2
        corners = np.array(
            [
                [high1, middle],
                [high1, high2],
                [low1, high2],
                [low1, low2],
                [high1, low2],
                [high1, middle],
            ]
        )
        lengths = np.cumsum([0, height / 2, width, height, width, height / 2])
        s = lengths[-1] * np.arange(n) / n
        if n >= 6:
            half = n // 2
            first = int(np.clip(round(n * lengths[1] / lengths[-1]), 1, (half - 1) // 2))
            met = [0, first, half - first, n - half + first, n - first, n]
            s = np.interp(np.arange(n), met, lengths)
        return np.stack([np.interp(s, lengths, corners[:, i]) for i in (0, 1)], axis=-1)

    def _shape(self):
        from netgen.occ import MoveTo

        (low1, high1), (low2, high2) = self.box
        return MoveTo(low1, low2).Rectangle(high1 - low1, high2 - low2).Face()


def divided_triangle(parts):
    """The triangle (0, 0), (1, 0), (0, 1) with each side in parts: points (n, 2), triangles."""
    i, j = np.array([(i, j) for i in range(parts + 1) for j in range(parts + 1 - i)]).T
    number = np.full((parts + 2, parts + 2), -1)
    number[i, j] = np.arange(len(i))
    a, b = i[i + j < parts], j[i + j < parts]
    upright = np.stack([number[a, b], number[a + 1, b], number[a, b + 1]], axis=-1)
    a, b = i[i + j < parts - 1], j[i + j < parts - 1]
    hanging = np.stack([number[a + 1, b], number[a + 1, b + 1], number[a, b + 1]], axis=-1)
    return np.stack([i, j], axis=-1) / parts, np.concatenate([upright, hanging])


class MeshDomain(Domain):
    """The region that a planar mesh with straight edges covers, with or without holes.

    Parameters
    ----------
    mesh : ngsolve.Mesh

    Attributes
    ----------
    rims : list of ndarray, (n, 2)
        The vertices around the region, counter-clockwise from the largest θ1, and then those
        around each hole, clockwise.
    triangles : ndarray, (m, 3, 2)
        Corners.
    """

    def __init__(self, mesh):
        self._mesh = mesh
        vertices = mesh.ngmesh.Coordinates()
        triangles = mesh.ngmesh.Elements2D().NumPy()["nodes"][:, :3] - 1
        self.triangles = vertices[triangles]
        edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        there, back = edges @ [len(vertices), 1], edges @ [1, len(vertices)]
        once = ~np.isin(there, back)
        self._ends = vertices[edges[once]]
        self._beside = np.repeat(self.triangles.mean(axis=1), 3, axis=0)[once]
        after, rims = dict(edges[once].tolist()), []
        while after:
            start, number = after.popitem()
            rim = [start]
            while number != start:
                rim.append(number)
                number = after.pop(number)
            rims.append(vertices[rim])
        outer = max(range(len(rims)), key=lambda i: rims[i][:, 0].max())
        first = rims.pop(outer)
        self.rims = [np.roll(first, -int(np.argmax(first[:, 0])), axis=0), *rims]

    def __repr__(self):
        return "the parameter domain of a surface from a file"

    @property
    def box(self):
        """Bounding box ((low1, high1), (low2, high2))."""
        return tuple(
            zip(*(f(self.rims[0], axis=0).tolist() for f in (np.min, np.max)), strict=True)
        )

    @property
    def centre(self):
        """A point (θ1, θ2) of the region, about in its middle."""
        middles = self.triangles.mean(axis=1)
        return middles[np.argmin(np.linalg.norm(middles - super().centre, axis=1))]

    def contains(self, theta, tolerance=1e-9):
        """Whether points `theta`, shape (..., 2), lie in the closed region; a boolean array."""
        theta = np.asarray(theta, dtype=float)
        points = theta.reshape(-1, 2)
        within = self._mesh(*points.T)["nr"] >= 0
        outside = np.flatnonzero(~within)
        near, _ = self._nearest(points[outside])
        distance = np.linalg.norm(near - points[outside], axis=1)
        within[outside] = distance <= tolerance * self.diameter
        return within.reshape(theta.shape[:-1])

    @property
    def holes(self):
        """How many there are."""
        return len(self.rims) - 1

    def rim(self, n, hole=0):
        """`n` points around the rim, counter-clockwise from the largest θ1, shape (n, 2).

        They are equally spaced in the plane; around a `hole`, numbered from 1, they run clockwise.
        """
        n = check_integer("n", n, 1, MOST)
        closed = np.concatenate([self.rims[hole], self.rims[hole][:1]])
        lengths = np.cumsum(np.r_[0, np.linalg.norm(np.diff(closed, axis=0), axis=1)])
        at = lengths[-1] * np.arange(n) / n
        return np.stack([np.interp(at, lengths, closed[:, i]) for i in (0, 1)], axis=-1)

    def on_rim(self, theta, tolerance=1e-6):
        """Whether points `theta`, (n, 2), lie on a rim; a boolean array."""
        near, _ = self._nearest(theta)
        return np.linalg.norm(near - theta, axis=1) <= tolerance * self.diameter

    def divided(self, parts):
        """Its triangles, each side in `parts`: points (n, 2), and triangles by their numbers."""
        reference, small = divided_triangle(parts)
        shares = np.column_stack([1 - reference.sum(axis=1), reference])
        points = np.einsum("ns,tsc->tnc", shares, self.triangles)
        first = len(reference) * np.arange(len(points))[:, None, None]
        triangles = (first + small).reshape(-1, 3)
        points = points.reshape(-1, 2)
        grid = np.rint(points / (1e-7 * self.diameter)).astype(np.int64)
        _, once, where = np.unique(grid, axis=0, return_index=True, return_inverse=True)
        return points[once], where.ravel()[triangles]

    def brought_in(self, theta):
        """Points `theta`, (n, 2), those outside moved to the nearest point of a rim."""
        outside = ~self.contains(theta)
        theta = theta.copy()
        theta[outside], _ = self._nearest(theta[outside])
        return theta

    def located(self, theta):
        """Points of the mesh at `theta`, (n, 2), or, where rounding puts them outside, beside."""
        points = self._mesh(*theta.T)
        missing = points["nr"] < 0
        if missing.any():
            theta = theta.copy()
            near, beside = self._nearest(theta[missing])
            theta[missing] = near + INWARDS * (beside - near)
            points = self._mesh(*theta.T)
        return points

    def _nearest(self, points):
        """The nearest points of the rims, and the middles of the triangles there; each (n, 2)."""
        near, beside = np.empty_like(points), np.empty_like(points)
        start, along = self._ends[:, 0], self._ends[:, 1] - self._ends[:, 0]
        rows = max(CHUNK // len(start), 1)
        for first in range(0, len(points), rows):
            some = slice(first, first + rows)
            gaps = points[some, None] - start
            share = np.einsum("pni,ni->pn", gaps, along) / np.einsum("ni,ni->n", along, along)
            feet = start + np.clip(share, 0, 1)[..., None] * along
            distance = np.linalg.norm(feet - points[some, None], axis=-1)
            least = np.argmin(distance, axis=1)
            near[some] = np.take_along_axis(feet, least[:, None, None], axis=1)[:, 0]
            beside[some] = self._beside[least]
        return near, beside


class MirroredDomain(MeshDomain):
    """A region and its images across the lines θ1 = 0 and θ2 = 0.

    Parameters
    ----------
    mesh : ngsolve.Mesh
        Of all four.
    quarter : (int, int)
        See `Domain`.

    Notes
    -----
    `rims` start on the axis θ2 = 0 outside, so that as many points of `rim` as can be divided by
    four are symmetric.
    """

    centre = np.zeros(2)

    def __init__(self, mesh, quarter):
        super().__init__(mesh)
        self.quarter = quarter
        outer = self.rims[0]
        ahead = np.where(outer[:, 1] == 0, outer[:, 0], -np.inf)
        self.rims[0] = np.roll(outer, -int(np.argmax(ahead)), axis=0)
