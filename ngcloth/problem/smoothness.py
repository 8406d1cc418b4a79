"""Whether derivatives are those of the function, at many scattered points; and singular points.

NGSolve differentiates some expressions wrongly, or to zero, without a word: fields of other
meshes, tables, steps. Here they meet difference quotients.
"""

from functools import cache

import numpy as np

AGREEMENT = 1e-3  # of slopes with difference quotients
SCALE_SHARE = 1e-6  # below which slopes do not count, over the largest of their kind
ROUNDING = 1e-13
SUSPECTS, PARTS, ROUNDS = 64, 32, 2

LATTICE = 250  # points along a side of the domain's box
ANGLE = 0.5  # by which the lattice is turned: no grid of a user's runs along it
SPARSE = 4
LOWEST = 8  # points from which each kind of singular point is sought
FIRST, MIDDLE, LAST = 9, 17, 30  # halvings of the box: half the lattice's spacing, 1e-5, 1e-9
STENCIL = np.stack(np.meshgrid(*2 * [np.arange(-2.0, 3.0)]), axis=-1).reshape(-1, 2)


def disagreement(sample, points, pairs, known):
    """A point at which slopes are not those of the values, and which of these; or None.

    From one point of a pair to the other, values must change as one of the slopes there says, or
    as something between. Where they do not, the way is divided, twice: smooth functions then come
    into order, steps, kinks and wrong slopes do not. A slope itself may jump.

    Parameters
    ----------
    sample : callable
        From points (n, m) to values (n, k) and their slopes (n, k, d) by the last d coordinates.
    points : ndarray, (n, m)
        Where to begin.
    pairs : ndarray of int, (p, 2)
        Pairs of near ones.
    known : pair of ndarray
        What `sample` gives at them.

    Returns
    -------
    (ndarray, int) or None
        The point (m,), and the number of the value.
    """
    (values, slopes), scale = known, None
    for stage in range(ROUNDS + 1):
        excess, scale = _excess(points, pairs, values, slopes, scale)
        most = excess.max(axis=1, initial=-1)
        worst = np.argsort(-most)[:SUSPECTS]
        worst = worst[most[worst] > 0]
        if not len(worst):
            return None
        ends = points[pairs[worst]]
        if stage < ROUNDS:
            parts = np.linspace(0, 1, PARTS + 1)[:, None]
            points = (ends[:, :1] + parts * (ends[:, 1:] - ends[:, :1])).reshape(-1, ends.shape[2])
            first = np.arange(len(worst))[:, None] * (PARTS + 1) + np.arange(PARTS)
            pairs = np.stack([first.ravel(), first.ravel() + 1], axis=-1)
            (values, slopes), scale = sample(points), scale / PARTS
    return ends[0].mean(axis=0), int(excess[worst[0]].argmax())


def _excess(points, pairs, values, slopes, scale):
    """By how much pairs disagree, over what is allowed, less one; and the scale of changes."""
    start, end = pairs.T
    step = (points[end] - points[start])[:, -slopes.shape[2] :]
    along = [np.einsum("pkd,pd->pk", slopes[at], step) for at in (start, end)]
    with np.errstate(invalid="ignore", over="ignore"):
        change = values[end] - values[start]
        beyond = np.maximum(change - np.maximum(*along), np.minimum(*along) - change)
    finite = np.isfinite(change) & np.isfinite(beyond)
    change, beyond = np.where(finite, change, 0.0), np.where(finite, beyond, -1.0)
    if scale is None:
        scale = np.abs(change).max(axis=0, initial=0.0)
    largest = np.abs(values).max(axis=0, initial=0.0, where=np.isfinite(values))
    allowed = SCALE_SHARE * scale + ROUNDING * largest + np.finfo(float).tiny
    excess = np.full(change.shape, -1.0)
    doubtful = np.flatnonzero((beyond > allowed).any(axis=1))
    size = np.max(np.abs([array[doubtful] for array in (change, *along)]), axis=0)
    excess[doubtful] = beyond[doubtful] / (allowed + AGREEMENT * size) - 1
    return excess, scale


@cache
def _unit_lattice():
    """The lattice around a square of side one about the origin, (m, m, 2)."""
    half = LATTICE // np.sqrt(2) + 1
    number = np.stack(np.meshgrid(*2 * [np.arange(-half, half)]), axis=-1)
    turn = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
    return (number + 1 / np.pi) @ turn / LATTICE


class Lattice:
    """A turned square lattice within a domain, fine enough to meet what is a hundredth as wide.

    Parameters
    ----------
    domain : Domain

    Attributes
    ----------
    points : ndarray, (n, 2)
    pairs : ndarray of int, (p, 2)
        Neighbours among them.
    """

    def __init__(self, domain):
        self._domain = domain
        low, high = np.array(domain.box, dtype=float).T
        self._size = high - low
        unit = _unit_lattice()
        self._inside = (np.abs(unit) <= 0.5).all(axis=-1)
        theta = (low + high) / 2 + unit[self._inside] * self._size
        within = domain.contains(theta)
        self._inside[self._inside] = within
        self.points = theta[within]
        index = np.full(self._inside.shape, -1)
        index[self._inside] = np.arange(len(self.points))
        # All lines of one direction; of the other some, for what runs along the first.
        ends = (index[1:], index[:-1]), (index[::SPARSE, 1:], index[::SPARSE, :-1])
        pairs = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=-1) for a, b in ends])
        self.pairs = pairs[(pairs >= 0).all(axis=1)]

    def minima(self, values):
        """The points of the lowest local minima of values (n,) at the points, (m, 2)."""
        grid = np.full(self._inside.shape, np.inf)
        grid[self._inside] = values
        around = np.pad(grid, 1, constant_values=np.inf)
        rows = np.minimum(np.minimum(around[:, :-2], around[:, 1:-1]), around[:, 2:])
        least = np.minimum(np.minimum(rows[:-2], rows[1:-1]), rows[2:])
        found = np.flatnonzero((least == grid)[self._inside])
        return self.points[found[np.argsort(values[found])[:LOWEST]]]

    def singular_point(self, measures, values, falls):
        """Where one of some positive measures falls to zero between the points.

        Parameters
        ----------
        measures : callable
            From points (n, 2) to positive numbers (k, n).
        values : ndarray, (k, n)
            Those of the lattice.
        falls : sequence
            By what factor at least each falls towards a zero as the distance falls from 1e-5 to
            1e-9 of the box. Elsewhere they have come to rest.

        Returns
        -------
        ndarray, (2,), or None
        """
        starts = [self.minima(row) for row in values]
        kind = np.repeat(np.arange(len(starts)), [len(start) for start in starts])
        every = np.repeat(kind, len(STENCIL)), np.arange(len(kind) * len(STENCIL))
        at = np.concatenate(starts)
        for level in range(FIRST, LAST + 1):
            trial = at[:, None] + 0.5**level * self._size * STENCIL
            reached = measures(trial.reshape(-1, 2))[every].reshape(len(at), -1)
            reached = np.where(np.isnan(reached), 0.0, reached)
            reached = np.where(self._domain.contains(trial), reached, np.nan)
            at = trial[np.arange(len(at)), np.nanargmin(reached, axis=1)]
            if level == MIDDLE:
                earlier = np.nanmedian(reached, axis=1)  # the least may be near a zero by chance
        singular = np.flatnonzero(np.nanmin(reached, axis=1) <= earlier / np.asarray(falls)[kind])
        return at[singular[0]] if len(singular) else None
