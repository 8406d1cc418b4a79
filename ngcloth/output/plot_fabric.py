"""The curves of a fabric over the rows of its tests."""

import numpy as np

from ..errors import InputError

FARTHER = 1.15  # than the last row
DRAWN = {
    "warp": (r"warp stretch $\lambda_1$", "force per width"),
    "weft": (r"weft stretch $\lambda_2$", "force per width"),
    "shear": ("shear angle [°]", "shear force per length"),
}


def draw(fabric, axes=None):
    """Draw the curves of a measured fabric; where there are no rows, dashed.

    Parameters
    ----------
    fabric : MeasuredFabric
        With its tests.
    axes : sequence of matplotlib.axes.Axes, optional
        Three, for warp, weft and shear. By default on a new figure of pyplot.

    Returns
    -------
    sequence of matplotlib.axes.Axes

    Raises
    ------
    InputError
        If there are not three axes.
    """
    if axes is None:
        import matplotlib.pyplot as plt

        _, axes = plt.subplots(1, 3, figsize=(10, 3.4), layout="constrained")
    if np.shape(axes) != (len(DRAWN),):
        raise InputError("axes", np.shape(axes), "three, for warp, weft and shear")
    for ax, (name, (across, up)) in zip(axes, DRAWN.items(), strict=True):
        curve = fabric.curves[name]
        at, slopes = fabric.readings[name].points(curve)
        within = np.linspace(0, curve.end, 300)
        beyond = np.linspace(curve.end, curve.end * FARTHER, 40)
        if name == "shear":
            beyond = np.minimum(beyond, 1.0)

        ax.plot(*_measured(name, at, slopes), ".", color="0.6", markersize=4, label="test")
        for strain, style, label in ((within, "-", "fabric"), (beyond, "--", "not tested")):
            line = _measured(name, strain, curve.force(strain))
            ax.plot(*line, style, color="tab:blue", label=label)
        ax.set(xlabel=across, ylabel=up)
        ax.grid(alpha=0.3)
        rough = fabric.scatter[name]
        ax.set_title(f"{len(at)} rows, {rough:.1%} of scatter", fontsize="small")
    axes[0].legend(fontsize="small")
    return axes


def _measured(name, strain, slope):
    """What a test measures where W has this derivative by I4 − 1 or by I8."""
    if name == "shear":
        return np.degrees(np.arcsin(strain)), slope
    stretch = np.sqrt(1 + strain)
    return stretch, 2 * stretch * slope
