"""One damped Newton step of a backward Euler step, that never folds the cloth."""

import math
from dataclasses import dataclass

import ngsolve as ngs

ARMIJO = 1e-4
SHORTEST = 2.0**-12


@dataclass(frozen=True)
class Step:
    """What one Newton step did.

    Attributes
    ----------
    length : float
        Accepted step length in (0, 1]; 0 if no length was acceptable and the state is unchanged.
    decrement : float
        The decrease the quadratic model promised for twice a full step, dᵀ(H + K/Δt)d.
    ratio : float
        Actual over predicted decrease.
    """

    length: float
    decrement: float
    ratio: float


def newton_step(problem, rate, anchor=None, exact=False):
    """Try one Newton step for min L(ψ) + ½ rate |ψ − anchor|².

    Parameters
    ----------
    problem : Lagrangian
        Its `state` is moved by an accepted step, and left as it was by a refused one.
    rate : float
        1/Δt, the weight of the flow's inner product.
    anchor : BaseVector, optional
        The state at the beginning of the backward Euler step. By default the present one.
    exact : bool, optional
        Whether to use the Hessian also where there is a Gauss-Newton matrix.

    Returns
    -------
    Step
    """
    state = problem.state.vec
    before, direction, residual, product = (state.CreateVector() for _ in range(4))
    before.data = state

    problem.gradient(residual)
    if anchor is not None:
        residual.data += rate * (problem.flow * (before - anchor))
    matrix = problem.hessian(exact)
    matrix.AsVector().data += rate * problem.flow.AsVector()
    inverse = matrix.Inverse(problem.free, inverse=problem.inverse)
    direction.data = -problem.keeping(inverse) * residual

    slope = ngs.InnerProduct(residual, direction)
    product.data = matrix * direction
    curvature = ngs.InnerProduct(direction, product)
    if not (curvature > 0 and slope < 0):
        return Step(0.0, math.nan, math.nan)

    def merit():
        value = problem.value()
        if anchor is not None:
            product.data = state - anchor
            value += rate / 2 * ngs.InnerProduct(product, (problem.flow * product).Evaluate())
        return value

    start = merit()
    length = 1.0
    while length >= SHORTEST:
        state.data = before + length * direction
        # Energies are blind to the sign of J: a folded element may even have a lower one.
        if problem.least_jacobian() > 0:
            drop = start - merit()
            predicted = -length * slope - length**2 / 2 * curvature
            if drop >= -ARMIJO * length * slope:
                return Step(length, -slope, drop / predicted)
        length /= 2
    state.data = before
    return Step(0.0, -slope, math.nan)
