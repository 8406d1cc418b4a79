"""What the user's own functions return: expressions of the right kind, or `InputError` by name."""

import ngsolve as ngs
from netgen.meshing import NgException

from ..errors import InputError
from .fabric import of_curvature, of_place


def call(argument, value, method, expected, function, *arguments):
    """What a function of the user's returns.

    Parameters
    ----------
    argument, value
        What it belongs to, as for `InputError`.
    method, expected : str
        How the user calls it, and what it must return, in words.
    function, *arguments
        What to call.

    Raises
    ------
    InputError
        If NumPy, NGSolve or Python refuse the way in which it uses its arguments.
    Exception
        Any other of the user's own, with a note of where it was called.
    """
    try:
        return function(*arguments)
    except (TypeError, NgException) as error:
        raise refusal(argument, value, method, expected, error) from error
    except Exception as error:
        if hasattr(error, "add_note"):  # from Python 3.11 on
            error.add_note(f"raised by `{method}`, which ngcloth called to check the {argument}")
        raise


def scalar(argument, value, method, expected, returned):
    """`returned`, which has to be one scalar real expression; else raises `InputError`."""
    if not isinstance(returned, ngs.CoefficientFunction):
        raise refusal(argument, value, method, expected, f"not {type(returned).__name__}")
    if returned.dim != 1 or returned.is_complex:
        kind = "a complex expression" if returned.is_complex else f"{returned.dim} components"
        raise refusal(argument, value, method, expected, f"not {kind}")
    return returned


def vector(argument, value, method, expected, size, function):
    """What a function of (θ1, θ2) returns at NGSolve's coordinates: one real vector expression."""
    returned = call(argument, value, method, expected, function, ngs.x, ngs.y)
    try:
        if not isinstance(returned, ngs.CoefficientFunction):
            returned = ngs.CF(tuple(returned))
    except (TypeError, ValueError, AttributeError, NgException) as error:
        raise refusal(argument, value, method, expected, error) from error
    if tuple(returned.dims) != (size,) or returned.is_complex:
        kind = "complex ones" if returned.is_complex else tuple(returned.dims)
        raise refusal(argument, value, method, expected, f"not {kind}")
    return returned


def stiffness(fabric):
    """`fabric.stiffness`, whatever it is; None if there is none."""
    told = "fabric.stiffness", fabric, f"{type(fabric).__name__}.stiffness", "a number"
    return call(*told, getattr, fabric, "stiffness", None)


def energy(fabric, *invariants):
    """W of a fabric, a scalar expression of its invariants."""
    called = "I4, I6, I8" + (", K11, K22, K12" if of_curvature(fabric) else "")
    called += ", X1, X2" if of_place(fabric) else ""
    told = "fabric", fabric, f"{type(fabric).__name__}.energy({called})"
    expected = "one scalar expression of NGSolve"
    return scalar(*told, expected, call(*told, expected, fabric.energy, *invariants))


def slacks(limit, cloth):
    """The slacks of a limit, a tuple of scalar expressions."""
    told = "constraints", limit, f"{type(limit).__name__}.slacks(cloth)"
    expected = "a tuple of one or more scalar expressions of NGSolve"
    returned = call(*told, expected, limit.slacks, cloth)
    if isinstance(returned, ngs.CoefficientFunction):
        raise refusal(*told, expected, "not an expression alone")
    # A generator runs the user's code only here.
    parts = call(*told, expected, lambda: tuple(returned))
    if not parts:
        raise refusal(*told, expected, "not an empty one")
    return tuple(scalar(*told, expected, part) for part in parts)


def cost_density(cost, cloth):
    """The cost χ of a scene, a scalar expression."""
    told = "cost", cost, f"{getattr(cost, '__name__', type(cost).__name__)}(cloth)"
    expected = "one scalar expression of NGSolve"
    return scalar(*told, expected, call(*told, expected, cost, cloth))


def refusal(argument, value, method, expected, why):
    """The `InputError` that names a method and what it must return."""
    text = " ".join(str(why).split())
    return InputError(argument, value, f"`{method}` must return {expected} ({text})")
