"""The rims of facets as smooth curves between corners."""

import numpy as np

DEGREE = 4
EXACT = 7  # vertices of a fit to exact ones
CORNER = 40.0  # degrees of turning


class RimCurves:
    """Smooth curves through the vertices of rims, by length, one for each stretch.

    A stretch runs from corner to corner, or around a rim without any.

    Parameters
    ----------
    points : ndarray, (n, 3)
    rims : list of ndarray
        The vertices around each rim.
    reach : float
        How far from a point vertices are taken into account, of smooth surfaces through noisy
        vertices; 0 for exact ones.

    Attributes
    ----------
    stretches : list of ndarray
        The vertices of each stretch, both ends included, equal on rims without corners.
    lengths : list of ndarray
        The length from the beginning of the stretch to each.
    rims : list of list of int
        The numbers of the stretches around each rim.
    """

    def __init__(self, points, rims, reach):
        self._points, self.stretches, self.rims = points, [], []
        for rim in rims:
            edge = np.linalg.norm(np.roll(points[rim], -1, axis=0) - points[rim], axis=1)
            steps = max(int(reach / np.median(edge)), 1)
            stretches = _stretches(points, rim, steps)
            first = len(self.stretches)
            self.rims.append(list(range(first, first + len(stretches))))
            self.stretches += stretches
        self.lengths = [self._length(stretch) for stretch in self.stretches]
        self._curves = [
            self._windows(stretch, length, reach)
            for stretch, length in zip(self.stretches, self.lengths, strict=True)
        ]

    def _length(self, stretch):
        edges = np.linalg.norm(np.diff(self._points[stretch], axis=0), axis=1)
        return np.concatenate([[0], np.cumsum(edges)])

    def _windows(self, stretch, length, reach):
        """Vertices to fit to, their lengths, and how many at a time; around, if it is closed."""
        points = self._points[stretch]
        edge = length[-1] / (len(length) - 1)
        count = max(EXACT, int(2 * reach / edge))
        if stretch[0] == stretch[-1]:
            around = range(-1, 2)
            points = np.concatenate([points[:-1]] * 3)
            length = np.concatenate([length[:-1] + turn * length[-1] for turn in around])
        return points, length, min(count, len(length))

    def __call__(self, stretch, s):
        """Points (n, 3) at lengths `s` along a stretch."""
        points, length, count = self._curves[stretch]
        nearest = np.clip(np.searchsorted(length, s) - count // 2, 0, len(length) - count)
        window = nearest[:, None] + np.arange(count)
        away = length[window] - s[:, None]
        radius = np.abs(away).max(axis=1, keepdims=True)
        weight = (1 - 0.99 * (away / radius) ** 2) ** 2
        powers = np.arange(min(DEGREE, count - 1) + 1)
        basis = (away / radius)[:, :, None] ** powers
        weighted = (weight[:, :, None] * basis).transpose(0, 2, 1)
        fits = np.linalg.solve(weighted @ basis, weighted @ points[window])
        return fits[:, 0]


def _stretches(points, rim, steps):
    """A rim cut at its corners: where it turns by more than CORNER between chords of `steps`."""
    at = points[rim]
    before, after = at - np.roll(at, steps, axis=0), np.roll(at, -steps, axis=0) - at
    cosine = np.sum(before * after, axis=1)
    turning = np.arctan2(np.linalg.norm(np.cross(before, after), axis=1), cosine)
    nearby = np.stack([np.roll(turning, i) for i in range(-steps, steps + 1)])
    corners = np.flatnonzero((turning > np.radians(CORNER)) & (turning >= nearby.max(axis=0)))
    if not len(corners):
        return [np.append(rim, rim[0])]
    ends = np.append(corners, corners[0] + len(rim))
    around = np.concatenate([rim, rim])
    return [around[a : b + 1] for a, b in zip(ends[:-1], ends[1:], strict=True)]
