"""One page about a result, to open in a browser without a network."""

import base64
import io
import json
from html import escape
from importlib.resources import files as package_files
from string import Template
from urllib.parse import quote

import numpy as np

from ..errors import InputError, check_result
from ..problem.bars import with_bar
from ..problem.domain import MeshDomain
from ..problem.fabric import directions
from .angles import BANDS, checked_limits, on_bands
from .files import checked_file, write_file
from .plot import (
    LABELS,
    central_frame,
    colours,
    default_pitch,
    draw,
    plain,
    sample,
    sampled_field,
)

RINGS = 30  # of the cloth to turn, see `sample`
SIZE, DPI = (4.6, 3.5), 170  # inches, pixels per inch: letters stay readable in a column


def report(result, path, files=(), limits=None):
    """Write one self-contained HTML page: scene, certificate, numbers, figures, the cloth to turn.

    Parameters
    ----------
    result : Result
        If it has not converged, the page says so at its top, and why.
    path : path
        Ends in ".html".
    files : sequence of path, optional
        Exported files and folders to link to, in the folder of the page or below it; relative
        paths start there.
    limits : (float, float), optional
        Of the three colours of the shear angle, 15° and 30° by default.

    Returns
    -------
    Path
        The page.

    Raises
    ------
    InputError
        If the path has another ending or names a folder, its folder does not exist, a file to
        link to is not there, or the limits are not two angles; before anything is computed.
    OSError
        If the page cannot be written, which leaves a former one as it was.

    Notes
    -----
    The page loads nothing: figures are PNG within it, the cloth is drawn by a script of its own.
    The domain of a chart has to be star-shaped about its centre, see `ngcloth.plot.sample`.
    """
    page = checked_file(path, ".html")
    links, limits = _links(page.parent, files), checked_limits(limits)
    check_result(result)
    fields = ["stretch1", "stretch2", "shear", "angle", "thickness"]
    if not result.scene.inextensible:
        fields.append("reaction")
    certificate = result.certificate()
    kind, verdict = _verdict(result, certificate)
    template = package_files(__package__).joinpath("report.html").read_text(encoding="utf-8")
    text = Template(template).substitute(
        title=escape(result.scene.name),
        kind=kind,
        verdict=escape(verdict),
        certificate=_certificate(certificate),
        scene="".join(f"<div>{escape(line)}</div>" for line in str(result.scene).splitlines()),
        numbers=_table(_numbers(result, certificate)),
        extrema=_table(_extrema(result)),
        angles=_table(_angles(result, limits)),
        settings=_table(_settings(result)),
        figures="\n".join(_figures(result, fields, limits)),
        links=links,
        cloth=json.dumps(_cloth(result, fields, limits), separators=(",", ":"), allow_nan=False),
    )
    write_file(page, text.encode())
    return page


def _links(folder, files):
    """The section that links to files below `folder`; empty if there are none."""
    items = []
    if isinstance(files, str):
        raise InputError("files", files, "a sequence of paths")
    for file in files:
        try:
            target = (folder / file).resolve().relative_to(folder.resolve())
        except (TypeError, ValueError):
            raise InputError("files", file, "paths in the folder of the page") from None
        if not (folder / target).exists():
            raise InputError("files", str(file), f"paths that exist in {folder.resolve()}")
        name = target.as_posix()
        items.append(f'<li><a href="{quote(name)}">{escape(name)}</a></li>')
    return f"<h2>Files</h2>\n<ul>{''.join(items)}</ul>" if items else ""


def _verdict(result, certificate):
    """How the page begins: a class of its style, and a sentence."""
    certified = "certified:" if certificate.certified else "not certified:"
    if not result.converged:
        reason = str(result.reason)
        return "bad", (
            f"Not converged. {reason[0].upper()}{reason[1:]}. "
            f"What follows is the last good iterate, not a solution; it is {certified}"
        )
    if not certificate.certified:
        return "doubtful", f"Converged, but {certified}"
    return "good", f"Converged and {certified}"


def _certificate(certificate):
    """What the certificate says, as items: each fault, or how well all holds."""
    said = certificate.faults or certificate.findings
    return "".join(f"<li>{escape(each)}</li>" for each in said)


def _numbers(result, certificate):
    bars, length = result.error, result.scene.surface.unit
    normalized = bars["energy"] and bars["energy"] / result.scene.normalisation
    rows = [
        (f"energy E [stiffness × {length}²]", with_bar(f"{result.energy:.6g}", bars["energy"])),
        ("energy E/(2π kc)", with_bar(f"{result.normalized_energy:.6g}", normalized)),
        (f"area of the flat patch [{length}²]", with_bar(f"{result.area:.6g}", bars["area"])),
    ]
    if bars["outline"] is not None:
        rows.append((f"outline [{length}]", with_bar("", bars["outline"]).strip()))
    if certificate.equilibrium is not None:
        rows.append(("force out of equilibrium, share", f"{certificate.equilibrium:.2g}"))
    return [
        *rows,
        ("accepted steps", len(result.history)),
        ("Newton steps", result.newton_iterations),
        ("time of the solve [s]", f"{result.seconds:.2f}"),
        ("why it stopped", result.reason),
    ]


def _extrema(result):
    rows = [("field", "least", "greatest")]
    for name, limits in result.extrema.items():
        unit = result.scene.fabric.stiffness if name == "reaction" else 1.0
        label = LABELS.get(name, f"stretch of family {name.removeprefix('stretch')}")
        rows.append((plain(label), *(f"{value / unit:.6g}" for value in limits)))
    return rows


def _angles(result, limits):
    rows = [("sheared by more than", "area on the surface", "share")]
    for limit, (area, share) in result.area_beyond(limits).items():
        rows.append((f"{limit:g}°", f"{area:.6g}", f"{share:.1%}"))
    return rows


def _settings(result):
    from ..version import __version__

    return [*result.settings.items(), ("ngcloth", __version__)]


def _table(rows):
    """Rows of HTML; the first cell of each is its heading."""
    lines = []
    for head, *cells in rows:
        cells = "".join(f"<td>{escape(str(cell))}</td>" for cell in cells)
        lines.append(f"<tr><th>{escape(str(head))}</th>{cells}</tr>")
    return "\n".join(lines)


def _figures(result, fields, limits):
    """The figures of the page, patch first and history last."""
    pitch = default_pitch(result.outline())
    yield _figure(
        result,
        f"The flat patch: warp threads in blue, weft threads in orange, {pitch:.3g} apart.",
    )
    for field in fields:
        three = limits if field == "angle" else None
        yield _figure(result, f"On the patch: {plain(LABELS[field])}.", field, limits=three)
    if result.history:
        yield _figure(result, "How the solve went, step by step.", where="history")
    else:
        yield "<p>The solve accepted no step, and so has no history.</p>"


def _figure(result, caption, field=None, where="patch", limits=None):
    from matplotlib.figure import Figure

    figure, picture = Figure(figsize=SIZE, layout="compressed"), io.BytesIO()
    draw(result, field, where, figure.subplots(), limits)
    figure.savefig(picture, format="png", dpi=DPI)
    encoded = base64.b64encode(picture.getvalue()).decode()
    return (
        f'<figure><img alt="{escape(caption)}" src="data:image/png;base64,{encoded}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def _cloth(result, fields, limits):
    """The surface for the script of the page, all numbers whole to keep it small.

    Per point: its place in the frame of the centre, in a ball of radius 10000; its normal, times
    100; "lines", in thousandths: places across weft and warp, X1 and X2 if these are at right
    angles, over the pitch, threads being where they are integers, and the number of rings to the
    rim. Per field and point: a place from 0 to 255 on a map of colours.
    """
    theta, triangles = sample(result, RINGS)
    frame = central_frame(result)
    points, normals = (
        result.evaluate(each, theta) @ frame.T
        for each in (result.whole.position, result.whole.normal)
    )
    points -= (points.min(axis=0) + points.max(axis=0)) / 2
    points /= np.linalg.norm(points, axis=1).max()
    psi = result.psi(*theta.T)
    if isinstance(result.domain, MeshDomain):
        from_rim = np.where(result.domain.on_rim(theta), 0, 1)
    else:
        from_rim = np.append(RINGS, np.repeat(np.arange(RINGS)[::-1], 4 * RINGS))
    warp, weft = directions(result.scene.fabric)[:2]
    across = psi @ np.array([[weft[1], -warp[1]], [-weft[0], warp[0]]])
    lines = np.column_stack([across / default_pitch(psi), from_rim])

    def whole(values):
        return np.rint(values).astype(int).ravel().tolist()

    return {
        "points": whole(1e4 * points),
        "normals": whole(1e2 * normals),
        "lines": whole(1e3 * lines),
        "triangles": whole(triangles),
        "fields": [_coloured(result, field, theta, limits, whole) for field in fields],
    }


def _coloured(result, field, theta, limits, whole):
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    values, marks = sampled_field(result, field, theta), []
    if field == "angle":
        places, high = on_bands(values, limits)
        low, share, marks = 0, places / 3, limits
        table = np.array([to_rgb(colour) for colour in BANDS])[np.arange(256) // 86]
    else:
        chosen = colours(field, values)
        low, high = chosen["vmin"], chosen["vmax"]
        share = (values - low) / (high - low) if high > low else np.full_like(values, 0.5)
        table = colormaps[chosen["cmap"]](np.arange(256))[:, :3]
    return {
        "label": plain(LABELS[field]),
        "low": f"{low:.3g}",
        "high": f"{high:.3g}",
        "marks": [f"{mark:.3g}" for mark in marks],
        "values": whole(255 * share),
        "colours": whole(255 * table),
    }
