"""Linear systems whose matrix is that of a saddle: of a minimum in ψ under equilibrium, with v."""

from functools import cache

import ngsolve as ngs
import numpy as np
from netgen.meshing import NgException

SOFTENING = 1e-8  # of the block of v for a factorisation without pivoting, over the stiffness
REFINEMENTS, ACCURACY = 8, 1e-4  # at most so many, until the residual is this part of the load


class SaddleSystem:
    """Factorises one matrix after another, with the same unknowns and the same pattern.

    LDLᵀ without pivoting needs a matrix without zeros on the diagonal (Vanderbei, 1995); it gets
    one with a small negative block for v, whose effect iterative refinement undoes. It takes a
    tenth of the time of LU with pivoting, which stands by for the rare failure, and its pivots tell
    a minimum in ψ from another saddle.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Whose `free` unknowns are solved for; the others stay zero. With `inverse` "sparsecholesky"
        the LDLᵀ is used, with NGSolve's other direct solvers LU at once.
    """

    def __init__(self, problem):
        self._problem, self._moving = problem, problem.free
        self._softener = problem.multiplier_flow.AsVector()
        self._without_pivoting = problem.inverse == "sparsecholesky"
        self._inside, self._factors = ngs.Projector(problem.free, True), None
        self._compliance = np.inf  # of ψ to what holds the direction of the warp
        self._rest = problem.state.vec.CreateVector()

    def solver(self, matrix):
        """Return a function (load, out) that writes the x with matrix x = load to `out`.

        Where also LU fails, x is not a number. `matrix` is always the same object, with other
        entries each time. With less softening than its part of the problem's `stiffness`, the
        signs of pivots are lost in rounding.
        """
        if self._without_pivoting:
            softening = SOFTENING * self._problem.stiffness()
            matrix.AsVector().data -= softening * self._softener
            if self._factors is None:
                self._factors = matrix.Inverse(self._moving, inverse="sparsecholesky")
            else:  # the ordering is known
                self._factors.Update()
            matrix.AsVector().data += softening * self._softener

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

        if not self._problem.held:
            return solve
        normal = self._problem.held.normal
        solve(normal, response := normal.CreateVector())
        self._compliance = response.InnerProduct(normal)

        def solve_held(load, out):
            solve(load, out)
            out.data -= float(out.InnerProduct(normal) / self._compliance) * response

        return solve_held

    def is_minimum(self):
        """Whether the matrix last factorised is positive in all ψ that keep equilibrium.

        By Sylvester's law, it then has as many negative pivots as there are multipliers; one more
        may belong to the direction of the warp, where that is held, and yields to it. Where pivots
        are not known, as of LU, the answer is yes.
        """
        if not self._without_pivoting:
            return True
        pivots = _pivots(self._factors, self._moving.NumSet())
        negative = self._problem.multipliers + (self._compliance < 0)
        return pivots is None or (pivots < 0).sum() == negative

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


def _pivots(factors, size):
    """D of an LDLᵀ of NGSolve, (size,), or None if another version keeps it otherwise.

    NGSolve shows D in the pickled state alone: after L and after where the rows of L start, `size`
    + 1 numbers from 0 to that of all entries. A test tells if that has changed.
    """
    state, entries = factors.__getstate__()[0][0], factors.nze
    begin = state.find(np.int64([size + 1, 0]).tobytes(), 8 * entries)
    end = begin + 8 * (size + 1)
    known = begin >= 0 and np.array_equal(np.frombuffer(state, np.int64, 2, end), [entries, size])
    return np.frombuffer(state, float, size, end + 16) if known else None
