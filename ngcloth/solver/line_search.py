"""How far a step may go: short of the boundary, and with a gain that the filter accepts."""

import numpy as np

TO_BOUNDARY = 0.97  # a step may use up this fraction of a slack variable or a multiplier


class Filter:
    """Pairs of objective and violation to which no step may return (Wächter and Biegler, 2006).

    Constants are theirs.

    Parameters
    ----------
    violation : float
        At the start; far larger ones are refused.

    Attributes
    ----------
    pairs : list of (float, float)
    largest : float
        The violation that is refused.
    """

    def __init__(self, violation):
        self.pairs, self.largest = [], 1e4 * max(1.0, violation)

    def accepts(self, length, slope, old, new):
        """Whether a step may be taken; a pair is added where feasibility was the gain.

        Parameters
        ----------
        length : float
            Of the step.
        slope : float
            Of the objective along it.
        old, new : (float, float)
            Objective and violation before and after.
        """
        (objective, violation), (new_objective, new_violation) = old, new
        if not (np.isfinite(new_objective) and new_violation < self.largest):
            return False
        if any(
            new_violation >= (1 - 1e-5) * v and new_objective >= o - 1e-5 * v for o, v in self.pairs
        ):
            return False
        descent = slope < 0 and (-slope) ** 2.3 * length > violation**1.1
        if descent and new_objective <= objective + 1e-4 * length * slope + 1e-13 * abs(objective):
            return True
        if descent and violation < 1e-4:
            return False
        if new_violation <= (1 - 1e-5) * violation or new_objective <= objective - 1e-5 * violation:
            self.pairs.append((objective - 1e-5 * violation, (1 - 1e-5) * violation))
            return True
        return False


def to_boundary(values, changes):
    """The longest step, at most 1, along which no value loses more than `TO_BOUNDARY` of itself."""
    falling = changes < 0
    ratios = TO_BOUNDARY * values[falling] / -changes[falling]
    # A Python number: NumPy's does not multiply a vector of NGSolve as one would think.
    return float(ratios.min(initial=1.0))
