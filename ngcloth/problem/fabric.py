"""Fabrics: strain energy per unit flat area as a function of I4, I6, I8, and thread directions.

A fabric has an ``energy(I4, I6, I8)`` and a `stiffness`. Its threads run along X1 and X2, unless
it has `angles`: of each family, in degrees from X1 towards X2. One that differs from place to place
in the cloth has ``of_place = True`` and an ``energy(I4, I6, I8, X1, X2)``; one that resists bending
``of_curvature = True`` and ``energy(I4, I6, I8, K11, K22, K12)``; if both, the place comes last.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..errors import InputError, check_number

STIFFNESSES = 1e-30, 1e30  # squares of their ratios do not overflow
RIGHT_ANGLES = (0.0, 90.0)
GROWTHS = 1e-3, 1e3
APART = 1e-3  # degrees between lines


@dataclass(frozen=True)
class Net:
    """The paper's elastic net, W = kc (I4 − 1)² + kc (I6 − 1)² + ks I8² (eq. 25, corrected).

    Parameters
    ----------
    kc : float or (float, float)
        Stiffness of the threads (force per length), from 1e-30 to 1e30; a pair gives warp and weft
        their own.
    ks : float
        Shear stiffness, in the same unit, at most 1e30. With ``ks=0`` shearing costs nothing, and
        the optimal patch of an unconstrained scene is a Chebyshev net.
    """

    kc: float | tuple = 1.0
    ks: float = 0.0

    def __post_init__(self):
        if isinstance(self.kc, tuple):
            if len(self.kc) != 2:
                raise InputError("kc", self.kc, "one stiffness, or a pair for warp and weft")
            kc = tuple(check_number("kc", stiffness, *STIFFNESSES) for stiffness in self.kc)
        else:
            kc = check_number("kc", self.kc, *STIFFNESSES)
        object.__setattr__(self, "kc", kc)
        object.__setattr__(self, "ks", check_number("ks", self.ks, 0, STIFFNESSES[1]))

    @classmethod
    def from_moduli(cls, E, G, thickness):
        """The net that for small strains is a sheet of given moduli along and across its threads.

        A strain e of a thread costs E t e²/2 per area, and kc (I4 − 1)² is 4 kc e²; shear by a
        small angle φ costs G t φ²/2, and ks I8² is ks φ². So kc = E t/8, ks = G t/2 and ks/kc =
        4 G/E. Lateral contraction is left out, as in all nets.

        Parameters
        ----------
        E : float or (float, float)
            Young's modulus along the threads, in MPa; a pair for warp and weft.
        G : float
            Shear modulus in the plane, in MPa.
        thickness : float
            t, in mm, of which E and G are those per area.

        Returns
        -------
        Net
            With kc and ks in N/mm, for surfaces in mm.
        """
        thickness = check_number("thickness", thickness, 0, open_low=True)
        moduli = E if isinstance(E, tuple) else (E,)
        kc = [check_number("E", modulus, 0, open_low=True) * thickness / 8 for modulus in moduli]
        ks = check_number("G", G, 0) * thickness / 2
        return cls(kc=tuple(kc) if isinstance(E, tuple) else kc[0], ks=ks)

    @property
    def stiffness(self):
        """The thread stiffness by which energies are normalised: the mean of warp and weft."""
        return sum(self.kc) / 2 if isinstance(self.kc, tuple) else self.kc

    def energy(self, I4, I6, I8):
        """W at the invariants I4 = λ1², I6 = λ2², I8 = λ1 λ2 γ."""
        threads = sum(root**2 for root in self.thread_roots(I4, I6))
        return threads + self.ks * I8**2 if self.ks else threads

    def thread_roots(self, I4, I6):
        """The two square roots of which the thread energy is the sum of squares."""
        warp, weft = self.kc if isinstance(self.kc, tuple) else (self.kc, self.kc)
        return np.sqrt(warp) * (I4 - 1), np.sqrt(weft) * (I6 - 1)


@dataclass(frozen=True)
class Families:
    """Threads in two or more directions, W = Σ kc (λ² − 1)² + ks Σ (t·C s − t·s)².

    The first sum is over families, the second over pairs of them with flat directions t and s; at
    right angles it is that of `Net`.

    Parameters
    ----------
    angles : sequence of float
        Of each family, in degrees from X1 towards X2: (0, 60, 120) for a triaxial weave, (45, −45)
        for a non-crimp fabric. Their lines are different ones.
    kc : float or sequence of float
        Stiffness of the threads (force per length), from 1e-30 to 1e30, of all or of each family.
    ks : float
        Stiffness against turning threads to each other, at most 1e30. With three directions or
        more threads alone hold the cloth.
    """

    angles: tuple
    kc: float | tuple = 1.0
    ks: float = 0.0

    def __post_init__(self):
        object.__setattr__(self, "angles", checked_angles("angles", self.angles))
        each = self.kc if isinstance(self.kc, tuple | list) else len(self.angles) * (self.kc,)
        if len(each) != len(self.angles):
            raise InputError("kc", self.kc, f"one stiffness, or {len(self.angles)}, one a family")
        object.__setattr__(self, "kc", tuple(check_number("kc", k, *STIFFNESSES) for k in each))
        object.__setattr__(self, "ks", check_number("ks", self.ks, 0, STIFFNESSES[1]))

    @property
    def stiffness(self):
        """The mean thread stiffness, by which energies are normalised."""
        return sum(self.kc) / len(self.kc)

    def energy(self, I4, I6, I8):
        """W at the invariants I4 = λ1², I6 = λ2², I8 = λ1 λ2 γ of the lines along X1 and X2."""
        lines, green = directions(self), (I4, I6, I8)
        terms = [k * (along(t, t, *green) - 1) ** 2 for k, t in zip(self.kc, lines, strict=True)]
        if self.ks:
            pairs = combinations(lines, 2)
            terms += [self.ks * (along(t, s, *green) - float(t @ s)) ** 2 for t, s in pairs]
        return sum(terms[1:], terms[0])


@dataclass(frozen=True)
class Turned:
    """Another fabric, laid so that what runs along X1 in it runs at an angle to X1 in the patch.

    Parameters
    ----------
    fabric : Net, MeasuredFabric or similar
        Any with `energy` and `stiffness` that depends on strain alone.
    angle : float
        In degrees, from X1 towards X2.
    """

    fabric: object
    angle: float

    def __post_init__(self):
        _check_inner(self, place=False)
        object.__setattr__(self, "angle", check_number("angle", self.angle, -360, 360))

    @property
    def angles(self):
        """Of its families, in degrees from X1."""
        own = getattr(self.fabric, "angles", RIGHT_ANGLES)
        return tuple(angle + self.angle for angle in own)

    @property
    def stiffness(self):
        """That of the other."""
        return self.fabric.stiffness

    def energy(self, I4, I6, I8):
        """W of the other, at its own invariants."""
        first, second = _units((self.angle, self.angle + 90))
        pairs = (first, first), (second, second), (first, second)
        return self.fabric.energy(*(along(*pair, I4, I6, I8) for pair in pairs))


@dataclass(frozen=True)
class Swollen:
    """Another fabric whose threads have grown: W(I4/g1², I6/g2², I8/(g1 g2)) of the other.

    With natural stretches of swelling, prestress or a tight knit, cloth is at rest where λ1 = g1,
    λ2 = g2 and the threads are at right angles. Limits are those of λ, as ever: `Elongation` asks
    for λ ≥ 1, not for λ ≥ g.

    Parameters
    ----------
    fabric : Net, MeasuredFabric or similar
        Any with `energy` and `stiffness` that depends on strain alone.
    growth : (float, float) or callable
        g1 and g2, from 1e-3 to 1e3; or a function of (X1, X2), the place in the flat cloth, that
        returns them as NGSolve expressions. X = 0 is the centre of the domain in symmetric scenes;
        in others the cloth lies where it costs least, which with g1 or g2 that grow without bound
        is nowhere.
    """

    fabric: object
    growth: tuple | Callable

    def __post_init__(self):
        _check_inner(self, place=False)
        if callable(self.growth):
            return
        if not isinstance(self.growth, tuple | list) or len(self.growth) != 2:
            raise InputError("growth", self.growth, "a pair (g1, g2), or a callable of (X1, X2)")
        pair = tuple(check_number("growth", g, *GROWTHS) for g in self.growth)
        object.__setattr__(self, "growth", pair)

    @property
    def angles(self):
        """Those of the other."""
        return getattr(self.fabric, "angles", RIGHT_ANGLES)

    @property
    def of_place(self):
        """Whether growth depends on the place."""
        return callable(self.growth)

    @property
    def stiffness(self):
        """That of the other."""
        return self.fabric.stiffness

    def energy(self, I4, I6, I8, *place):
        """W of the other, at its own invariants."""
        growth = self.growth(*place) if place else self.growth
        if not isinstance(growth, tuple | list) or len(growth) != 2:
            raise TypeError("`growth` must return a pair (g1, g2)")
        g1, g2 = growth
        return self.fabric.energy(I4 / (g1 * g1), I6 / (g2 * g2), I8 / (g1 * g2))


@dataclass(frozen=True)
class BendingThreads:
    """Another fabric whose threads resist bending: W + ½ Σ B κ² + D Σ τ².

    With K = G⁻ᵀ b G⁻¹, κ = t·K t/λ² is the normal curvature of the threads along t, and τ =
    t·K s/(λt λs) the twist of each two families. Curvature within the surface costs nothing.

    Parameters
    ----------
    fabric : Net, MeasuredFabric or similar
        Any with `energy` and `stiffness` that does not depend on curvature.
    bending : float or sequence of float
        B (force times length), of all families or of each.
    twist : float
        D, in the same unit.
    """

    fabric: object
    bending: float | tuple
    twist: float = 0.0
    of_curvature = True

    def __post_init__(self):
        _check_inner(self, place=True)
        families = len(directions(self))
        each = self.bending
        each = tuple(each) if isinstance(each, tuple | list) else families * (each,)
        if len(each) != families:
            raise InputError("bending", self.bending, f"one stiffness, or {families}")
        each = tuple(check_number("bending", one, 0, STIFFNESSES[1]) for one in each)
        object.__setattr__(self, "bending", each)
        object.__setattr__(self, "twist", check_number("twist", self.twist, 0, STIFFNESSES[1]))

    @property
    def angles(self):
        """Those of the other."""
        return getattr(self.fabric, "angles", RIGHT_ANGLES)

    @property
    def of_place(self):
        """Whether the other depends on the place."""
        return of_place(self.fabric)

    @property
    def stiffness(self):
        """That of the other."""
        return self.fabric.stiffness

    def energy(self, I4, I6, I8, K11, K22, K12, *place):
        """W of the other, and of curvature and twist."""
        energy, lines = self.fabric.energy(I4, I6, I8, *place), directions(self)
        green, bent = (I4, I6, I8), (K11, K22, K12)
        for stiffness, t in zip(self.bending, lines, strict=True):
            if stiffness:
                energy += stiffness / 2 * (along(t, t, *bent) / along(t, t, *green)) ** 2
        for t, s in combinations(lines, 2) if self.twist else ():
            squares = along(t, t, *green) * along(s, s, *green)
            energy += self.twist * along(t, s, *bent) ** 2 / squares
        return energy


def _check_inner(outer, place):
    """Raise `InputError` unless a fabric holds another whose energy it can pass on."""
    inner, kind = outer.fabric, type(outer).__name__
    known = not isinstance(inner, type) and callable(getattr(inner, "energy", None))
    if not known or of_curvature(inner) or (of_place(inner) and not place):
        allowed = f"a fabric within {kind} whose energy does not depend on curvature"
        raise InputError("fabric", inner, allowed + ("" if place else " or place"))


def of_place(fabric):
    """Whether the energy of a fabric depends on the place X in the cloth."""
    return getattr(fabric, "of_place", False)


def of_curvature(fabric):
    """Whether the energy of a fabric depends on how its threads curve with the surface."""
    return getattr(fabric, "of_curvature", False)


def of_strain_alone(fabric):
    """Whether it depends on nothing but C."""
    return not (of_place(fabric) or of_curvature(fabric))


def along(one, other, I4, I6, I8):
    """Products t·C s of two flat directions, (2,) each: the squared stretch, if they are one."""
    (a, b), (c, d) = np.asarray(one).tolist(), np.asarray(other).tolist()
    terms = (a * c, I4), (b * d, I6), (a * d + b * c, I8)
    parts = [part if factor == 1 else factor * part for factor, part in terms if factor]
    return sum(parts[1:], parts[0])


def directions(fabric):
    """Unit vectors along the threads of each family in the flat cloth, (families, 2)."""
    return _units(checked_angles("fabric.angles", getattr(fabric, "angles", RIGHT_ANGLES)))


def checked_angles(argument, angles):
    """Angles of two families or more, as a tuple of floats."""
    allowed = "two or more angles in degrees, of different lines"
    if not isinstance(angles, tuple | list | np.ndarray) or len(angles) < 2:
        raise InputError(argument, angles, allowed)
    angles = tuple(check_number(argument, angle, -720, 720) for angle in angles)
    lines = np.sort(np.mod(angles, 180))
    if np.diff(lines, append=lines[0] + 180).min() < APART:
        raise InputError(argument, angles, allowed)
    return angles


def _units(angles):
    radians = np.radians(angles)
    return np.round(np.stack([np.cos(radians), np.sin(radians)], axis=-1), 15)  # 0 and 1 exact
