"""Do limits hold, and is J > 0, between the points too? Proofs by Bernstein coefficients.

On the reference triangle ψ is a polynomial of degree p, and with it ψ's derivatives by ξ and η, the
directions t1 = (∂ηψ2, −∂ξψ2) and t2 = (−∂ηψ1, ∂ξψ1) of X1 and X2 there, those of all threads,
cos φ t1 + sin φ t2, and their J. Of the metric â = Fᵀ a F by ξ and η, then

    λ1² = â(t1, t1) / J²,   λ2² = â(t2, t2) / J²,   γ² = â(t1, t2)² / (â(t1, t1) â(t2, t2)),

which are ratios of polynomials if â is one. A ratio lies above the least ratio of Bernstein
coefficients, and parts of a triangle have closer ones (Farouki, 2012).

â is interpolated by a polynomial of degree 2 (p − 1), if that is 4 to `HIGHEST`, or higher where
that is not accurate. What it leaves out is not bounded but measured, over a lattice of twice its
degree, and `SAFETY` times as much taken off all bounds: the one part of them that is not proven.
On surfaces from files â is a polynomial of that degree, and nothing is left out.
"""

import ngsolve as ngs
import numpy as np

from ..problem.fabric import directions
from .bernstein import basis, corners, derivatives, exponents, fit, halves, lattice, product, raised

LOWEST, HIGHEST = 4, 10  # degree of the metric's interpolation
ACCURATE = 1e-4  # an error at which it is not raised
SAFETY = 2  # times the error of that between the points where it was measured
HALVINGS = 8  # of a triangle, at most


class Between:
    """The stretches and the shear of a patch everywhere.

    Parameters
    ----------
    patch : Patch

    Attributes
    ----------
    error : float
        Of the metric's interpolation, relative to the metric, `SAFETY` included.
    sheet : Sheet
        The surface on the mesh of the patch.
    lines : list of (ndarray, ndarray)
        The direction of each family of threads in the reference triangles.
    degree : int
        Of `product` and `area_square`.
    """

    def __init__(self, patch):
        self.triangles, self.sheet = patch.triangles, patch.sheet
        self._degree = patch.order - 1
        (a, b), (c, d) = np.einsum("tin,xmn->ixtm", patch.psi, derivatives(patch.order))
        both = self._degree, self._degree
        self._area = product(a, d, both) - product(b, c, both)
        lines = directions(patch.scene.fabric)
        self.lines = [(x1 * d - x2 * b, x2 * a - x1 * c) for x1, x2 in lines]
        lowest = int(np.clip(2 * self._degree, LOWEST, HIGHEST))
        for degree in range(lowest, HIGHEST + 1, 2):
            self._interpolate_metric(degree)
            if self.error <= ACCURATE:
                break

    def _interpolate_metric(self, degree):
        """Interpolate the metric, and measure what that leaves out."""
        fine, points = lattice(2 * degree), self.triangles.at_lattice(2 * degree)
        expressions = ngs.CF((self.sheet.metric, ngs.specialcf.JacobianMatrix(2))).Compile()
        values = expressions(points).reshape(len(self.triangles), -1, 2, 2, 2)
        element = values[:, :, 1]
        metric = element.swapaxes(2, 3) @ values[:, :, 0] @ element
        metric = np.moveaxis(metric[:, :, [0, 0, 1], [0, 1, 1]], 2, 0)
        known = (exponents(2 * degree) % 2 == 0).all(axis=1)
        self._metric, self._metric_degree = metric[:, :, known] @ fit(degree).T, degree
        (a11, a12, a22), (d11, d12, d22) = metric, metric - self._metric @ basis(degree, fine).T
        # The largest eigenvalue of â⁻¹ δâ: no square of a length is off by more.
        square = a11 * a22 - a12**2
        half = (a22 * d11 - 2 * a12 * d12 + a11 * d22) / (2 * square)
        root = np.sqrt(np.maximum(half**2 - (d11 * d22 - d12**2) / square, 0.0))
        self.error = SAFETY * float((np.abs(half) + root).max())
        jacobians = self._area @ basis(2 * self._degree, fine).T / np.linalg.det(element)
        self.jacobian = float(jacobians.min())

    def unfolded(self):
        """Whether J > 0 on all of every triangle, straight or curved."""
        ones = np.ones_like(self._area)
        return least_ratio(self._area, ones, 2 * self._degree, 0.0)[0] > 0

    @property
    def degree(self):  # noqa: D102
        return 2 * self._degree + max(self._metric_degree, 2 * self._degree)

    @property
    def area_square(self):
        """J²."""
        area = 2 * self._degree
        return raised(product(self._area, self._area, (area, area)), 2 * area, self.degree)

    def product(self, s, t):
        """â(s, t) of two directions."""
        degree, metric = self._degree, self._metric_degree
        both = degree, degree
        mixed = product(s[0], t[1], both) + product(s[1], t[0], both)
        terms = product(s[0], t[0], both), mixed, product(s[1], t[1], both)
        whole = sum(
            product(a, term, (metric, 2 * degree))
            for a, term in zip(self._metric, terms, strict=True)
        )
        return raised(whole, metric + 2 * degree, self.degree)


def least_ratio(above, below, degree, enough):
    """A lower bound of a ratio of polynomials on triangles.

    Parameters
    ----------
    above, below : ndarray, (triangles, n)
        Bernstein coefficients of numerator and denominator; the latter is > 0, if not all its
        coefficients are.
    degree : int
        Of both.
    enough : float
        Triangles are halved until their bounds are above, unless the ratio itself is not.

    Returns
    -------
    bound : float
        −inf where no bound is found.
    halvings : int
        How often the worst triangles were halved.
    """
    bound, at_corners = np.inf, corners(degree)
    for number in range(HALVINGS + 1):
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = above / below
        bounds = np.where(below.min(axis=1) > 0, ratios.min(axis=1), -np.inf)
        less = ~(bounds >= enough)
        hopeless = less & (ratios[:, at_corners].min(axis=1) < enough)
        if number == HALVINGS or hopeless.any() or not less.any():
            break
        bound = min(bound, bounds[~less].min(initial=np.inf))
        above, below = (
            np.concatenate([part[less] @ half.T for half in halves(degree)])
            for part in (above, below)
        )
    return float(min(bound, bounds.min(initial=np.inf))), number
