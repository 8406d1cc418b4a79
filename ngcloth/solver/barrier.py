"""The weights μ of barriers: the first, ever weaker ones, and one that no longer shows."""

FIRST_MU, WARM_MU = 1.0, 1e-2  # the first weight, and that from the patch of a coarser mesh
LOWER_MU = 0.2  # over the one before
# Of the cost per area: the last one, where none is given. Where an accuracy is asked for, it is at
# most this part of that.
UNSEEN, UNSEEN_OF_BAR = 1e-4, 0.1
LEAST_MU = 1e-12  # where the cost vanishes, as on what can be unrolled


def first_weight(warm):
    """The first weight, from a start or, if `warm`, from the patch of a coarser mesh."""
    return WARM_MU if warm else FIRST_MU


def lower_weight(mu, last):
    """A smaller weight, or the last one where that is nearly as small."""
    lower = min(LOWER_MU * mu, mu**1.25)
    return lower if lower >= 2 * last else last


def unseen(problem):
    """The weight μ of a barrier that no longer shows: a fraction of the cost per area.

    A weight that is nearly as small, as the cost falls on, is small enough.
    """
    # About this fraction of the cost is the barrier's part of its bar.
    part = min(UNSEEN, UNSEEN_OF_BAR * problem.settings.get("accuracy", 1.0))
    least = max(part * abs(problem.cost()) / problem.area, LEAST_MU)
    return problem.mu if least <= problem.mu <= 2 * least else least
