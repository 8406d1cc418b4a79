"""Raw records of the two tests of shear, with the sizes of the specimen, as readings of one curve.

The shear force per length N that both measure, as a function of the shear angle φ (90° minus the
angle between the threads), is the tangential force along a side over the length of the side. Its
power per flat area is N cos φ dφ/dt: it is the derivative of the energy by γ = sin φ.
"""

from dataclasses import dataclass

import numpy as np

from ..errors import check_number
from .curve import Readings
from .tables import rising_table

LARGEST_ANGLE = 89.0  # degrees


@dataclass(frozen=True, eq=False)
class PictureFrame:
    """A square specimen in a frame of four hinged arms, two opposite corners pulled apart.

    With arms of length L, the angle φ follows from the displacement d, √2 L + d = 2 L cos(45° −
    φ/2), and N = F L / (2 cos(45° − φ/2) l²), l being the side of the specimen (Cao et al., 2008,
    Composites A 39:1037; Harrison, Clifford and Long, 2004, Composites Sci. Technol. 64:1453).

    Parameters
    ----------
    record : array_like, (n, 2), or path of a CSV file
        Displacement of the corner and force F, row by row, displacement rising.
    arm : float
        L, from hinge to hinge, in the unit of the displacement.
    side : float, optional
        l, of the specimen without its arms; by default L.

    Raises
    ------
    InputError
        With row and value.
    """

    record: object
    arm: float
    side: float | None = None

    def readings(self, name):
        """The rows as `Readings` of N by sin φ; errors call them `name`."""
        arm = check_number(f"{name}.arm", self.arm, 0, open_low=True)
        side = arm if self.side is None else self.side
        side = check_number(f"{name}.side", side, 0, arm, open_low=True)
        table = rising_table(name, self.record, ("displacement", "force"))
        half = _half_angle(table, arm)
        per_force = arm / (2 * np.cos(half) * side**2)
        gamma = np.cos(2 * half)[:, None]
        return table, Readings(gamma, np.ones_like(gamma), table.force * per_force)


@dataclass(frozen=True, eq=False)
class BiasExtension:
    """A strip cut at 45° to the threads, pulled along its length.

    Threads that do not stretch leave two triangles at the clamps unsheared; between them the strip
    of length H and width w has a middle of area (2H − 3w)w/2 sheared by φ, H − w + d = √2 (H − w)
    cos(45° − φ/2), and areas of w² in all sheared by φ/2. The power of the force F then says

        F (H − w) (cos φ/2 − sin φ/2) = (2H − 3w) w cos φ N(φ) + w² cos φ/2 N(φ/2)

    (Cao et al., 2008, Composites A 39:1037). All rows are solved for N at once.

    Parameters
    ----------
    record : array_like, (n, 2), or path of a CSV file
        Displacement d of the clamp and force F, row by row, displacement rising.
    length, width : float
        H between the clamps, at least 2 w, and w, in the unit of the displacement.

    Raises
    ------
    InputError
        With row and value.
    """

    record: object
    length: float
    width: float

    def readings(self, name):
        """The rows as `Readings` of N by sin φ; errors call them `name`."""
        width = check_number(f"{name}.width", self.width, 0, open_low=True)
        length = check_number(f"{name}.length", self.length, 2 * width)
        table = rising_table(name, self.record, ("displacement", "force"))
        half = _half_angle(table, (length - width) / np.sqrt(2))
        angle = np.pi / 2 - 2 * half
        at = np.sin(np.stack([angle, angle / 2], axis=-1))
        middle = (2 * length - 3 * width) * width * np.cos(angle)
        weight = np.stack([middle, width**2 * np.cos(angle / 2)], axis=-1)
        power = table.force * (length - width) * (np.cos(angle / 2) - np.sin(angle / 2))
        # In the unit of N, that rows count as they do in a picture frame.
        return table, Readings(at, weight / middle[:, None], power / middle)


def angle_readings(name, source):
    """The rows of a table of shear angle in degrees against shear force per length."""
    table = rising_table(name, source, ("angle", "force"))
    beyond = np.flatnonzero(table.at > LARGEST_ANGLE)
    if len(beyond):
        raise table.refusal(beyond[0], f"a shear angle in degrees, at most {LARGEST_ANGLE:g}")
    if table.at[-1] < np.pi / 2:
        raise table.refusal(-1, "shear angles in degrees that reach 2° or more, not radians")
    gamma = np.sin(np.radians(table.at))[:, None]
    return table, Readings(gamma, np.ones_like(gamma), table.force)


def _half_angle(table, arm):
    """Half the angle between the threads, where a frame of such arms is pulled by the table."""
    cosine = (np.sqrt(2) * arm + table.at) / (2 * arm)
    limit = np.cos(np.radians(90 - LARGEST_ANGLE) / 2)
    beyond = np.flatnonzero(cosine > limit)
    if len(beyond):
        most = 2 * arm * limit - np.sqrt(2) * arm
        allowed = f"a displacement that the specimen's size allows, at most {most:.4g}"
        raise table.refusal(beyond[0], allowed)
    half = np.arccos(cosine)
    if np.degrees(np.pi / 2 - 2 * half[-1]) < 2:
        allowed = "displacements in the unit of the specimen's size that shear it by 2° or more"
        raise table.refusal(-1, allowed)
    return half
