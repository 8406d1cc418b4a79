"""Keeps the rows of a solve and its budget, for all loops."""

import time
import warnings

import numpy as np

from ..result.history import Reason, Row


class Recorder:
    """Keeps the rows of a solve, prints them, and says when the budgets are used up.

    Parameters
    ----------
    unit : float
        Energies over the meshed domain are multiplied by this for the rows.
    max_steps : int
    log : callable or None
        Called with each line of text.
    max_seconds : float, optional
    after_step : callable, optional
        Called after each accepted step without arguments; the solve stops if it returns True.
    checkpoint : Checkpoint, optional
        Where to keep each accepted step on the solve's own mesh, not on coarser and finer ones; the
        solve goes on from one that is there.

    Attributes
    ----------
    problem : Lagrangian
        Whose step was accepted last; None before the first.
    memory : dict of ndarray
        What a loop needs beside the state to go on from a checkpoint; empty without one.
    """

    def __init__(self, unit, max_steps, log, max_seconds=np.inf, after_step=None, checkpoint=None):
        self.unit, self.max_steps, self.log, self.max_seconds = unit, max_steps, log, max_seconds
        self.rows, self.newton, self.pseudo_time, self.memory = [], 0, 0.0, {}
        self.problem = None
        self._after_step, self._checkpoint, self._state = after_step, checkpoint, None
        self._called_off = False
        self._begin = time.perf_counter()
        if log:
            log(Row.header())

    @property
    def exhausted(self):
        """Whether the solve has to stop, for the reason `why`."""
        return self._called_off or self.newton >= self.max_steps or self.seconds >= self.max_seconds

    @property
    def why(self):
        """Which budget is used up."""
        if self._called_off:
            return Reason.CALLBACK
        return Reason.STEP_BUDGET if self.newton >= self.max_steps else Reason.TIME_BUDGET

    @property
    def seconds(self):
        """Wall-clock time that the solve has taken."""
        return time.perf_counter() - self._begin

    def record(self, problem, phase, step, lagrangian, residual, *, length=1.0, active=0, **memory):
        """Add the row of a step Δt = `step` that has just been accepted.

        `memory` is what the loop needs to go on from here, numbers and arrays.
        """
        self.pseudo_time += step
        row = Row(
            phase=phase,
            mu=problem.mu,
            pseudo_time=self.pseudo_time,
            step=step,
            energy=self.unit * problem.cost(),
            lagrangian=self.unit * lagrangian,
            residual=residual,
            newton=self.newton,
            seconds=self.seconds,
            length=length,
            active=active,
        )
        self.rows.append(row)
        self.keep(problem)
        if self.log:
            self.log(str(row))
        if self._checkpoint and phase not in ("coarse", "finer"):
            self._tried(self._checkpoint.write, self._state, self.rows, memory)
        if self._after_step and self._after_step():
            self._called_off = True

    def keep(self, problem):
        """Note where a loop is, or ends: on a finer mesh that may take no step."""
        self.problem, self._state = problem, problem.unknowns.copy()

    def resume(self, problem):
        """Go on from the checkpoint, if there is one."""
        if not self._checkpoint:
            return
        slacks = problem.slacks().shape if problem.scene.in_equilibrium else ()
        triangles = problem.sheet.mesh.ne
        found = self._checkpoint.found(problem.state.vec.size, slacks, triangles)
        if found is None:
            return
        self.problem, (self._state, self.rows, self.memory) = problem, found
        problem.unknowns[:] = self._state
        last = self.rows[-1]
        self.newton, self.pseudo_time = last.newton, last.pseudo_time
        self._begin -= last.seconds
        if self.log:
            self.log(f"going on after {self.newton} Newton steps")

    def forget(self):
        """Delete the checkpoint: the solve has converged."""
        if self._checkpoint:
            self._tried(self._checkpoint.remove)

    def _tried(self, action, *arguments):
        """A full disk is no reason to lose a solve."""
        try:
            action(*arguments)
        except OSError as error:
            text = f"the solve goes on without its checkpoint ({error})"
            warnings.warn(text, RuntimeWarning, stacklevel=2)
            if self.log:
                self.log(text)

    def restore(self):
        """Return to the last accepted step. Returns whether there is one."""
        if self.problem is not None:
            self.problem.unknowns[:] = self._state
        return self.problem is not None
