"""Starts from neighbours: which cases are near, and what is taken over from one."""

import numbers
import zlib
from dataclasses import replace
from zipfile import BadZipFile

import ngsolve as ngs
import numpy as np

from ..errors import InputError
from ..geometry.file_surface import FileSurface
from ..result.reading import plain_arrays, plain_bytes
from .store import RESULT

NEAREST = 16  # that are looked for; one of them is mostly solved once a few are
DEGREE = 7  # of the polynomials that are fitted
LARGEST = 2**28  # bytes of the arrays of a result
UNREADABLE = (OSError, ValueError, KeyError, EOFError, BadZipFile, zlib.error)


def neighbours(cases, keys):
    """For each case the keys of others, the nearest first.

    Near is near in the ranks of all numbers, so that it is the same on any scale; cases with other
    texts or truth values are not near at all.

    Parameters
    ----------
    cases : list of dict
        Plain values by name.
    keys : list of str
        Of the cases.

    Returns
    -------
    dict
        {key: list of keys}
    """
    from scipy.spatial import KDTree  # takes a second, which each process would take

    groups = {}
    for number, case in enumerate(cases):
        words = tuple((n, repr(v)) for n, v in sorted(case.items()) if not _number(v))
        groups.setdefault((words, tuple(sorted(case))), []).append(number)
    near = {key: [] for key in keys}
    for members in groups.values():
        names = sorted(name for name, value in cases[members[0]].items() if _number(value))
        table = np.array([[float(cases[m][name]) for name in names] for m in members])
        if not names or len(members) < 2:
            continue
        ranks = [np.unique(column, return_inverse=True)[1] for column in table.T]
        ranks = np.stack([rank / max(rank.max(), 1) for rank in ranks], axis=-1)
        _, found = KDTree(ranks).query(ranks, min(NEAREST + 1, len(members)))
        for member, others in zip(members, found, strict=True):
            near[keys[member]] = [keys[members[o]] for o in others if members[o] != member]
    return near


def _number(value):
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def warmed(scene, store, keys):
    """A scene that starts from ψ of the first of some cases that has converged; or None.

    A polynomial of θ is fitted to that ψ, so that meshes need not be the same, and in scenes with
    mirror symmetry it has it. None if no case has converged, if the polynomial folds the cloth,
    and on surfaces from files, where θ is another for each.
    """
    if isinstance(scene.surface, FileSurface):
        return None
    for key in keys:
        record = store.record(key)
        if record and record["row"]["converged"]:
            file = store.place(key) / RESULT / "fields.npz"
            try:
                fields = plain_arrays(plain_bytes(file, LARGEST), LARGEST)
                theta, psi = (fields[name].reshape(-1, 2) for name in ("theta", "psi"))
            except UNREADABLE:
                continue
            try:
                return replace(scene, start=_Polynomial(scene, theta, psi))
            except InputError:
                return None
    return None


class _Polynomial:
    """ψ by least squares; called with (θ1, θ2) it returns two expressions."""

    def __init__(self, scene, theta, psi):
        domain = scene.surface.domain
        self._centre, self._size = domain.centre, np.ptp(domain.box, axis=1) / 2
        powers = [(i, j) for i in range(DEGREE + 1) for j in range(DEGREE + 1 - i)]
        # ψ1 is odd in θ1 and even in θ2, ψ2 the other way round.
        odd = [(1, 0), (0, 1)] if scene.symmetric else [None, None]
        s, t = ((theta - self._centre) / self._size).T
        self._terms = []
        for values, parity in zip(psi.T, odd, strict=True):
            kept = [p for p in powers if parity in (None, (p[0] % 2, p[1] % 2))]
            basis = np.stack([s**i * t**j for i, j in kept], axis=-1)
            fitted = np.linalg.lstsq(basis, values, rcond=None)[0]
            self._terms.append(list(zip(kept, fitted.tolist(), strict=True)))

    def __call__(self, theta1, theta2):
        s = (theta1 - float(self._centre[0])) / float(self._size[0])
        t = (theta2 - float(self._centre[1])) / float(self._size[1])
        one = ngs.CF(1.0)
        powers = [[one], [one]]
        for each, way in zip(powers, (s, t), strict=True):
            for _ in range(DEGREE):
                each.append(each[-1] * way)
        return tuple(
            sum((c * powers[0][i] * powers[1][j] for (i, j), c in terms), ngs.CF(0.0))
            for terms in self._terms
        )
