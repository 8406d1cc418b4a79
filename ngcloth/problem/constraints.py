"""The limits the cloth must respect: each is a name and its slacks, positive where it holds."""

from dataclasses import dataclass

from ..errors import check_number

RIM_SHARE = 0.04  # what the limits on the rim weigh in barriers, over those inside


@dataclass(frozen=True)
class Elongation:
    """No thread is slack: λ1 ≥ 1 and λ2 ≥ 1 (eq. 3), and so in all families of the fabric."""

    name = "elongation"

    def slacks(self, cloth):
        """1 − 1/λ of each family."""
        # 1/λ1 is linear in ψ1 where λ1 is hyperbolic: steps along its tangent stay feasible.
        return tuple(1 - 1 / stretch for stretch in cloth.stretches)


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


@dataclass(frozen=True)
class Obstacle:
    """The surface pushes and never pulls: τ ≥ 0 (eq. 5)."""

    name = "obstacle"

    def slacks(self, cloth):
        """τ, by Laplace's law, over kc."""
        return (cloth.reaction / cloth.fabric.stiffness,)
