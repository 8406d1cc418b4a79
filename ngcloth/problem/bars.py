"""Error bars of a result, in words and in files."""

from math import inf, isfinite

UNKNOWN = dict.fromkeys(("energy", "area", "outline"))
IN_WORDS = "not resolved"


def with_bar(number, bar):
    """A number, given as text, with its bar: ``0.18 ± 0.01``, or that it is not resolved.

    Parameters
    ----------
    number : str
        As it is printed.
    bar : float or None
        In the same unit; None if unknown, infinite if meshes are too coarse to tell.

    Returns
    -------
    str
    """
    if bar is None:
        return number
    return f"{number} ± {bar:.1e}" if isfinite(bar) else f"{number} ({IN_WORDS})"


def written(bars):
    """Bars as JSON knows them: infinite ones in words."""
    return {name: IN_WORDS if bar == inf else bar for name, bar in bars.items()}


def read(bars):
    """Bars as `written` left them; `ValueError` if they are none."""
    if bars.keys() != UNKNOWN.keys():
        raise ValueError(f"error has other entries than {', '.join(UNKNOWN)}")
    found = {name: inf if bar == IN_WORDS else bar for name, bar in bars.items()}
    found = {name: float(bar) if type(bar) is int else bar for name, bar in found.items()}
    for bar in found.values():
        if not (bar is None or (isinstance(bar, float) and bar >= 0)):
            raise ValueError("error is not of bars")
    return found
