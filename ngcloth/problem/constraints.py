"""The limits the cloth must respect: each is a name and its slacks, positive where it holds."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import check_number

ROUNDING = 1e-13  # of τ/kc: a flat surface neither pushes nor pulls, whatever ψ
RIM_SHARE = 0.04  # what the limits on the rim weigh in barriers, over those inside
EDGE = 1e-9  # of a triangle: rounding
MOST = 435  # points a triangle: a lattice of twice the highest order of ψ has no more


class LimitPoints(NamedTuple):
    """Points at which limits are asked beside those of the integration rules.

    Attributes
    ----------
    triangles : ndarray of int, (n,)
        Their triangles, by number in the mesh.
    reference : ndarray, (n, 2)
        Where they are in NGSolve's reference triangle (0, 0), (1, 0), (0, 1), edges included.
    """

    triangles: np.ndarray = np.empty(0, dtype=int)
    reference: np.ndarray = np.empty((0, 2))

    def check(self, triangles):
        """Raise `ValueError` unless all are points of a mesh of so many triangles."""
        numbers, (x, y) = self.triangles, np.reshape(self.reference, (-1, 2)).T
        kinds = np.asarray(numbers).dtype.kind == "i" and self.reference.dtype.kind == "f"
        if not kinds or numbers.ndim != 1 or self.reference.shape != (len(numbers), 2):
            raise ValueError("limit points are not whole numbers (n,) and numbers (n, 2)")
        inside = (x >= -EDGE) & (y >= -EDGE) & (x + y <= 1 + EDGE)
        if not (np.all((numbers >= 0) & (numbers < triangles)) and inside.all()):
            raise ValueError("limit points lie outside the triangles")
        if len(numbers) > MOST * triangles:
            raise ValueError(f"there are more than {MOST} limit points a triangle")

    def joined(self, others):
        """These, and then others that are not among them, as of `LimitPoints`."""
        both = LimitPoints(*map(np.concatenate, zip(self, others, strict=True)))
        names = np.column_stack([both.triangles, np.round(both.reference, 9)])
        _, first = np.unique(names, axis=0, return_index=True)
        first = np.sort(first)
        return LimitPoints(both.triangles[first], both.reference[first])


@dataclass(frozen=True)
class Elongation:
    """No thread is slack: λ1 ≥ 1 and λ2 ≥ 1 (eq. 3), and so in all families of the fabric."""

    name = "elongation"

    def slacks(self, cloth):
        """1 − 1/λ of each family."""
        # 1/λ1 is linear in ψ1 where λ1 is hyperbolic: steps along its tangent stay feasible.
        return tuple(1 - 1 / stretch for stretch in cloth.stretches)

    def scale(self, values):
        """What counts as one in a slack whose `values` are these: a stretch."""
        return 1.0


@dataclass(frozen=True)
class ShearLimit:
    """The threads keep an angle: |γ| ≤ maximum < 1 (eq. 4).

    Parameters
    ----------
    maximum : float
        γmax, the cosine of the smallest angle allowed between warp and weft, or any two families,
        in (0, 1).
    """

    maximum: float
    name = "shear limit"

    def __post_init__(self):
        maximum = check_number("shear_limit", self.maximum, 0, 1, open_low=True, open_high=True)
        object.__setattr__(self, "maximum", maximum)

    def slacks(self, cloth):
        """γmax² − γ² of each two families."""
        return tuple(self.maximum**2 - shear**2 for shear in cloth.shears)

    def scale(self, values):
        """What counts as one in a slack whose `values` are these: a change of |γ|."""
        return 2 * self.maximum


@dataclass(frozen=True)
class Obstacle:
    """The surface pushes and never pulls: τ ≥ 0 (eq. 5)."""

    name = "obstacle"

    def slacks(self, cloth):
        """τ, by Laplace's law, over kc, but for rounding."""
        return (cloth.reaction / cloth.fabric.stiffness + ROUNDING,)

    def scale(self, values):
        """What counts as one in a slack whose `values` are these: the largest |τ|."""
        return abs(values).max() or 1.0
