"""Flat pictures of a `Result` on axes of matplotlib: the patch, its fields, its convergence."""

import numpy as np

from .errors import InputError

LABELS = {
    "stretch1": r"warp stretch $\lambda_1$",
    "stretch2": r"weft stretch $\lambda_2$",
    "shear": r"shear $\gamma$",
    "reaction": r"reaction $\tau/k_c$ [1/length]",
    "jacobian": r"patch area element $J$",
}
WARP, WEFT = "tab:blue", "tab:orange"


def patch(ax, result, *, field=None, pitch=None, levels=21, rings=60, **line):
    """Draw the flat patch: its outline, its threads, a map of one field.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    result : Result
    field : str, optional
        One of `LABELS`, drawn as a map in colours, with a colour bar that names it.
    pitch : float, optional
        Distance between the threads drawn, in units of length. By default there are none.
    levels : int, optional
        Number of levels of the map, at most: they are round numbers.
    rings : int, optional
        Fineness of the sampling, see `sample`.
    **line
        How the outline is drawn, as for ``ax.plot``; for instance ``color`` and ``label``.

    Returns
    -------
    Colorbar or None
        The colour bar of the map.
    """
    bar = None
    if field is not None or pitch is not None:
        theta, triangles = sample(result, rings)
        x1, x2 = result.psi(*theta.T).T
    if field is not None:
        values = sampled_field(result, field, theta)
        filled = ax.tricontourf(x1, x2, triangles, values, levels, **colours(field, values))
        bar = ax.figure.colorbar(filled, ax=ax, label=LABELS[field], shrink=0.85)
    if pitch is not None:
        for position, warp_or_weft in ((x2, WARP), (x1, WEFT)):
            ax.tricontour(
                x1,
                x2,
                triangles,
                position,
                levels=thread_levels(position, pitch),
                colors="0.25" if field else warp_or_weft,
                linewidths=0.4 if field else 0.7,
                linestyles="solid",
            )
    outline = result.outline()
    line = {"color": "black", "linewidth": 1.2} | line
    ax.plot(*np.concatenate([outline, outline[:1]]).T, **line)
    ax.use_sticky_edges = False  # contours would cut the outline in half
    ax.margins(0.04)
    ax.set(aspect="equal", xlabel=r"$X_1$ [length]", ylabel=r"$X_2$ [length]")
    return bar


def convergence(ax, result, **line):
    """Draw the energy of every accepted step against pseudo-time (Fig. 5c).

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    result : Result
    **line
        As for ``ax.plot``.
    """
    rows = result.history
    line = {"marker": ".", "linewidth": 1} | line
    ax.loglog([row.pseudo_time for row in rows], [row.energy for row in rows], **line)
    ax.set(xlabel="pseudo-time", ylabel=r"energy $\mathcal{E}/(2\pi k_c)$")
    ax.grid(alpha=0.3)


def sample(result, rings=60):
    """Points and triangles that cover the whole domain of a result, all mirror images included.

    The rim, shrunk towards the centre in equal steps; so the domain has to be star-shaped about
    its centre.

    Parameters
    ----------
    result : Result
    rings : int
        Number of steps; each ring has 4 points for each.

    Returns
    -------
    theta : ndarray, (n, 2)
        Parameter points: the centre, then ring after ring.
    triangles : ndarray of int, (m, 3)
        Counter-clockwise.
    """
    if rings < 2:
        raise InputError("rings", rings, "2 or more")
    domain, n = result.scene.surface.domain, 4 * rings
    spokes = domain.rim(n) - domain.centre
    shrink = np.arange(1, rings + 1)[:, None, None] / rings
    theta = np.concatenate([domain.centre[None], (domain.centre + shrink * spokes).reshape(-1, 2)])

    first = np.arange(n)
    after = (first + 1) % n
    fan = np.stack([np.zeros_like(first), 1 + first, 1 + after], axis=-1)
    inner, outer = 1 + np.arange(rings - 1)[:, None] * n, 1 + np.arange(1, rings)[:, None] * n
    corners = [np.broadcast_to(ring + k, (rings - 1, n)) for ring in (inner, outer)
               for k in (first, after)]  # fmt: skip
    near, near_after, far, far_after = corners
    lower = np.stack([near, far, far_after], axis=-1).reshape(-1, 3)
    upper = np.stack([near, far_after, near_after], axis=-1).reshape(-1, 3)
    return theta, np.concatenate([fan, lower, upper])


def sampled_field(result, name, theta):
    """Values of the field `name` at points (n, 2), in the unit that `LABELS` gives."""
    if name not in LABELS:
        raise InputError("field", name, "one of " + ", ".join(LABELS))
    values = result.field(name, *theta.T)
    return values / result.scene.fabric.stiffness if name == "reaction" else values


def thread_levels(position, pitch):
    """Multiples of `pitch` strictly between the least and the greatest position, (n,)."""
    if not pitch > 0:
        raise InputError("pitch", pitch, "a length > 0")
    low, high = position.min(), position.max()
    multiples = np.arange(np.ceil(low / pitch), np.floor(high / pitch) + 1) * pitch
    slack = 1e-6 * (high - low)
    multiples = multiples[(multiples > low + slack) & (multiples < high - slack)]
    if not multiples.size:
        raise InputError("pitch", pitch, f"fine enough for a thread between {low:g} and {high:g}")
    return multiples


def colours(field, values):
    """Colour map and limits: for the shear, which has a sign, symmetric about 0."""
    if field == "shear":
        limit = float(np.abs(values).max())
        return {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit}
    return {"cmap": "viridis", "vmin": float(values.min()), "vmax": float(values.max())}
