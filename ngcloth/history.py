"""What happened on the way: one row per step, why it ended, and the budget."""

import enum
import time
from dataclasses import dataclass, fields


class Reason(enum.Enum):
    """Why a solve stopped; reads as a sentence."""

    CONVERGED = "converged"
    SINGULAR = (
        "the threads collapse onto one line within 1.6°: this surface has no Chebyshev net here, "
        "or the mesh cannot resolve it"
    )
    STEP_BUDGET = "stopped: the budget of Newton steps is used up"
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
        The Newton decrement, the decrease of L still in sight, in the same unit.
    newton : int
        Newton steps so far, refused ones included.
    seconds : float
        Wall-clock time since the solve began.
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

    def __str__(self):
        return (
            f"{self.newton:5d}  {self.phase:9s}  {self.mu:8.1e}  {self.step:8.1e}  "
            f"{self.energy:10.4e}  {self.lagrangian:11.4e}  "
            f"{self.residual:8.1e}  {self.seconds:7.2f}"
        )

    @staticmethod
    def header():
        """The line to print above rows."""
        return (
            f"{'steps':>5s}  {'phase':9s}  {'mu':>8s}  {'dt':>8s}  "
            f"{'E/2πkc':>10s}  {'L/2πkc':>11s}  {'residual':>8s}  {'seconds':>7s}"
        )


class Recorder:
    """Keeps the rows of a solve, prints them, and counts Newton steps against the budget.

    Parameters
    ----------
    unit : float
        Energies over the meshed domain are multiplied by this for the rows.
    max_steps : int
    log : callable or None
        Called with each line of text.
    """

    def __init__(self, unit, max_steps, log):
        self.unit, self.max_steps, self.log = unit, max_steps, log
        self.rows, self.newton, self.pseudo_time = [], 0, 0.0
        self._begin = time.perf_counter()
        if log:
            log(Row.header())

    @property
    def exhausted(self):
        """Whether the budget is used up."""
        return self.newton >= self.max_steps

    @property
    def seconds(self):
        """Wall-clock time since the solve began."""
        return time.perf_counter() - self._begin

    def record(self, problem, phase, step, lagrangian, residual):
        """Add the row of a step Δt = `step` that has just been accepted."""
        self.pseudo_time += step
        row = Row(
            phase=phase,
            mu=problem.mu,
            pseudo_time=self.pseudo_time,
            step=step,
            energy=self.unit * problem.cost(),
            lagrangian=self.unit * lagrangian,
            residual=self.unit * residual,
            newton=self.newton,
            seconds=self.seconds,
        )
        self.rows.append(row)
        if self.log:
            self.log(str(row))

    columns = tuple(field.name for field in fields(Row))
