"""The two ways ngcloth says no."""

import math
import numbers

import numpy as np


class InputError(ValueError):
    """An argument the library cannot work with, told before any mesh is made.

    Parameters
    ----------
    argument : str
        The name of the argument as the caller wrote it.
    value : object
        What was given.
    allowed : str
        What would have been accepted, in words.
    """

    def __init__(self, argument, value, allowed):
        super().__init__(f"{argument} = {value!r}: {allowed}")
        self.argument, self.value, self.allowed = argument, value, allowed

    def __reduce__(self):
        # By default an exception is made anew from its message alone, which ends process pools.
        return type(self), (self.argument, self.value, self.allowed)


class SolveError(RuntimeError):
    """A solve that did not converge, under ``throw=True``; ``result`` is its last good iterate."""

    def __init__(self, result):
        super().__init__(result.why)
        self.result = result

    def __reduce__(self):
        return type(self), (self.result,)


def check_number(argument, value, low=None, high=None, *, open_low=False, open_high=False):
    """Return `value` as a float; raise `InputError` unless it is finite and within the bounds."""
    below, above = ("<" if open_low else "<="), ("<" if open_high else "<=")
    interval = " ".join(
        part
        for part in (
            "" if low is None else f"{low} {below}",
            argument,
            "" if high is None else f"{above} {high}",
        )
        if part
    )
    allowed = f"a finite number, {interval}" if (low, high) != (None, None) else "a finite number"
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise InputError(argument, value, allowed)
    try:
        number = float(value)
    except OverflowError:  # an integer or a fraction that no float holds
        number = math.inf
    too_low = low is not None and (number < low or (open_low and number == low))
    too_high = high is not None and (number > high or (open_high and number == high))
    if too_low or too_high or not math.isfinite(number):
        raise InputError(argument, value, allowed)
    return number


def check_result(result):
    """Raise `InputError` unless this is a `Result`, which errors know nothing of."""
    if isinstance(result, type) or not hasattr(result, "normalized_energy"):
        raise InputError("result", result, "an ngcloth.Result")


def check_points(argument, points, size):
    """Return finite points of `size` coordinates as an array of floats, (..., size)."""
    allowed = f"finite points of {size} coordinates, (..., {size})"
    try:
        array = np.asarray(points)
        array = array.astype(float, casting="same_kind") if array.size else array.astype(float)
    except (TypeError, ValueError):
        raise InputError(argument, points, allowed) from None
    if array.ndim == 0 or array.shape[-1] != size or not np.isfinite(array).all():
        raise InputError(argument, points, allowed)
    return array


def check_integer(argument, value, low, high=None):
    """Return `value` as an int, or raise `InputError` unless it is an integer within the bounds."""
    whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if not whole or value < low or (high is not None and value > high):
        span = f"{low} or more" if high is None else f"from {low} to {high}"
        raise InputError(argument, value, f"an integer, {span}")
    return int(value)
