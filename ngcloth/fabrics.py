"""Fabrics as their tests say."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .errors import InputError
from .problem.curve import Curve, Readings
from .problem.shear_tests import BiasExtension, PictureFrame, angle_readings
from .problem.tables import rising_table

FALLS = 0.1  # of the greatest force: rows that a rising curve misses by more
LONGEST = 5.0  # a stretch
UNEQUAL = 1e6  # of warp and weft
SHEAR_STIFFNESSES = 1e-9, 1e3  # over that of the threads
NEVER = (
    "warp and weft pulled at once (their forces are taken to be independent)",
    "shear of stretched cloth (taken to depend on I8 = λ1 λ2 sin φ)",
    "unloading and speed (there is one curve for both ways)",
)


@dataclass(frozen=True, eq=False)
class MeasuredFabric:
    """The fabric of three tests, W = W1(I4) + W2(I6) + W3(I8).

    Each part is the integral of a smooth curve through the rows of a test that never falls: W is
    convex in C, and has three continuous derivatives. Beyond the last row of a test the slope of
    the curve goes on as it is there; for a thread shorter than at rest it is that at λ = 1; shear
    has the same curve in both directions. All lengths and forces are in units of one system, such
    as mm and N.

    Tension is dW/dλ = 2 λ W1'. In a test of shear, whose threads do not stretch, I8 = sin φ, φ
    being the shear angle (90° minus the angle between the threads), and the force is W3'. In cloth
    that is stretched as well I8 = λ1 λ2 sin φ, and so locking begins at a smaller angle.

    Parameters
    ----------
    warp, weft : array_like, (n, 2), or path of a CSV file
        Stretch λ (length over length at rest, from 1 on) against force per width at rest, row by
        row, λ rising. A CSV file may have one line of headings.
    shear : array_like, (n, 2), path of a CSV file, `PictureFrame` or `BiasExtension`
        Shear angle in degrees against shear force per length, dW/dγ; or a raw record.

    Attributes
    ----------
    curves : dict of Curve
        The derivatives of W: "warp" by I4 − 1, "weft" by I6 − 1, "shear" by I8.
    scatter : dict of float
        Root mean square of what the rows differ from these by, over the greatest force.
    undetermined : list of str
        What the tests do not say, and what is assumed there.
    stiffness : float
        By which energies are normalised: the mean kc of nets whose threads bear the same as these
        at the end of the tests.

    Raises
    ------
    InputError
        Naming row and value: if there are fewer than five, if the first column does not rise, if
        no rising curve comes near a row, if forces are negative, if stretches, angles or units
        cannot be.
    """

    warp: object
    weft: object
    shear: object

    def __post_init__(self):
        tests = {name: _stretch_readings(name, getattr(self, name)) for name in ("warp", "weft")}
        if isinstance(self.shear, PictureFrame | BiasExtension):
            tests["shear"] = self.shear.readings("shear")
        else:
            tests["shear"] = angle_readings("shear", self.shear)
        readings = {name: rows for name, (_, rows) in tests.items()}
        curves = {name: Curve.through(each, name == "shear") for name, each in readings.items()}
        for name, (table, rows) in tests.items():
            _check_rise(table, rows, curves[name])
        object.__setattr__(self, "readings", readings)
        object.__setattr__(self, "curves", curves)
        ratio = _secant(curves["warp"]) / _secant(curves["weft"])
        if not 1 / UNEQUAL <= ratio <= UNEQUAL:
            allowed = "forces in the unit of the weft: the warp is {:.1e} as stiff"
            raise tests["warp"][0].refusal(-1, allowed.format(ratio))
        ratio = _secant(curves["shear"]) / (2 * self.stiffness)
        if not SHEAR_STIFFNESSES[0] <= ratio <= SHEAR_STIFFNESSES[1]:
            table = tests["shear"][0]
            allowed = "forces in the unit of warp and weft: shear is {:.1e} as stiff as they are"
            raise table.refusal(-1, allowed.format(ratio))

    @cached_property
    def stiffness(self):  # noqa: D102
        return (_secant(self.curves["warp"]) + _secant(self.curves["weft"])) / 4

    @property
    def scatter(self):  # noqa: D102
        return {name: _scatter(rows, self.curves[name]) for name, rows in self.readings.items()}

    @property
    def undetermined(self):  # noqa: D102
        texts = []
        for name in ("warp", "weft"):
            texts.append(f"{name} beyond λ = {self.longest(name):.4g} (stiffness as there)")
            texts.append(f"{name} below λ = 1 (stiffness as at 1)")
        angles = np.degrees(np.arcsin(self.readings["shear"].at))
        if angles.min() > 0.1 * angles.max():
            texts.append(f"shear below {angles.min():.3g}° (smooth down to no force at 0°)")
        texts.append(f"shear beyond {angles.max():.3g}° (stiffness as there)")
        return texts + list(NEVER)

    def energy(self, I4, I6, I8):
        """W at the invariants I4 = λ1², I6 = λ2², I8 = λ1 λ2 γ."""
        warp, weft, shear = self.curves.values()
        return warp.expression(I4 - 1) + weft.expression(I6 - 1) + shear.expression(I8)

    def longest(self, name):
        """The greatest stretch λ in the test of "warp" or "weft"."""
        if name not in ("warp", "weft"):
            raise InputError("name", name, '"warp" or "weft"')
        return float(np.sqrt(1 + self.curves[name].end))

    def plot(self, axes=None):
        """Draw the curves over the rows of the tests, see `ngcloth.plot_fabric.draw`."""
        from .output.plot_fabric import draw

        return draw(self, axes)

    def __str__(self):
        ends = [f"{name} to λ = {self.longest(name):.4g}" for name in ("warp", "weft")]
        angle = np.degrees(np.arcsin(self.curves["shear"].end))
        rough = max(self.scatter.values())
        return f"measured, {', '.join(ends)}, shear to {angle:.3g}°, rows within {rough:.1%}"

    __repr__ = __str__


def _stretch_readings(name, source):
    """The rows of a table of stretch against force per width."""
    table = rising_table(name, source, ("stretch", "force"))
    if table.at[0] < 1:
        allowed = "stretches from 1 on, length over length at rest, not strains"
        raise table.refusal(0, allowed)
    for row in np.flatnonzero(table.at > LONGEST)[:1]:
        raise table.refusal(row, f"a stretch of at most {LONGEST:g}, not in percent")
    if table.at[-1] < 1 + 1e-6:
        raise table.refusal(-1, "a stretch above 1 in the last row")
    stretch = table.at[:, None]
    return table, Readings(stretch**2 - 1, 2 * stretch, table.force)


def _check_rise(table, readings, curve):
    """Refuse rows that no rising curve comes near."""
    missed = np.abs(readings.misfit(curve))
    row = int(missed.argmax())
    most = np.abs(readings.points(curve)[1]).max()
    if missed[row] > FALLS * most:
        allowed = "forces that rise: a curve that does misses this row by {:.0%} of the greatest"
        raise table.refusal(row, allowed.format(missed[row] / most))


def _secant(curve):
    return float(curve.force(curve.end)) / curve.end


def _scatter(readings, curve):
    forces = readings.points(curve)[1]
    return float(np.sqrt(np.mean(readings.misfit(curve) ** 2)) / np.abs(forces).max())
