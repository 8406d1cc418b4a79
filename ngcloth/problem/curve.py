"""A monotone curve through the rows of a test, and its energy as an expression of NGSolve."""

from dataclasses import dataclass
from functools import cached_property

import ngsolve as ngs
import numpy as np

DEGREE = 2  # of the stiffness: the energy then has three continuous derivatives
PIECES = 48
WEIGHTS = np.logspace(-9, 6, 31)  # of smoothness, from which one is chosen
CAUTION = 1.4  # Kim and Gu (2004): with 1, one choice in ten is too rough


@dataclass(frozen=True)
class Readings:
    """Rows of a test: each says what a weighted sum of values of an unknown curve f is.

    Attributes
    ----------
    at, weight : ndarray, (rows, terms)
        Where f is taken, all positive, and with which weight.
    value : ndarray, (rows,)
        Σ weight f(at), as measured.
    """

    at: np.ndarray
    weight: np.ndarray
    value: np.ndarray

    def points(self, curve):
        """What each row says of f at the first of its terms if `curve` holds at the others."""
        others = (self.weight[:, 1:] * curve.force(self.at[:, 1:])).sum(axis=1)
        return self.at[:, 0], (self.value - others) / self.weight[:, 0]

    def misfit(self, curve):
        """What is measured, less what `curve` gives, in the unit of f, (rows,)."""
        return self.points(curve)[1] - curve.force(self.at[:, 0])


@dataclass(frozen=True)
class Curve:
    """A force f of a strain s, f(0) = 0, that never falls, with its energy ∫ f ds.

    f' is a spline of degree 2 with coefficients ≥ 0.

    Parameters
    ----------
    knots, coefficients : tuple of float
        Of the energy, a spline of degree 4 as `ngsolve.BSpline` takes it.
    end : float
        The greatest strain of the data; beyond, f' goes on as at the end and never falls below
        what it is there.
    """

    knots: tuple
    coefficients: tuple
    end: float

    @classmethod
    def through(cls, readings, even):
        """The smooth monotone curve nearest to readings.

        Penalised least squares with B-splines (Eilers and Marx, 1996), the weight of the penalty
        by generalised cross-validation, under f' ≥ 0 by non-negative least squares.

        Parameters
        ----------
        readings : Readings
            What was measured.
        even : bool
            Whether f(−s) = −f(s). If not, f' stays what it is at 0 for s < 0.

        Returns
        -------
        Curve
        """
        from scipy.interpolate import BSpline  # takes time, and sets filters of warnings
        from scipy.optimize import nnls

        end = float(readings.at.max())
        knots, ties = _basis(end, even)
        basis = BSpline(knots, ties, DEGREE)
        force = basis.antiderivative()
        matrix = readings.weight[:, :, None] * (force(readings.at) - force(0.0))
        matrix, bends = matrix.sum(axis=1), _second_differences(ties, even)
        bends *= np.sqrt(_smoothness(matrix, bends, readings.value))
        left = np.concatenate([matrix, bends])
        right = np.concatenate([readings.value, np.zeros(len(bends))])
        free, _ = nnls(left, right, maxiter=100 * left.shape[1])

        stiffness = ties @ free
        last = ties.shape[1] - 1
        beyond = np.flatnonzero(ties[:, last])[1:]
        stiffness[beyond] = max(free[last], float(basis(end) @ free))
        below = np.flatnonzero(ties[:, 0])[:-1]
        if even:
            stiffness[: len(knots) // 2 - 1] = stiffness[::-1][: len(knots) // 2 - 1]
        else:
            stiffness[below] = max(free[0], float(basis(0.0) @ free))
        energy = BSpline(knots, stiffness, DEGREE)
        for _ in range(2):
            energy = energy.antiderivative()
            energy = BSpline(energy.t, energy.c - energy(0.0), energy.k)
        number = len(energy.t) - energy.k - 1
        return cls(tuple(energy.t.tolist()), tuple(energy.c[:number].tolist()), end)

    @cached_property
    def _spline(self):
        from scipy.interpolate import BSpline

        return BSpline(self.knots, self.coefficients, DEGREE + 2)

    def __getstate__(self):
        return {name: self.__dict__[name] for name in self.__dataclass_fields__}

    def energy(self, strain):
        """∫ f ds, of numbers."""
        return self._spline(strain)

    def force(self, strain):
        """The force f, of numbers."""
        return self._spline(strain, 1)

    def expression(self, strain):
        """∫ f ds, of an expression of NGSolve."""
        return ngs.BSpline(DEGREE + 3, list(self.knots), list(self.coefficients))(strain)


def _basis(end, even):
    """Knots, and the matrix from the free coefficients of f' to all.

    Splines that do not meet the data have the coefficient of the nearest that does: f' ends
    constant. NGSolve takes a spline for zero below its knots, so these begin where no strain is.
    """
    step = end / PIECES
    margin = DEGREE + 2
    far = max(1.0, end + margin * step) + step
    if even:
        inner, low = np.arange(-PIECES - margin, PIECES + margin + 1) * step, -far
    else:
        inner, low = np.arange(-margin, PIECES + margin + 1) * step, -1.0
    ends = np.ones(DEGREE + 1)
    knots = np.concatenate([low * ends, inner, far * ends])
    number = len(knots) - DEGREE - 1
    tiny = 1e-6 * step
    meets = (knots[:number] < end - tiny) & (knots[DEGREE + 1 :] > tiny)
    first, last = np.flatnonzero(meets)[[0, -1]]
    column = np.arange(number)
    if even:
        column = np.maximum(column, column[::-1])
        first = column.min()
    column = np.clip(column, first, last) - first
    return knots, np.eye(last - first + 1)[column]


def _second_differences(ties, even):
    """Of neighbouring coefficients of f', so that the penalty stands for ∫ (f''')²."""
    free = ties.shape[1]
    if not even:
        return np.diff(np.eye(free), 2, axis=0)
    outer = np.flatnonzero(ties[:, -1])
    middle = len(ties) // 2
    return np.diff(ties[outer[outer < middle][-1] : outer[outer >= middle][0] + 1], 2, axis=0)


def _smoothness(matrix, bends, value):
    """The weight of the penalty that generalised cross-validation chooses."""
    normal, penalty = matrix.T @ matrix, bends.T @ bends
    weights = WEIGHTS * np.trace(normal) / np.trace(penalty)
    scores = []
    for weight in weights:
        inverse = np.linalg.pinv(normal + weight * penalty, hermitian=True)
        missed = value - matrix @ (inverse @ (matrix.T @ value))
        freedom = np.trace(inverse @ normal)
        scores.append(missed @ missed / max(len(value) - CAUTION * freedom, 1e-3) ** 2)
    return weights[int(np.argmin(scores))]
