"""Plane geometry of the region within a closed outline, (n, 2): its chords, width and crossings.

Outlines run counter-clockwise, those of holes clockwise, and do not repeat their first point.
"""

import numpy as np

FEWEST, MOST = 1000, 100_000  # points at which an outline is sampled


def crossing(outline, *holes):
    """A point where the closed outline meets itself or a hole, or holes meet; or None."""
    start, end = _sides(outline, *holes)
    (low, below), (high, above) = np.minimum(start, end).T, np.maximum(start, end).T
    order, n = np.argsort(low), len(start)
    # To each side, from left to right, those after it that begin before it ends.
    count = np.searchsorted(low[order], high[order], side="right") - np.arange(n) - 1
    one = np.repeat(np.arange(n), count)
    other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    i, j = order[one], order[other]
    _, after = _sides(*(np.arange(len(o)) + f for o, f in _numbered(outline, *holes)))
    near = (below[i] <= above[j]) & (above[i] >= below[j]) & (after[i] != j) & (after[j] != i)
    i, j = i[near], j[near]

    def apart(i, j):
        """Whether sides `j` lie on one side of the lines through sides `i`."""
        along = end[i] - start[i]
        return _cross(along, start[j] - start[i]) * _cross(along, end[j] - start[i]) > 0

    met = ~apart(i, j) & ~apart(j, i)
    return tuple(start[i[met][0]].tolist()) if met.any() else None


def chords(outline, levels, axis, holes=()):
    """The parts of the lines along `axis` at `levels` that lie within the outline.

    Parameters
    ----------
    outline : ndarray, (n, 2)
        Closed, counter-clockwise.
    levels : ndarray, (m,)
        Of the other coordinate.
    axis : {0, 1}
        Of the coordinate that varies along the lines.
    holes : sequence of ndarray, optional
        Their outlines.

    Returns
    -------
    list of ndarray, (2, 2)
        Their ends, the lower one first, level by level. Where the outline overlaps itself they
        are those of all it covers.
    """
    start, end = _sides(outline, *holes)
    found = []
    for level in levels:
        # A corner on the line belongs to the sides above it, that it be counted once or twice.
        before, after = start[:, 1 - axis] >= level, end[:, 1 - axis] >= level
        sides = np.flatnonzero(before != after)
        (x, u), (y, v) = (p[sides].T[[axis, 1 - axis]] for p in (start, end))
        place = x + (level - u) / (v - u) * (y - x)
        order = np.argsort(place)
        winding = np.cumsum(np.where(after[sides], 1, -1)[order])
        inside = np.append(0, winding) != 0
        ends = place[order][inside[:-1] != inside[1:]].reshape(-1, 2)
        for pair in ends[np.ptp(ends, axis=1) > 0]:
            chord = np.full((2, 2), float(level))
            chord[:, axis] = pair
            found.append(chord)
    return found


class Room:
    """How wide the region within an outline is, from place to place.

    The outline is sampled densely. Of the Delaunay triangulation of the samples, circles about
    triangles hold no sample: those with their centre within the outline are its inscribed
    circles. And where the region is narrow, edges of triangles join its two sides.

    Parameters
    ----------
    outline : ndarray, (n, 2)
    spacing : float
        Of the samples at most, as long as that takes no more than `MOST`.
    holes : sequence of ndarray, optional
        Their outlines.

    Attributes
    ----------
    centres : ndarray, (k, 2)
        Of inscribed circles.
    radii : ndarray, (k,)
    """

    def __init__(self, outline, spacing, holes=()):
        from matplotlib.path import Path
        from matplotlib.tri import Triangulation

        self._paths = [Path(each, closed=False) for each in (outline, *holes)]
        samples = [_sampled(each, spacing) for each in (outline, *holes)]
        self._samples, self._along = (np.concatenate(part) for part in zip(*samples, strict=True))
        self._rim = np.repeat(np.arange(len(samples)), [len(along) for _, along in samples])
        self._length = np.array([_length(each) for each in (outline, *holes)])
        self._triangulation = Triangulation(*self._samples.T)
        self.centres, self.radii = self._circles()

    def nearest(self, point, depth):
        """The place nearest to `point` that is `depth` within the outline, or as deep as it gets.

        The places so deep are the inscribed circles, their radii less by as much.
        """
        radii = np.maximum(self.radii - depth, 0)
        distance = np.linalg.norm(self.centres - point, axis=1)
        deep = self.radii >= min(depth, self.radii.max())
        best = np.argmin(np.where(deep, np.maximum(distance - radii, 0), np.inf))
        share = min(radii[best] / max(distance[best], 1e-300), 1)
        return self.centres[best] + share * (point - self.centres[best])

    def narrowest(self, width):
        """Where the region is less wide than `width`, a point; None if it is so nowhere.

        Neither corners nor short tips count: beyond so narrow a place there are five times
        `width` of rim, as there are in tips of less than 23 degrees.
        """
        if 2 * self.radii.max() < width:
            return self.centres[np.argmax(self.radii)]
        one, other = self._triangulation.edges.T
        along, length = np.abs(self._along[one] - self._along[other]), self._length[self._rim[one]]
        across = np.linalg.norm(self._samples[one] - self._samples[other], axis=1)
        middle = (self._samples[one] + self._samples[other]) / 2
        beyond = np.where(
            self._rim[one] == self._rim[other], np.minimum(along, length - along), np.inf
        )
        narrow = (across < width) & (beyond > 5 * width) & self._contains(middle)
        return middle[narrow][np.argmin(across[narrow])] if narrow.any() else None

    def _contains(self, points):
        outer, *holes = (path.contains_points(points) for path in self._paths)
        return outer & ~np.any(holes, axis=0) if holes else outer

    def _circles(self):
        corners = self._samples[self._triangulation.triangles]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        square_a, square_b = (np.sum(side**2, axis=1, keepdims=True) for side in (a, b))
        turned = (square_b * a - square_a * b)[:, ::-1] * [-1, 1]
        with np.errstate(all="ignore"):  # three samples on a line
            centres = corners[:, 0] + turned / (2 * _cross(a, b)[:, None])
        inside = np.isfinite(centres).all(axis=1)
        inside[inside] = self._contains(centres[inside])
        radii = np.linalg.norm(corners - centres[:, None], axis=2).min(axis=1)
        return centres[inside], radii[inside]


def _sides(*outlines):
    """Where the sides of closed outlines start and end."""
    ends = [np.roll(outline, -1, axis=0) for outline in outlines]
    return np.concatenate(outlines), np.concatenate(ends)


def _numbered(*outlines):
    """Outlines, and the number of the first side of each."""
    return zip(outlines, np.cumsum([0, *map(len, outlines)])[:-1], strict=True)


def _length(outline):
    return np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum()


def _sampled(outline, spacing):
    """Points along an outline, its corners among them, and how far along they are."""
    ends = np.append(outline, outline[:1], axis=0)
    along = np.append(0, np.cumsum(np.linalg.norm(np.diff(ends, axis=0), axis=1)))
    n = int(np.clip(along[-1] / spacing, FEWEST, MOST))
    at = np.union1d(along[:-1], along[-1] * np.arange(n) / n)
    return np.stack([np.interp(at, along, x) for x in ends.T], axis=-1), at


def _cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
