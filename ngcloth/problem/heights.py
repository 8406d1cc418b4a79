"""Heights on a grid, as a chart that NGSolve differentiates."""

from math import factorial

import ngsolve as ngs
import numpy as np

from ..errors import InputError
from .domain import Rectangle

DEGREE = 5  # the curvature then has continuous second derivatives
FARTHEST = 1e9  # splines through larger numbers overflow
MOST = 1_000_000  # heights: 36 numbers each


class Heights:
    """The chart (θ1, θ2) → (θ1, θ2, z), z the tensor product spline through heights on a grid.

    In each cell of the grid z is a polynomial. Its coefficients are tables that are constant there,
    which NGSolve differentiates to zero, as it should.

    Parameters
    ----------
    x, y, z : array_like, (nx,), (ny,), (nx, ny)
        As for `Surface.from_heights`.
    """

    def __init__(self, x, y, z):
        self.x, self.y = _grid_line("x", x), _grid_line("y", y)
        self.z = _numbers("z", z)
        shape = len(self.x), len(self.y)
        if self.z.shape != shape:
            raise InputError("z", self.z.shape, f"heights z[i, j] at (x[i], y[j]), shape {shape}")
        if self.z.size > MOST:
            raise InputError("z", shape, f"at most {MOST:,} heights")

    @property
    def rectangle(self):
        """The rectangle of the grid."""
        return Rectangle(*((float(line[0]), float(line[-1])) for line in (self.x, self.y)))

    def __call__(self, theta1, theta2):
        """The three components of φ."""
        along = _taylor(self.y, _taylor(self.x, self.z).transpose(2, 0, 1))
        coefficients = along.transpose(2, 0, 1, 3)  # power of θ1, of θ2; cell in y, in x
        # One cell more on each side, with the polynomial of the last: NGSolve may read beyond a
        # table just before its end.
        (first1, last1), (first2, last2) = self.rectangle.box
        step1, step2 = self.x[1] - self.x[0], self.y[1] - self.y[0]
        low, high = (first1 - step1, first2 - step2), (last1 + step1, last2 + step2)
        shape = coefficients.shape[2:]
        # Where it is the coordinates that are looked up, NGSolve does so several times faster.
        options = {"linear": False}
        if not (theta1 is ngs.x and theta2 is ngs.y):
            options["trafocf"] = ngs.CF((theta1, theta2))

        def table(values):
            values = np.pad(np.broadcast_to(values, shape), 1, mode="edge")
            return ngs.VoxelCoefficient(low, high, values, **options)

        s = theta1 - table(self.x[:-1])
        t = theta2 - table(self.y[:-1, None])
        height = ngs.CF(0.0)
        for power in coefficients[::-1]:
            row = ngs.CF(0.0)
            for values in power[::-1]:
                row = row * t + table(values)
            height = height * s + row
        return theta1, theta2, height


def _taylor(x, values):
    """Coefficients of the spline through values (n, ...) at x, (degree + 1, n − 1, ...).

    They are those of the powers of the distance from the left end of each interval.
    """
    from scipy.interpolate import make_interp_spline  # takes time, and sets filters of warnings

    spline = make_interp_spline(x, values, k=DEGREE)
    return np.stack([spline(x[:-1], nu=k) / factorial(k) for k in range(DEGREE + 1)])


def _numbers(name, values):
    try:
        if np.iscomplexobj(values):
            raise TypeError("complex")
        array = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(name, values, f"an array of finite numbers ({error})") from error
    if not (np.abs(array) < FARTHEST).all():
        where = tuple(map(int, np.argwhere(~(np.abs(array) < FARTHEST))[0]))
        allowed = f"finite numbers below {FARTHEST:g}; this is {name}[{where}]"
        raise InputError(name, float(array[where]), allowed)
    return array


def _grid_line(name, values):
    line = _numbers(name, values)
    allowed = f"{DEGREE + 1} or more increasing, evenly spaced numbers"
    if line.ndim != 1 or len(line) <= DEGREE:
        raise InputError(name, line.shape, allowed)
    steps = np.diff(line)
    if not (steps > 0).all() or np.ptp(steps) > 1e-6 * steps.mean():
        raise InputError(name, float(steps[np.argmax(np.abs(steps - steps.mean()))]), allowed)
    return line
