"""A smooth surface near vertices: polynomials over tangent planes, blended."""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ..errors import InputError

CHUNK = 300_000  # numbers in the largest array of one pass: more leave the cache
DEGREE = 4
EXACT = 36  # vertices of a fit to exact ones
LARGEST = 800  # vertices of any fit
BIASED = 1.05  # growth of squared residuals from which on they are not of noise alone
SAMPLE = 400  # vertices at which noise is looked for
WITHIN = 36  # polynomials that are fitted, of those at the vertices that one is fitted to
BLENDED = 12  # polynomials at a point
ALIKE = 0.3  # cosine between normals, from which on vertices are on one side of a thin part
STEPS = 3  # of a projection


class Jets:
    """The smooth surface near noisy or exact vertices.

    Around vertices a polynomial of degree 4, the height over a plane, is fitted to the nearest
    vertices, weighted by distance. For exact vertices these are a few; for noisy ones their number
    grows as long as the residual stays that of the noise. Anywhere else, the polynomials of the
    nearest vertices are blended.

    Parameters
    ----------
    points, normals : ndarray, (n, 3)
        Vertices, and the normals of the facets around each. Vertices that look another way, as on
        the other side of a thin part, are left out of a fit.
    neighbours : int, optional
        How many vertices to fit to. By default the noise decides.

    Attributes
    ----------
    neighbours : int
    noise : float
        Standard deviation of the vertices from a smooth surface, along its normal.
    curvature_error : float
        Standard deviation of the mean curvature that this noise leaves.
    """

    def __init__(self, points, normals, neighbours=None):
        self._points, self._normals, self._tree = points, normals, cKDTree(points)
        powers = range(DEGREE + 1)
        self._powers = np.array([(i, j) for i in powers for j in range(DEGREE + 1 - i)])
        sample = points[:: max(len(points) // SAMPLE, 1)]
        least = min(EXACT, len(points))
        if neighbours is None:
            neighbours = self._grown(sample, least)
        neighbours = self.neighbours = min(max(neighbours, least), len(points))
        noise, curvature = self._errors(sample, neighbours)
        self.noise, self.curvature_error = float(np.median(noise)), float(np.median(curvature))
        dense = len(points) * min(WITHIN / neighbours, 1)
        self._centres = np.random.default_rng(0).permutation(points)[: int(np.ceil(dense))]
        fits = ((f.heights, f.frames, f.radius) for f in self._fits(self._centres, neighbours))
        self._heights, self._frames, self._radius = map(np.concatenate, zip(*fits, strict=True))
        self._near = cKDTree(self._centres)

    def _grown(self, sample, neighbours):
        noise = np.mean(self._errors(sample, neighbours)[0] ** 2)
        while (larger := int(1.5 * neighbours)) <= min(LARGEST, len(self._points) // 3):
            if np.mean(self._errors(sample, larger)[0] ** 2) > BIASED * noise:
                break
            neighbours = larger
        return neighbours

    def _errors(self, sample, neighbours):
        """Deviation of the vertices, and of mean curvature, around each of a sample."""
        errors = [(fit.noise, fit.curvature_error) for fit in self._fits(sample, neighbours)]
        return np.concatenate(errors, axis=1)

    def project(self, points):
        """Move points (n, 3), as near to the surface as facets are, onto it."""
        rows = CHUNK // (BLENDED * len(self._powers))
        return np.concatenate(
            [points[:0]]
            + [self._projected(points[i : i + rows]) for i in range(0, len(points), rows)]
        )

    def _projected(self, points):
        count = min(BLENDED, len(self._centres))
        for _ in range(STEPS):
            if not np.abs(points).max() < 1e100:  # nor NaN
                allowed = "a length over which the vertices are those of a smooth surface"
                raise InputError("smoothing", float(self._radius.mean()), allowed)
            distance, nearest = self._near.query(points, count)
            looks = self._frames[nearest, :, 2]
            weight = (1 - (distance / (1.001 * distance[:, -1:])) ** 2) ** 3
            weight *= np.einsum("nki,ni->nk", looks, looks[:, 0]) > ALIKE
            weight /= weight.sum(axis=1, keepdims=True)
            local = np.einsum(
                "nki,nkij->nkj", points[:, None] - self._centres[nearest], self._frames[nearest]
            )
            uv = local[..., :2] / self._radius[nearest][..., None]
            height = np.einsum("npk,nkp->nk", _basis(uv, self._powers), self._heights[nearest])
            points = points + np.einsum("nk,nki->ni", weight * (height - local[..., 2]), looks)
        return points

    def _fits(self, points, neighbours):
        rows = max(CHUNK // (neighbours * len(self._powers)), 1)
        return (
            _Fit(self, points[begin : begin + rows], neighbours)
            for begin in range(0, len(points), rows)
        )


class _Fit:
    """Polynomials around some vertices: heights over a plane whose coordinates are 1 at `radius`.

    The columns of `frames` are two tangents and the normal.
    """

    def __init__(self, jets, points, neighbours):
        distance, nearest = jets._tree.query(points, neighbours)
        self.radius, self._powers = distance[:, -1], jets._powers
        self._weight = (1 - 0.99 * (distance / self.radius[:, None]) ** 2) ** 2
        looks = jets._normals[nearest]
        self._weight *= np.einsum("nki,ni->nk", looks, looks[:, 0]) > ALIKE
        normals = _unit(np.einsum("nk,nki->ni", self._weight, looks))
        first = _unit(np.cross(normals, np.eye(3)[np.argmin(np.abs(normals), axis=1)]))
        self.frames = np.stack([first, np.cross(normals, first), normals], axis=-1)
        local = (jets._points[nearest] - points[:, None]) @ self.frames
        self._basis = _basis(local[..., :2] / self.radius[:, None, None], self._powers)
        self._weighted = self._weight[:, None] * self._basis
        self._matrix = self._weighted @ self._basis.transpose(0, 2, 1)
        size = np.trace(self._matrix, axis1=1, axis2=2)
        self._matrix += 1e-12 * size[:, None, None] * np.eye(len(self._powers))
        self._local = local[..., 2:]
        self.heights = np.linalg.solve(self._matrix, self._weighted @ self._local)[..., 0]

    @cached_property
    def _inverse(self):
        return np.linalg.inv(self._matrix)

    @cached_property
    def _spread(self):
        return self._weighted @ self._weighted.transpose(0, 2, 1)

    @property
    def noise(self):
        """Standard deviation of the vertices from each polynomial."""
        residual = self._local[..., 0] - (self.heights[:, None] @ self._basis)[:, 0]
        squares = np.einsum("nk,nk->n", self._weight, residual**2)
        taken = np.einsum("nij,nji->n", self._inverse, self._spread)
        return np.sqrt(squares / np.maximum(self._weight.sum(axis=1) - taken, 1e-3))

    @property
    def curvature_error(self):
        """That of half the sum of the second derivatives, by the noise."""
        is_square = (self._powers.max(axis=1) == 2) & (self._powers.sum(axis=1) == 2)
        slope = self._inverse @ is_square.astype(float)
        variance = np.einsum("ni,nij,nj->n", slope, self._spread, slope)
        return self.noise * np.sqrt(np.maximum(variance, 0)) / self.radius**2


def _basis(uv, powers):
    """Monomials (n, len(powers), k) of coordinates (n, k, 2)."""
    powers_of = np.ones((2, DEGREE + 1, *uv.shape[:-1]))
    for i in range(DEGREE):
        powers_of[:, i + 1] = powers_of[:, i] * np.moveaxis(uv, -1, 0)
    basis = np.empty((len(uv), len(powers), uv.shape[1]))
    for number, (i, j) in enumerate(powers):
        np.multiply(powers_of[0, i], powers_of[1, j], out=basis[:, number])
    return basis


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
