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
