"""The weights μ of barriers: the first, ever weaker ones, and one that no longer shows."""

# The first weight; that from the patch of a coarser mesh, but no more than so many times the last:
# a stronger barrier drives soft cloth far from where it is.
FIRST_MU, WARM_MU, WARMER = 1.0, 1e-2, 1e3
# A weight over the one before; and over the cost per area, where it begins to fall faster.
LOWER_MU, STRONG = 0.2, 10.0
# Of the cost per area: the last one, where none is given. Where an accuracy is asked for, it is at
# most this part of that.
UNSEEN, UNSEEN_OF_BAR = 1e-4, 0.1
LEAST_MU = 1e-12  # where the cost vanishes, as on what can be unrolled


def first_weight(warm, last):
    """The first weight, from a start or, if `warm`, from the patch of a coarser mesh."""
    return max(last, min(WARM_MU, WARMER * last)) if warm else FIRST_MU


def lower_weight(problem, last):
    """A weaker barrier's weight, or the `last` one where that is nearly as small.

    The weaker the barrier is, over the cost, the more it may fall at once.
    """
    mu = problem.mu
    lower = mu * min(LOWER_MU, (mu / min(STRONG * _scale(problem), 1.0)) ** 0.25)
    return lower if lower >= 2 * last else last


def unseen(problem):
    """The weight μ of a barrier that no longer shows: a fraction of the cost per area.

    A weight that is nearly as small, as the cost falls on, is small enough.
    """
    # About this fraction of the cost is the barrier's part of its bar.
    part = min(UNSEEN, UNSEEN_OF_BAR * problem.settings.get("accuracy", 1.0))
    least = max(part * _scale(problem), LEAST_MU)
    return problem.mu if least <= problem.mu <= 2 * least else least


def _scale(problem):
    return max(abs(problem.cost()) / problem.area, LEAST_MU)
