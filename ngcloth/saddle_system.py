"""Linear systems whose matrix is that of a saddle: of a minimum in ψ under equilibrium, with η."""

from functools import cache

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException

SOFTENING = 1e-8  # of the block of η for a factorisation without pivoting
REFINEMENTS, ACCURACY = 8, 1e-8  # at most so many, until the residual is this part of the load


class SaddleSystem:
    """Factorises one matrix after another, with the same unknowns and the same pattern.

    LDLᵀ without pivoting needs a matrix without zeros on the diagonal (Vanderbei, 1995); it gets
    one with a small negative block for η, whose effect iterative refinement undoes. It takes a
    tenth of the time of LU with pivoting, which stands by for the rare failure.

    Parameters
    ----------
    moving : BitArray
        The unknowns to solve for; the others stay zero.
    eta_flow : BaseMatrix
        Of which a little is the negative block.
    inverse : str
        NGSolve's name of the direct solver; "sparsecholesky" is the LDLᵀ, others use LU at once.
    """

    def __init__(self, moving, eta_flow, inverse):
        self._moving, self._softener = moving, eta_flow.AsVector()
        self._without_pivoting = inverse == "sparsecholesky"
        self._inside, self._factors = ngs.Projector(moving, True), None
        self._rest = eta_flow.CreateColVector()

    def solver(self, matrix):
        """Return a function (load, out) that writes the x with matrix x = load to `out`.

        Where also LU fails, x is not a number. `matrix` is always the same object, with other
        entries each time.
        """
        if self._without_pivoting:
            matrix.AsVector().data -= SOFTENING * self._softener
            if self._factors is None:
                self._factors = matrix.Inverse(self._moving, inverse="sparsecholesky")
            else:  # the ordering is known
                self._factors.Update()
            matrix.AsVector().data += SOFTENING * self._softener

        @cache
        def pivoted():
            return matrix.Inverse(self._moving, inverse="umfpack")

        def solve(load, out):
            if self._without_pivoting and self._refined(matrix, load, out):
                return
            try:
                out.data = pivoted() * load
            except NgException:  # singular, or not finite
                out[:] = np.nan

        return solve

    def _refined(self, matrix, load, out):
        """Iterate out ← out + factors⁻¹ (load − matrix out); whether that succeeded."""
        out[:] = 0
        self._rest.data = self._inside * load
        goal = ACCURACY * self._rest.Norm()
        for _ in range(REFINEMENTS):
            out.data += self._factors * self._rest
            self._rest.data = load - matrix * out
            self._rest.data = self._inside * self._rest
            size = self._rest.Norm()
            if size <= goal or not np.isfinite(size):
                break
        return size <= goal
