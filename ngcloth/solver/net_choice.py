"""Which Chebyshev net, where a surface has many: the one that bends most evenly.

A tie-break ε/2 ∫ |∇∇∇ψ|² chooses a net (`lagrangian._uneven_bending`) while ε falls; then
steps on E alone free the net of the tie-break's bias.
"""

from ..result.history import Reason
from .newton import newton_step

FIRST_TIE_BREAK = 1e-3
CHOSEN, AT_MOST = 1e-2, 12  # accuracy and steps at each weight: at more it creeps along nets
FREEING_STEPS, FREEING_RATE, SETTLING_STEPS = 16, 2e-9, 8
HOLDING = 2e4  # rate over the square of the last weight: a net chosen at a large one stays


def chosen_net(problem, recorder, flow, tolerance):
    """Minimise E by weights that fall to `Scene.tie_break` a hundredfold at a time, then without.

    Parameters
    ----------
    problem : Lagrangian
        Its `state` is moved.
    recorder : Recorder
        Keeps budget and history, and the memory of an earlier run to go on from.
    flow : callable
        `adaptive_flow` or `fixed_flow`.
    tolerance : float
        The decrease of E still in sight, over E, at which to stop.

    Returns
    -------
    Reason
    """
    for weight in _weights(problem.scene.tie_break):
        if recorder.rows and weight > recorder.rows[-1].mu:
            continue
        problem.mu = weight
        reason = flow(problem, recorder, "flow", max(tolerance, CHOSEN), at_most=AT_MOST)
        if reason not in (Reason.CONVERGED, Reason.RUNNING):
            return reason
    return _freed(problem, recorder, tolerance)


def _weights(last):
    weights = [last]
    while weights[-1] < FIRST_TIE_BREAK / 10:
        weights.append(100 * weights[-1])
    return weights[::-1]


def _freed(problem, recorder, tolerance):
    """Newton steps on E alone, from the net that the tie-break has chosen.

    They take away what the tie-break costs, its bias where the net is unique. Where it is not
    they would go on for ever, along nets that the mesh resolves better and better: the last ones
    are damped more and more, and bring the net to rest.
    """
    first = max(FREEING_RATE, HOLDING * problem.scene.tie_break**2)
    rate = float(recorder.memory.pop("rate", first))
    problem.mu = 0.0
    done = sum(row.mu == 0 for row in recorder.rows)
    for left in range(FREEING_STEPS + SETTLING_STEPS - done, 0, -1):
        if recorder.exhausted:
            return recorder.why
        step = newton_step(problem, rate)
        recorder.newton += 1
        if step.length == 0:
            break
        time_step, value = 1 / rate, problem.value()
        if step.length < 0.5 or left <= SETTLING_STEPS:
            rate *= 4
        recorder.record(
            problem,
            "free",
            time_step,
            value,
            step.decrement * recorder.unit,
            length=step.length,
            rate=rate,
        )
        if step.decrement <= tolerance * value:
            break
    return Reason.CONVERGED
