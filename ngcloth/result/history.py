"""What happened on the way: one row per step, why it ended, and the budget."""

import enum
import math
import time
from dataclasses import dataclass, fields

import numpy as np


class Reason(enum.Enum):
    """Why a solve stopped; reads as a sentence."""

    CONVERGED = "converged"
    SINGULAR = (
        "the threads collapse onto one line within 1.8°, or stretch by more than a tenth: this "
        "surface has no Chebyshev net here, or the mesh cannot resolve it"
    )
    FOLDED = "stopped: the cloth folds between the integration points; the mesh is too coarse"
    STEP_BUDGET = "stopped: the budget of Newton steps is used up"
    TIME_BUDGET = "stopped: the budget of seconds is used up"
    CALLBACK = "stopped: the callback asked for it"
    INTERRUPTED = "stopped: interrupted from the keyboard"
    RUNNING = "still running"
    BLOCKED = (
        "stopped: no step, however small, is acceptable; the limits may contradict each other "
        "or equilibrium, or the mesh be too coarse for them"
    )
    STALLED = "stopped: no step, however small, lowers the Lagrangian any more"

    def __str__(self):
        return self.value


@dataclass(frozen=True)
class Row:
    """One accepted step.

    Attributes
    ----------
    phase : str
        What the outer loop was doing.
    mu : float
        The weight it drives to zero.
    pseudo_time, step : float
        Pseudo-time reached, and the length of its last step Δt.
    energy, lagrangian : float
        E and L over 2π kc, whole surface.
    residual : float
        What is left to do. Without constraints the Newton decrement, the decrease of L still in
        sight, in the same unit; with constraints the largest of stationarity, imbalance, and what
        limits and complementarity miss, per area and over kc.
    newton : int
        Newton steps so far, refused ones included.
    seconds : float
        Wall-clock time since the solve began.
    length : float
        The fraction in (0, 1] of the Newton step that was accepted; the least, where a step Δt
        takes several.
    active : int
        Sampling points of the meshed domain at which a limit is active, its multiplier larger than
        its slack, counted for each limit; 0 without limits.
    """

    phase: str
    mu: float
    pseudo_time: float
    step: float
    energy: float
    lagrangian: float
    residual: float
    newton: int
    seconds: float
    # Last and with defaults, as files written before they were kept have neither.
    length: float = math.nan
    active: int = 0

    def __str__(self):
        return (
            f"{self.newton:5d}  {self.phase:9s}  {self.mu:8.1e}  {self.step:8.1e}  "
            f"{self.energy:10.4e}  {self.lagrangian:11.4e}  {self.residual:8.1e}  "
            f"{self.length:7.1e}  {self.active:6d}  {self.seconds:7.2f}"
        )

    @staticmethod
    def header():
        """The line to print above rows."""
        return (
            f"{'steps':>5s}  {'phase':9s}  {'μ':>8s}  {'Δt':>8s}  "
            f"{'E/2πkc':>10s}  {'L/2πkc':>11s}  {'residual':>8s}  "
            f"{'length':>7s}  {'active':>6s}  {'seconds':>7s}"
        )


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
        Where to keep each accepted step on the solve's own mesh, not on coarser ones that find it
        a start; the solve goes on from one that is there.

    Attributes
    ----------
    problem : Lagrangian
        Whose step was accepted last; None before the first.
    memory : dict of ndarray
        What a loop needs beside the state to go on from a checkpoint; empty without one.
    """

    columns = tuple(field.name for field in fields(Row))
    first_columns = columns[:-2]  # in files written before `length` and `active` were kept

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
        self.problem, self._state = problem, problem.unknowns.copy()
        if self.log:
            self.log(str(row))
        if self._checkpoint and phase != "coarse":
            self._checkpoint.write(self._state, self.rows, memory)
        if self._after_step and self._after_step():
            self._called_off = True

    def resume(self, problem):
        """Go on from the checkpoint, if there is one."""
        found = self._checkpoint.read(problem.state.vec.size) if self._checkpoint else None
        if found is None:
            return
        self.problem, (self._state, self.rows, self.memory) = problem, found
        problem.unknowns[:] = self._state
        last = self.rows[-1]
        self.newton, self.pseudo_time = last.newton, last.pseudo_time
        self._begin -= last.seconds
        if self.log:
            self.log(f"going on after {self.newton} Newton steps")

    def restore(self):
        """Return to the last accepted step. Returns whether there is one."""
        if self.problem is not None:
            self.problem.unknowns[:] = self._state
        return self.problem is not None
