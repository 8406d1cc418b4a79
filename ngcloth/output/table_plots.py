"""Pictures of a table of many cases."""

import numbers

import numpy as np

from ..errors import InputError


def scatter(table, x, y, colour=None, ax=None):
    """Draw one column against another, a point a case.

    Parameters
    ----------
    table : list of dict
        As of `Study.table`.
    x, y : str
        Columns. An axis is logarithmic where all numbers are positive and span two decades.
    colour : str, optional
        A column of numbers for the colour of the points.
    ax : matplotlib.axes.Axes, optional
        Where to draw. By default on a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        Cases that have not converged are crosses; those without a number are left out.

    Raises
    ------
    InputError
        If a column is not there, or not of numbers.
    """
    columns = [_numbers(table, name) for name in (x, y, colour) if name is not None]
    converged = np.array([bool(row.get("converged")) for row in table])
    ax = _axes(ax)
    shown = np.isfinite(columns).all(axis=0)
    style = {} if colour is None else {"vmin": columns[2][shown].min(initial=np.inf)}
    style |= {} if colour is None else {"vmax": columns[2][shown].max(initial=-np.inf)}
    for chosen, marker in ((shown & converged, "o"), (shown & ~converged, "x")):
        colours = None if colour is None else columns[2][chosen]
        drawn = ax.scatter(
            *(c[chosen] for c in columns[:2]), s=14, marker=marker, c=colours, **style
        )
        if colour is not None and marker == "o":
            ax.figure.colorbar(drawn, ax=ax, label=colour)
    for values, scale in ((columns[0], ax.set_xscale), (columns[1], ax.set_yscale)):
        if _decades(values[shown]):
            scale("log")
    ax.set(xlabel=x, ylabel=y)
    return ax


def parallel_coordinates(table, columns, ax=None):
    """Draw a line a case across upright axes, one a column, each from its least to its greatest.

    Parameters
    ----------
    table : list of dict
        As of `Study.table`.
    columns : sequence of str
        Two or more, of numbers; the last one colours the lines. Axes are logarithmic where all
        numbers are positive and span two decades.
    ax : matplotlib.axes.Axes, optional
        Where to draw. By default on a new figure of pyplot.

    Returns
    -------
    matplotlib.axes.Axes
        Cases that have not converged are dotted; those without a number are left out.

    Raises
    ------
    InputError
        If a column is not there, or not of numbers; there are fewer than two; or no case has a
        number in each.
    """
    import matplotlib as mpl

    if isinstance(columns, str) or len(columns) < 2:
        raise InputError("columns", columns, "names of two or more columns")
    values = np.array([_numbers(table, name) for name in columns])
    converged = np.array([bool(row.get("converged")) for row in table])
    shown = np.isfinite(values).all(axis=0)
    if not shown.any():
        empty = [n for n, row in zip(columns, values, strict=True) if not np.isfinite(row).any()]
        raise InputError("columns", columns, f"columns that a case has all of; none has {empty}")
    values, converged = values[:, shown], converged[shown]
    heights = np.array([np.log(row) if _decades(row) else row for row in values])
    low, span = heights.min(axis=1, keepdims=True), np.ptp(heights, axis=1, keepdims=True)
    heights = np.where(span > 0, (heights - low) / np.where(span > 0, span, 1), 0.5)
    ax = _axes(ax)
    places = np.arange(len(columns))
    for line, solved in zip(heights.T, converged, strict=True):
        colour = mpl.colormaps["viridis"](line[-1])
        ax.plot(places, line, color=colour, linewidth=0.8, linestyle="-" if solved else ":")
    for place, row in zip(places, values, strict=True):
        ax.axvline(place, color="0.3", linewidth=0.8)
        for end, at, side in ((row.min(), -0.02, "top"), (row.max(), 1.02, "bottom")):
            ax.text(place, at, f"{end:.3g}", ha="center", va=side, fontsize="small")
    ax.set_xticks(places, columns)
    ax.tick_params(axis="x", pad=14, length=0)
    ax.set(yticks=[], ylim=(-0.02, 1.02))
    ax.spines[:].set_visible(False)
    return ax


def _axes(ax):
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6.4, 4.4), layout="compressed")
    return ax


def _numbers(table, name):
    """A column as floats, NaN where there is none."""
    if not any(name in row for row in table):
        raise InputError("column", name, f"one of {', '.join(table[0] if table else ())}")
    values = [row.get(name) for row in table]
    wrong = [v for v in values if not (v is None or isinstance(v, numbers.Real))]
    if wrong:
        raise InputError("column", name, f"a column of numbers; it has {wrong[0]!r}")
    return np.array([np.nan if value is None else float(value) for value in values])


def _decades(values):
    return len(values) > 0 and values.min() > 0 and values.max() >= 100 * values.min()
