"""Interior point: barrier loop around the primal-dual Newton steps of an `Iterate`."""

import numpy as np

from ..problem.constraints import LimitPoints
from ..result.history import Reason
from .barrier import first_weight, unseen
from .iterate import Iterate
from .start import near_start

GAIN = 1e-3  # of the cost: saddles are left as long as that brings so much


def interior_point(problem, recorder, last_mu, phase="barrier", warm=False):
    """Minimise E under the scene's limits and equilibrium, by ever weaker barriers.

    Parameters
    ----------
    problem : ConstrainedLagrangian
        Its `state` is moved.
    recorder : Recorder
        Keeps budget and history, and the memory of an earlier run to go on from.
    last_mu : float or None
        The barrier weight, relative to kc, at which to stop, by default `unseen` ones; in a scene
        without limits the tolerance.
    phase : str, optional
        The name of the rows of history.
    warm : bool, optional
        Whether `state` nearly is the solution, and not the scene's start.

    Returns
    -------
    Reason
        Where limits are missed as it gives up, or as a budget is used up, `state` is the one that
        misses limits and equilibrium least of those since the barrier fell last.
    """
    limited = bool(problem.slack_names)
    if limited:
        found = recorder.memory
        known = [found[name] for name in LimitPoints._fields] if found else problem.rim_vertices()
        problem.add_limit_points(LimitPoints(*known))
    if not (warm or recorder.memory):
        near_start(problem, recorder)
    # Without limits there is no barrier to weaken.
    last = unseen(problem) if last_mu is None else last_mu
    iterate = Iterate(problem, first_weight(warm, last) if limited else last)
    if recorder.memory:
        iterate.recall(recorder.memory)
    again = False  # whether it has begun anew where no step was accepted
    saddle = np.inf  # the cost of the one that was left last
    least, nearest = np.inf, problem.unknowns.copy()  # what is missed, and where least, at this μ
    while not recorder.exhausted:
        if (missed := iterate.missed()) < least:
            least, nearest = missed, problem.unknowns.copy()
        error = iterate.error()
        end = unseen(problem) if last_mu is None else last_mu
        if iterate.mu > end and iterate.is_near(error):
            iterate.exchange()
            iterate.lower_mu(end)
            least = np.inf  # points were added
            continue
        if iterate.mu <= end and error <= iterate.mu and iterate.at_rest:
            if iterate.exchange():
                least = np.inf
                continue
            cost = problem.cost()
            if phase != "coarse" and saddle - cost > GAIN * abs(cost) and iterate.leave():
                saddle = cost
                if recorder.log:
                    recorder.log("left a saddle")
                continue
            recorder.keep(problem)
            return Reason.CONVERGED
        rate, length = iterate.step(recorder)
        if length > 0:
            told = {"length": length, "active": int((iterate.z > iterate.s).sum())}
            value = iterate.lagrangian()
            recorder.record(problem, phase, 1 / rate, value, error, **told, **iterate.memory())
            if problem.adrift:
                return Reason.ADRIFT
        elif iterate.is_stuck:
            if limited and not again:
                again = True
                iterate.begin_anew()
                continue
            if iterate.c.min(initial=1) > 0:
                return Reason.BLOCKED
            problem.unknowns[:] = nearest
            return Reason.INFEASIBLE
    if iterate.c.min(initial=1) <= 0 and recorder.why is not Reason.CALLBACK:
        problem.unknowns[:] = nearest
    return recorder.why
