"""Fabrics: strain energy per unit flat area as a function of I4, I6, I8."""

from dataclasses import dataclass

import numpy as np

from ..errors import InputError, check_number

STIFFNESSES = 1e-30, 1e30  # squares of their ratios do not overflow


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
