"""The cut pattern: what goes on the sheet, in millimetres, read off a `Result`.

The patch is drawn as it lies in the material plane, X1 to the right and X2 upwards, so that warp
threads (X2 = const) and weft threads (X1 = const) are straight lines and clipping them to the
outline is exact. Nothing is ever mirrored.
"""

import textwrap
import warnings
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..errors import InputError, check_integer, check_number
from ..geometry.file_surface import UNITS, FileSurface
from .planar import Room, chords, crossing
from .plot import check_right_angles, thread_levels

LATTICE = 2**20  # points of the rim between which the outline is refined
FIRST = 256  # chords of the outline before refinement
MOST = 5000  # chords to be halved at once
CORNER = np.radians(5)  # a rim that turns by more between two points of the lattice has a corner
NARROW = 2.0  # mm: cloth less wide than this frays
MOST_MARKS, LEAST_PITCH = 1000, 1e-3  # a pitch over the size
SIZES = 1e-3, 1e9  # mm, of a patch
ROUGH = 1e-2  # of the size: the greatest tolerance
AREA_ERROR = 2e-5  # what the default tolerance may change of the area
SQUARE, GAP, TEXT, TICK = 100.0, 10.0, 5.0, 4.0  # mm


class Curve(NamedTuple):
    """A polyline, points (n, 2) in mm; the first point of a closed one is not repeated."""

    points: np.ndarray
    closed: bool = False


class Text(NamedTuple):
    """One line of text: where its baseline starts, or has its middle if `centred`; mm."""

    text: str
    position: np.ndarray
    height: float
    centred: bool = False


class Marks(NamedTuple):
    """Pinning marks, numbered from 1: mark ``number[i]`` of the cloth goes to ``space[i]``.

    Attributes
    ----------
    number : ndarray of int, (n,)
    flat : ndarray, (n, 2)
        ψ(θ), on the outline of the patch.
    theta : ndarray, (n, 2)
        Points of the rim of the domain, in the parameters of the chart.
    space : ndarray, (n, 3)
        φ(θ), on the rim of the surface.
    """

    number: np.ndarray
    flat: np.ndarray
    theta: np.ndarray
    space: np.ndarray


@dataclass(frozen=True)
class Pattern:
    """Everything on the sheet, in mm; the origin is that of ψ, X1 to the right and X2 upwards.

    Attributes
    ----------
    title : str
        Scene and scale.
    outline : ndarray, (n, 2)
        The rim of the patch, counter-clockwise, closed without repeating its first point; holes
        are in the layers alone.
    layers : dict of list
        The `Curve` and `Text` items of the layers "cut" (where to cut), "seam" (the outline
        within its allowance, else empty), "warp", "weft", "mark" (on the cloth: pinning marks,
        grain arrow) and "text" (beside it: label, scale square).
    marks : Marks
        The pinning marks, lengths in mm.
    """

    title: str
    outline: np.ndarray
    layers: dict
    marks: Marks

    @property
    def box(self):
        """Corners of the sheet: everything drawn and a margin around, ((2,), (2,))."""
        corners = [corner for items in self.layers.values() for corner in map(_corners, items)]
        low = np.min([low for low, _ in corners], axis=0)
        high = np.max([high for _, high in corners], axis=0)
        return low - GAP, high + GAP


def cut_pattern(result, *, unit_mm=None, pitch=None, seam=0.0, marks=12, tolerance=None):
    """The cut pattern of a result.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    unit_mm : float, optional
        Scale: how many mm one unit of length of the surface is. Default 100, and for surfaces
        from files what their unit is. The label of the pattern states it, and a square of 100 mm
        lets one check the print.
    pitch : float, optional
        Distance in mm between the threads drawn, which lie at its multiples. Default 10, or a
        tenth of the patch's width where that is less, but a thousandth of its size at least.
    seam : float, optional
        Seam allowance in mm, at most the size of the patch: the cut is the outline, offset by it
        with round corners, and the outline itself is in the layer "seam". Default 0: the cut is the
        outline.
    marks : int, optional
        Number of pinning marks along the rim, at most 1000, see `pinning_marks`. Default 12.
    tolerance : float, optional
        How far in mm the polylines may be from the rim of the patch and from its offset, at most
        a hundredth of the patch's size. By default 0.01, or less where the area would change by
        more than 2e-5 of itself.

    Returns
    -------
    Pattern

    Warns
    -----
    UserWarning
        If the patch overlaps itself, has parts narrower than 2 mm, or has not converged.

    Raises
    ------
    InputError
        If an argument is out of bounds, or threads run in other directions than those of X1 and
        X2; before any file is written.
    OSError
        If a file cannot be written, which leaves that file as it was.
    ImportError
        If there is a seam allowance, and the extra ``cut`` is missing.
    """
    check_right_angles(result)
    if unit_mm is None:
        surface = result.scene.surface
        unit_mm = UNITS[surface.unit] if isinstance(surface, FileSurface) else 100.0
    check_number("unit_mm", unit_mm, 0, open_low=True)
    if pitch is not None:
        check_number("pitch", pitch, 0, open_low=True)
    check_number("seam", seam, 0)
    if check_integer("marks", marks, 0) > MOST_MARKS:
        raise InputError("marks", marks, f"an integer, 0 to {MOST_MARKS}")
    if tolerance is not None:
        check_number("tolerance", tolerance, 0, open_low=True)
    coarse = unit_mm * result.outline(400)
    size = float(np.ptp(coarse, axis=0).max())
    if not SIZES[0] <= size <= SIZES[1]:
        allowed = f"a scale at which the patch is {SIZES[0]:g} to {SIZES[1]:g} mm, not {size:.3g}"
        raise InputError("unit_mm", unit_mm, allowed)
    check_number("seam", seam, 0, size)
    if pitch is None:
        pitch = min(10.0, np.ptp(coarse, axis=0).min() / 10)
        pitch = float(f"{max(pitch, 1.1 * LEAST_PITCH * size):.2g}")
    if pitch < LEAST_PITCH * size:
        raise InputError("pitch", pitch, "mm, at least a thousandth of the patch")
    if tolerance is not None:
        check_number("tolerance", tolerance, 0, ROUGH * size, open_low=True)
    else:
        length = np.linalg.norm(coarse - np.roll(coarse, 1, axis=0), axis=1).sum()
        tolerance = min(0.01, AREA_ERROR * unit_mm**2 * result.area / length)
    outline, *holes = (
        refined_outline(result, unit_mm, tolerance, hole) for hole in range(result.domain.holes + 1)
    )
    room = Room(outline, NARROW / 4, holes)
    _warn(result, (outline, *holes), room)

    pins = pinning_marks(result, marks, unit_mm)
    edges = [Curve(each, closed=True) for each in (outline, *holes)]
    cut = _offset(outline, holes, seam, tolerance) if seam else edges
    low = np.min([curve.points.min(axis=0) for curve in cut], axis=0)
    title = f"{result.scene.name} (1 unit of surface length = {unit_mm:g} mm)"
    layers = {
        "cut": cut,
        "seam": edges if seam else [],
        "warp": _threads(outline, holes, pitch, axis=0),
        "weft": _threads(outline, holes, pitch, axis=1),
        "mark": _mark_items(pins.flat, outline, room) + _grain_arrow(room, pitch),
        "text": _beside(low, _label(result, outline, unit_mm, pitch, seam)),
    }
    return Pattern(title, outline, layers, pins)


def pinning_marks(result, n, unit_mm=1.0):
    """Matching marks on the rim of the patch and on the rim of the surface.

    They are equally spaced in the parameter of the rim, counter-clockwise in θ from the largest
    θ1 on the axis θ2 = centre; six marks or more meet the corners of a `Rectangle`.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    n : int
        How many.
    unit_mm : float, optional
        Scale of `flat` and `space`. Default 1: units of length of the surface.

    Returns
    -------
    Marks
    """
    if check_integer("n", n, 0) == 0:
        return Marks(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 3)))
    theta = result.domain.rim(n)
    space = result.evaluate(result.whole.position, theta)
    return Marks(np.arange(1, n + 1), unit_mm * result.psi(*theta.T), theta, unit_mm * space)


def refined_outline(result, unit_mm, tolerance, hole=0):
    """The rim of the whole flat patch as a polyline in mm, corners of the domain included.

    Chords are halved until three points of the rim between their ends are closer to them than
    half the tolerance; the middle one is kept, so that smooth parts are about eight times closer.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    unit_mm : float
        Scale, as for `cut_pattern`.
    tolerance : float
        In mm.
    hole : int, optional
        Its number, from 1, in place of the rim outside.

    Returns
    -------
    ndarray, (n, 2)
        Counter-clockwise, around a hole clockwise, the first point not repeated.
    """
    rim = result.domain.rim(LATTICE, hole) if hole else result.domain.rim(LATTICE)

    def flat(index):
        return unit_mm * result.psi(*rim[index % LATTICE].T)

    left = np.union1d(np.arange(0, LATTICE, LATTICE // FIRST), _corner_indices(rim))
    right = np.append(left[1:], LATTICE)
    indices, points = [left], [flat(left)]
    start, end = points[0], np.roll(points[0], -1, axis=0)
    while left.size:
        middle = (left + right) // 2
        centre = flat(middle)
        indices.append(middle), points.append(centre)
        # A kink may hide from the middle of its chord, but not from three points.
        error = _distance(centre, start, end)
        for quarter in ((left + middle) // 2, (middle + right) // 2):
            error = np.maximum(error, _distance(flat(quarter), start, end))
        coarse = error > tolerance / 2
        if coarse.sum() > MOST or (error[right - left < 4] > 2 * tolerance).any():
            raise InputError("tolerance", tolerance, "mm, not that fine for this patch")
        coarse &= right - left > 1
        left, middle, right = left[coarse], middle[coarse], right[coarse]
        start, centre, end = start[coarse], centre[coarse], end[coarse]
        left, right = np.concatenate([left, middle]), np.concatenate([middle, right])
        start, end = np.concatenate([start, centre]), np.concatenate([centre, end])
    _, once = np.unique(np.concatenate(indices), return_index=True)
    return np.concatenate(points)[once]


def require(module):
    """Import an optional module, or say what to install."""
    from importlib import import_module

    try:
        return import_module(module)
    except ImportError as error:
        extra = "pip install 'ngcloth[cut]', in a clone '.[cut]'"
        message = f"DXF and seam allowances need {module}: {extra}"
        raise ImportError(message, name=module) from error


def _corner_indices(rim):
    """Where the closed polyline `rim` turns sharply."""
    before, after = rim - np.roll(rim, 1, axis=0), np.roll(rim, -1, axis=0) - rim
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.arctan2(cross, np.sum(before * after, axis=1))
    return np.flatnonzero(np.abs(turn) > CORNER)


def _distance(point, start, end):
    """Distances of points (n, 2) from the segments between `start` and `end`, (n, 2) each."""
    along = end - start
    square = np.maximum(np.sum(along**2, axis=1), np.finfo(float).tiny)
    share = np.clip(np.sum((point - start) * along, axis=1) / square, 0, 1)
    return np.linalg.norm(point - start - share[:, None] * along, axis=1)


def _warn(result, outlines, room):
    """Say what is wrong with the patch, to the caller of an export."""
    flaws = []
    if not result.converged:
        flaws.append(f"this is the pattern of a solve that did not converge: {result.reason}")
    # As J > 0, the patch is free of overlap if and only if its outlines are.
    if crossing(*outlines):
        flaws.append("the patch overlaps itself: it cannot be cut from one piece of cloth")
    elif (place := room.narrowest(NARROW)) is not None:
        where = f"for instance at ({place[0]:.1f}, {place[1]:.1f}) mm"
        flaws.append(f"the patch has parts narrower than {NARROW:g} mm, {where}")
    for flaw in flaws:
        warnings.warn(flaw, UserWarning, stacklevel=4)


def _offset(outline, holes, distance, tolerance):
    """The parallel curves of an outline, all of them closed: an outline and perhaps holes."""
    shapely = require("shapely")
    region = shapely.make_valid(shapely.Polygon(outline, holes), method="structure")
    arc = 2 * np.arccos(1 - min(tolerance / distance, 0.1))
    wider = region.buffer(distance, quad_segs=int(np.ceil(np.pi / 2 / arc)))
    rings = [ring for part in shapely.get_parts(wider) for ring in (part.exterior, *part.interiors)]
    return [Curve(np.array(ring.coords)[:-1], closed=True) for ring in rings]


def _threads(outline, holes, pitch, axis):
    """Threads along `axis`, at the multiples of `pitch`, within the outline."""
    levels = thread_levels(outline[:, 1 - axis], pitch)
    return [Curve(chord) for chord in chords(outline, levels, axis, holes)]


def _mark_items(flat, outline, room):
    """For each mark a tick from the outline inwards, and its number where there is room for it."""
    length = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum()
    size = min(TICK, length / max(len(flat), 1) / 4)
    items = []
    for number, point in enumerate(flat, start=1):
        middle = room.nearest(point, 1.8 * size)
        distance = np.linalg.norm(middle - point)  # 0 where another part overlaps the rim
        tick = point + (middle - point) * min(1, size / max(distance, 1e-12))
        items.append(Curve(np.stack([point, tick])))
        items.append(Text(str(number), middle - [0, size / 2], size, centred=True))
    return items


def _grain_arrow(room, pitch):
    """The double arrow along the warp, in the widest place of the cloth, between two threads."""
    widest = np.argmax(room.radii)
    (x, y), radius = room.centres[widest], room.radii[widest]
    between = (np.floor(y / pitch) + 0.5) * pitch
    y = between if abs(between - y) < radius / 4 else y
    half, head, size = radius / 2, radius / 15, radius / 25
    items = [Curve(np.array([[x - half, y], [x + half, y]]))]
    for end, back in ((x - half, head), (x + half, -head)):
        items.append(
            Curve(np.array([[end + back, y + head / 3], [end, y], [end + back, y - head / 3]]))
        )
    return [*items, Text("warp", np.array([x, y + 0.6 * size]), size, centred=True)]


def _label(result, outline, unit_mm, pitch, seam):
    """What the sheet says of itself, line by line."""
    scene = result.scene
    fabric = str(scene.fabric)
    if " object at 0x" in fabric:
        fabric = type(scene.fabric).__name__
    width, height = np.ptp(outline, axis=0)
    area = unit_mm**2 * result.area / 100
    face = "looks away from" if result.sheet.side == 1 else "lies against"  # E1 × E2 is upwards
    lines = [
        scene.name,
        f"fabric: {fabric}",
        f"scale: 1 unit of surface length = {unit_mm:g} mm; this square is {SQUARE:g} mm wide",
        f"patch: {width:.1f} × {height:.1f} mm, {area:.1f} cm²",
        f"seam allowance: {seam:g} mm" if seam else "no seam allowance",
        f"warp along the arrow; threads drawn every {pitch:g} mm",
        f"drawn from the face of the cloth that {face} the surface",
    ]
    if not result.converged:
        lines.append(f"NOT CONVERGED: {result.reason}")
    return [part for line in lines for part in textwrap.wrap(line, 70)]


def _beside(corner, lines):
    """The scale square below the lower left corner of the pattern, the label to its right."""
    top = corner - [0, GAP]
    square = top + SQUARE * np.array([[0, -1], [1, -1], [1, 0], [0, 0]])
    first = top + [SQUARE + GAP, -TEXT]
    texts = [Text(line, first - [0, 1.8 * TEXT * i], TEXT) for i, line in enumerate(lines)]
    size = Text(f"{SQUARE:g} mm", square.mean(axis=0) - [0, TEXT / 2], TEXT, centred=True)
    return [Curve(square, closed=True), size, *texts]


def _corners(item):
    """Lower left and upper right corner of an item; a text is about 0.75 heights wide a letter."""
    if isinstance(item, Curve):
        return item.points.min(axis=0), item.points.max(axis=0)
    width = 0.75 * item.height * len(item.text)
    left = item.position - [width / 2 if item.centred else 0, 0.3 * item.height]
    return left, left + [width, 1.3 * item.height]
