"""Flat pictures of a `Result` on axes of matplotlib: patch, domain, fields, convergence."""

from itertools import cycle

import numpy as np

from ..errors import InputError
from ..problem.domain import MeshDomain
from ..problem.fabric import directions
from .angles import BANDS, checked_limits, on_bands

LABELS = {
    "stretch1": r"warp stretch $\lambda_1$",
    "stretch2": r"weft stretch $\lambda_2$",
    "shear": r"shear $\gamma$",
    "angle": "shear angle [°]",
    "thickness": r"thickness $t/t_0$",
    "reaction": r"reaction $\tau/k_c$ [1/length]",
    "jacobian": r"patch area element $J$",
}
WARP, WEFT = "tab:blue", "tab:orange"
COLOURS = WARP, WEFT, "tab:green", "tab:red", "tab:purple"  # of families of threads, in turn
MOST_THREADS = 1000  # of a family
THREADS = 21  # of each family, about, by default; an odd number keeps them off the tips
PLACES = ("patch", "domain", "history")


def draw(result, field=None, where="patch", ax=None, limits=None):
    """Draw the patch, the domain or the history, as `Result.plot` does.

    Parameters
    ----------
    result : Result
        Converged or not.
    field : str, optional
        One of `LABELS`, drawn as a map in colours behind the threads.
    where : {"patch", "domain", "history"}, optional
        The flat patch with its threads, X1 and X2 in units of length; the parameter domain U with
        the same threads; or energy, residual and weight after every accepted step.
    ax : matplotlib.axes.Axes, optional
        Where to draw. By default on a new figure of pyplot.
    limits : (float, float), optional
        Of the field "angle", which is drawn in three colours: shear angles up to the first, up to
        the second, and beyond, of either sign; 15° and 30° by default.

    Returns
    -------
    matplotlib.axes.Axes
        Its title is a warning if the result has not converged, else empty.

    Raises
    ------
    InputError
        If an argument is none of these, or the result has no history; before any figure is made.
    """
    if where not in PLACES:
        raise InputError("where", where, "one of " + ", ".join(PLACES))
    if where == "history" and field is not None:
        raise InputError("field", field, "None where the history is drawn")
    if where == "history" and not result.history:
        raise InputError("where", where, "patch or domain: the solve accepted no step")
    if field is not None:
        check_field(field)
    checked_limits(limits, field)
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(figsize=(6.4, 5.2), layout="compressed")
    if where == "history":
        history(ax, result)
    else:
        sheet = patch if where == "patch" else domain
        sheet(ax, result, field=field, pitch=default_pitch(result.outline()), limits=limits)
    if not result.converged:
        ax.set_title("not converged", color="red")
    return ax


def patch(ax, result, *, field=None, pitch=None, levels=21, rings=60, limits=None, **line):
    """Draw the flat patch: its outline, its threads, a map of one field.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Where to draw; its scales are made equal.
    result : Result
        Its whole patch, mirror images included, is drawn.
    field : str, optional
        One of `LABELS`, drawn as a map in colours, with a colour bar that names it.
    pitch : float, optional
        Distance between the threads drawn, in units of length. By default there are none.
    levels : int, optional
        Number of levels of the map, at most: they are round numbers.
    rings : int, optional
        Fineness of the sampling, see `sample`.
    limits : (float, float), optional
        As for `draw`.
    **line
        How the outline is drawn, as for ``ax.plot``; for instance ``color`` and ``label``.

    Returns
    -------
    Colorbar or None
        The colour bar of the map.
    """
    bar = _sheet(ax, result, result.psi, field, pitch, limits, levels, rings, **line)
    unit = result.scene.surface.unit
    ax.set(xlabel=rf"$X_1$ [{unit}]", ylabel=rf"$X_2$ [{unit}]")
    return bar


def domain(ax, result, *, field=None, pitch=None, limits=None):
    """Draw the parameter domain, mirror images included, as `patch` draws the patch.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Where to draw; its scales are made equal.
    result : Result
        Its whole domain, mirror images included, is drawn.
    field, pitch, limits : optional
        As for `patch`; the threads are the same.

    Returns
    -------
    Colorbar or None
        The colour bar of the map.
    """
    bar = _sheet(ax, result, lambda *theta: np.stack(theta, axis=-1), field, pitch, limits)
    ax.set(xlabel=r"$\theta_1$", ylabel=r"$\theta_2$")
    return bar


def _sheet(ax, result, place, field, pitch, limits, levels=21, rings=60, **line):
    """Draw map, threads and closed rims; ``place(θ1, θ2)`` says where points go, (n, 2)."""
    bar = None
    if field is not None or pitch is not None:
        theta, triangles = sample(result, rings)
        x, y = place(*theta.T).T
    if field is not None:
        values = sampled_field(result, field, theta)
        if field == "angle":
            bar = _bands(ax, x, y, triangles, values, checked_limits(limits))
        else:
            filled = ax.tricontourf(x, y, triangles, values, levels, **colours(field, values))
            bar = ax.figure.colorbar(filled, ax=ax, label=LABELS[field], shrink=0.85)
    if pitch is not None:
        for position, family in thread_positions(result, result.psi(*theta.T)):
            ax.tricontour(
                x,
                y,
                triangles,
                position,
                levels=thread_levels(position, pitch),
                colors="0.25" if field else family,
                linewidths=0.4 if field else 0.7,
                linestyles="solid",
            )
    line = {"color": "black", "linewidth": 1.2} | line
    for rim in rims(result.domain, 400):
        ax.plot(*place(*np.concatenate([rim, rim[:1]]).T).T, **line)
        line.pop("label", None)
    ax.use_sticky_edges = False  # contours would cut the outline in half
    ax.margins(0.04)
    ax.set_aspect("equal")
    return bar


def _bands(ax, x, y, triangles, angles, limits):
    """Draw shear angles in three colours, and their bar."""
    places, greatest = on_bands(angles, limits)
    filled = ax.tricontourf(x, y, triangles, places, range(4), colors=BANDS)
    bar = ax.figure.colorbar(filled, ax=ax, label=LABELS["angle"], shrink=0.85)
    bar.set_ticks(range(4), labels=[f"{angle:.3g}" for angle in (0, *limits, greatest)])
    return bar


def history(ax, result):
    """Draw energy, residual and weight of every accepted step against the Newton steps made.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Where to draw; its vertical scale is made logarithmic.
    result : Result
        With at least one accepted step.
    """
    rows = result.history
    steps = [row.newton for row in rows]
    marked = {"marker": ".", "linewidth": 1}
    stepped = {"drawstyle": "steps-post", "linewidth": 1, "color": "0.5"}
    for column, label, style in (
        ("energy", r"energy $\mathcal{E}/(2\pi k_c)$", marked),
        ("residual", "residual before the step", marked),
        ("mu", r"weight $\mu$", stepped),
    ):
        values = [getattr(row, column) for row in rows]
        if max(values) > 0:
            ax.semilogy(steps, values, label=label, **style)
    ax.set_xlabel("Newton steps")
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.grid(alpha=0.3)
    ax.legend(fontsize="small")


def convergence(ax, result, **line):
    """Draw the energy of every accepted step against pseudo-time (Fig. 5c).

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Where to draw; both scales are made logarithmic.
    result : Result
        With at least one accepted step.
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

    For charts, the rim, shrunk towards the centre in equal steps; so the domain has to be
    star-shaped about its centre. For surfaces from files, the triangles of the mesh in equal parts.

    Parameters
    ----------
    result : Result
        Only its domain matters.
    rings : int
        Number of steps; each ring has 4 points for each. For files, about as many triangles.

    Returns
    -------
    theta : ndarray, (n, 2)
        Parameter points; for charts the centre, then ring after ring.
    triangles : ndarray of int, (m, 3)
        Counter-clockwise.
    """
    if rings < 2:
        raise InputError("rings", rings, "2 or more")
    domain, n = result.domain, 4 * rings
    if isinstance(domain, MeshDomain):
        return domain.divided(int(np.ceil(np.sqrt(8 * rings**2 / len(domain.triangles)))))
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


def rims(domain, n):
    """Points of the rim of a domain, and of those around its holes, a list of (n, 2)."""
    return [domain.rim(n)] + [domain.rim(n, hole) for hole in range(1, domain.holes + 1)]


def central_frame(result):
    """Axes to look at a surface from, right-handed unit vectors in the rows of a (3, 3) array.

    At the centre of the domain: the first along θ1, as the warp of a symmetric patch, the third
    along the normal. The second is along the weft or, where `Surface.side` is -1, against it.
    """
    centre, sheet = result.domain.centre, result.whole
    along, normal = (result.evaluate(each, centre) for each in (sheet.tangents[0], sheet.normal))
    along = along - (along @ normal) * normal  # of a file's, the normal is the more precise
    warp = along / np.linalg.norm(along)
    return np.stack([warp, np.cross(normal, warp), normal])


def check_field(name):
    """Raise `InputError` unless `name` is one of `LABELS`."""
    if not isinstance(name, str) or name not in LABELS:
        raise InputError("field", name, "one of " + ", ".join(LABELS))


def sampled_field(result, name, theta):
    """Values of the field `name` at points (n, 2), in the unit that `LABELS` gives."""
    check_field(name)
    values = result.field(name, *theta.T)
    return values / result.scene.fabric.stiffness if name == "reaction" else values


def default_pitch(psi):
    """A distance of threads for points (n, 2) of a patch: about `THREADS` of each family."""
    return float(np.sqrt(np.prod(np.ptp(psi, axis=0)))) / THREADS


def thread_positions(result, psi):
    """Of each family, the distance (n,) of flat points from its thread through 0, and its colour.

    For the warp it is X2, for the weft X1.
    """
    lines = directions(result.scene.fabric)
    sides = np.where(np.abs(lines[:, 0]) < np.abs(lines[:, 1]), -1, 1)
    distances = [
        side * (psi[:, 1] * line[0] - psi[:, 0] * line[1])
        for side, line in zip(sides, lines, strict=True)
    ]
    return list(zip(distances, cycle(COLOURS), strict=False))


def check_right_angles(result):
    """Raise `InputError` if threads do not run along X1 and X2, as files of threads have them."""
    lines = directions(result.scene.fabric)
    if not np.array_equal(lines, np.eye(2)):
        allowed = "threads along X1 and X2 alone; plot and view draw those of other directions"
        raise InputError("fabric", result.scene.fabric, allowed)


def thread_levels(position, pitch):
    """Multiples of `pitch` strictly between the least and the greatest position, (n,)."""
    if not pitch > 0:
        raise InputError("pitch", pitch, "a length > 0")
    low, high = position.min(), position.max()
    if high - low > MOST_THREADS * pitch:
        raise InputError("pitch", pitch, f"a length, at least the patch / {MOST_THREADS}")
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


def plain(label):
    """A label without the dollars and commands of TeX."""
    replacements = {
        "$": "",
        r"\lambda_": "λ",
        r"\gamma": "γ",
        r"\tau": "τ",
        "k_c": "kc",
        "t_0": "t0",
    }
    for tex, letter in replacements.items():
        label = label.replace(tex, letter)
    return label
