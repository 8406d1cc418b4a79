"""What happened on the way: one row per step, and why it ended."""

import enum
import math
from dataclasses import dataclass, fields


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
    INFEASIBLE = (
        "stopped: no patch found that respects all limits and equilibrium, nor a step that misses "
        "them by less"
    )
    ADRIFT = (
        "stopped: the patch slides a hundred times its size through cloth that differs from place "
        "to place; with mirror symmetry its middle stays"
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


COLUMNS = tuple(field.name for field in fields(Row))
FIRST_COLUMNS = COLUMNS[:-2]  # in files written before `length` and `active` were kept
