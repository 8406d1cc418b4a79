"""Pseudo-time loops: backward Euler along the H¹ gradient flow of the Lagrangian (eq. 23)."""

import math

from ..result.history import Reason
from .newton import newton_step
from .start import dilate

# 1/Δt is this fraction of the energy per area that the last step had in sight: long steps follow
# by themselves as the flow comes to rest, and convergence stays quadratic.
DAMPING = 0.05
LEAST_ANGLE_SINE = 0.0314  # sin 1.8°: what a mesh of default size shows at a collapse
UNRESOLVED = 0.1  # strain that inextensible threads cannot have
# The Hessian takes over from Gauss-Newton where a step has less than this fraction of L in sight,
# for as long as it is convex.
NEAR = 0.1
ROUND_OFF_OF_VALUE = 1e-14
ROUND_OFF = 1e-26  # energy per area of strains of 1e-13


def adaptive_flow(problem, recorder, phase, tolerance, at_most=math.inf):
    """Flow to rest, one Newton step to each backward Euler step; dilate a stretched start first.

    Parameters
    ----------
    problem : Lagrangian
        Its `state` is moved.
    recorder : Recorder
        Takes each accepted step, and keeps the budget.
    phase : str
        The name of this stage in the history.
    tolerance : float
        Rest is where the decrease still in sight is below this fraction of the Lagrangian.
    at_most : int, optional
        Newton steps after which to return.

    Returns
    -------
    Reason
        `RUNNING` after `at_most` steps.
    """
    sight = float(recorder.memory.pop("sight", problem.value()))
    boost = float(recorder.memory.pop("boost", 1.0))
    exact = bool(recorder.memory.pop("exact", False))
    floor = ROUND_OFF * problem.area
    if not recorder.rows:
        dilate(problem)
    last = float(recorder.memory.pop("last", recorder.newton + at_most))
    while not recorder.exhausted:
        if recorder.newton >= last:
            return Reason.RUNNING
        rate = DAMPING * boost * max(sight, floor) / problem.area
        step = newton_step(problem, rate, exact=exact)
        recorder.newton += 1
        if exact and step.length == 0:  # not convex here
            exact = False
            continue
        near = step.decrement <= NEAR * problem.value()
        exact = exact or (problem.gauss_newton and near)
        # Below the round-off of L the line search decides by chance; the decrement still tells.
        small = tolerance if boost == 1 else ROUND_OFF_OF_VALUE / boost
        at_rest = step.decrement <= small * problem.value() + floor
        if step.length == 1:
            sight = step.decrement
        if step.length == 1 and step.ratio > 0.5:
            boost = max(boost / 8, 1.0)
        elif step.length < 0.25:
            boost *= 8
        if step.length > 0:
            value = problem.value()
            recorder.record(
                problem,
                phase,
                1 / rate,
                value,
                step.decrement * recorder.unit,
                length=step.length,
                sight=sight,
                boost=boost,
                exact=exact,
                last=last,
            )
            if problem.adrift:
                return Reason.ADRIFT
        if at_rest:
            stretched = problem.scene.inextensible and problem.largest_strain() > UNRESOLVED
            return Reason.SINGULAR if stretched else Reason.CONVERGED
        if step.length == 1 and sight <= 1e-2 * value and collapsed(problem):
            return Reason.SINGULAR
        if boost > 1e15:
            return Reason.STALLED
    return recorder.why


def collapsed(problem):
    """Whether threads of a Chebyshev scene lie within 1.8° of each other somewhere."""
    sine = (1 - problem.largest_shear() ** 2) ** 0.5
    return problem.scene.inextensible and sine < LEAST_ANGLE_SINE


def fixed_flow(problem, recorder, phase, tolerance, at_most=math.inf, time_step=0.1):
    """The paper's schedule: steps Δt of one size, each backward Euler equation solved by Newton.

    Rest is where |∂t L|/(2π kc) ≤ `tolerance`. Parameters and return value otherwise as for
    `adaptive_flow`.
    """
    anchor, last = problem.state.vec.CreateVector(), recorder.newton + at_most
    while not recorder.exhausted:
        if recorder.newton >= last:
            return Reason.RUNNING
        anchor.data = problem.state.vec
        before, length = problem.value(), 1.0
        while not recorder.exhausted:
            step = newton_step(problem, 1 / time_step, anchor)
            recorder.newton += 1
            if step.decrement <= 1e-8 * before:
                break
            if step.length == 0:
                return Reason.STALLED
            length = min(length, step.length)
        value = problem.value()
        slope = (before - value) / time_step
        recorder.record(problem, phase, time_step, value, slope * recorder.unit, length=length)
        if recorder.unit * slope <= tolerance:
            return Reason.CONVERGED
    return recorder.why
