"""The cut pattern as a file at true scale: SVG, DXF, and the table of its pinning marks."""

import csv
import inspect
import io
from html.entities import codepoint2name
from xml.etree import ElementTree

import numpy as np

from .files import checked_file, write_file
from .pattern import Curve, cut_pattern, require

# Colour (red, green, blue), its number among the colours of AutoCAD, line width in mm.
LAYERS = {
    "cut": ((224, 0, 0), 1, 0.3),
    "seam": ((180, 0, 180), 6, 0.3),
    "warp": ((31, 119, 180), 5, 0.13),
    "weft": ((255, 127, 14), 30, 0.13),
    "mark": ((0, 128, 43), 3, 0.3),
    "text": ((0, 0, 0), 7, 0.18),
}
# What the encoding of DXF lacks stands there as \U+ and a number, and many programs show just that:
# Greek letters are spelled out instead.
SPELLED = {code: name for code, name in codepoint2name.items() if 0x391 <= code <= 0x3D6}
SPELLED |= {ord("≤"): "<=", ord("≥"): ">="}
CAP_HEIGHT = 0.72  # of a font, in its size
INKSCAPE = "http://www.inkscape.org/namespaces/inkscape"


def _with_pattern_options(write):
    """Put the options of `cut_pattern` in the place of ``**options``, for ``help`` to show."""
    own, source = inspect.signature(write).parameters, inspect.signature(cut_pattern).parameters
    shown = [each for each in own.values() if each.kind is not each.VAR_KEYWORD]
    shown += [each for each in source.values() if each.kind is each.KEYWORD_ONLY]
    write.__signature__ = inspect.Signature(shown)
    if write.__doc__:  # python -OO leaves none
        first = next(each.name for each in source.values() if each.kind is each.KEYWORD_ONLY)
        _, *told = inspect.cleandoc(cut_pattern.__doc__).partition(f"{first} : ")
        head = inspect.cleandoc(write.__doc__).partition("**options\n")[0]
        write.__doc__ = head + "".join(told).replace("Returns\n-------\nPattern\n\n", "")
    return write


@_with_pattern_options
def export_svg(result, path, *, marks_csv=None, **options):
    """Write the cut pattern at true scale as SVG, one user unit being one mm.

    The layers are "cut", "seam", "warp", "weft", "mark" and "text"; each is a group with this id,
    and a layer of Inkscape. Seam allowances need the extra ``cut``.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    path : path
        The file to write, replaced if it is there.
    marks_csv : path, optional
        Where to write the pinning marks as a table as well: flat position, θ, position in space.
    **options
        As for `ngcloth.output.pattern.cut_pattern`.
    """
    file, table = _checked(path, marks_csv)
    pattern = cut_pattern(result, **options)
    ElementTree.register_namespace("", "http://www.w3.org/2000/svg")
    ElementTree.register_namespace("inkscape", INKSCAPE)
    (left, bottom), (right, top) = pattern.box
    width, height = f"{right - left:.4f}", f"{top - bottom:.4f}"
    root = ElementTree.Element(
        "svg",
        {
            "xmlns": "http://www.w3.org/2000/svg",
            "version": "1.1",
            "width": f"{width}mm",
            "height": f"{height}mm",
            "viewBox": f"0 0 {width} {height}",
        },
    )
    ElementTree.SubElement(root, "title").text = pattern.title
    for name, items in pattern.layers.items():
        layer = _svg_layer(root, name)
        for item in items:
            _add_to_svg(layer, item, np.array([left, top]))
    ElementTree.indent(root)
    write_file(file, ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))
    if table:
        write_marks(table, pattern.marks)


@_with_pattern_options
def export_dxf(result, path, *, marks_csv=None, **options):
    """Write the cut pattern at true scale as DXF (R2004), in mm.

    The layers are "cut", "seam", "warp", "weft", "mark" and "text". Greek letters are spelled out,
    as few programs read them in DXF. Needs the extra ``cut``.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    path : path
        The file to write, replaced if it is there.
    marks_csv : path, optional
        Where to write the pinning marks as a table as well: flat position, θ, position in space.
    **options
        As for `ngcloth.output.pattern.cut_pattern`.
    """
    file, table = _checked(path, marks_csv)
    ezdxf = require("ezdxf")
    pattern = cut_pattern(result, **options)
    # The last version whose encoding is the one its header names: not all readers know that later
    # ones are UTF-8 whatever theirs says.
    document = ezdxf.new("R2004", units=ezdxf.units.MM)
    document.header["$MEASUREMENT"] = 1  # metric
    document.styles.new("label", dxfattribs={"font": "arial.ttf"})  # has × and ²
    space = document.modelspace()
    for name, items in pattern.layers.items():
        rgb, number, line_width = LAYERS[name]
        layer = document.layers.add(name, color=number, lineweight=round(100 * line_width))
        if number != 7:  # which is black or white, whichever shows on the screen
            layer.rgb = rgb
        for item in items:
            _add_to_dxf(space, item, name)
    low, high = pattern.box
    document.set_modelspace_vport(height=high[1] - low[1], center=tuple((low + high) / 2))
    text = io.StringIO()
    document.write(text)
    write_file(file, document.encode(text.getvalue()))
    if table:
        write_marks(table, pattern.marks)


def write_marks(path, marks):
    """Write pinning marks as CSV: number, flat position, θ, position in space, one row each."""
    text = io.StringIO(newline="")
    rows = csv.writer(text)
    rows.writerow(["mark", "X1 [mm]", "X2 [mm]", "theta1", "theta2", "x [mm]", "y [mm]", "z [mm]"])
    for number, flat, theta, space in zip(*marks, strict=True):
        rows.writerow(
            [number, *(f"{v:.4f}" for v in flat), *theta.tolist(), *(f"{v:.4f}" for v in space)]
        )
    write_file(path, text.getvalue().encode())


def _checked(path, marks_csv):
    """The paths of the pattern and of its table, which may be None."""
    table = None if marks_csv is None else checked_file(marks_csv, argument="marks_csv")
    return checked_file(path), table


def _svg_layer(root, name):
    (red, green, blue), _, line_width = LAYERS[name]
    attributes = {
        "id": name,
        f"{{{INKSCAPE}}}groupmode": "layer",
        f"{{{INKSCAPE}}}label": name,
        "fill": "none",
        "stroke": f"#{red:02x}{green:02x}{blue:02x}",
        "stroke-width": f"{line_width:g}",
    }
    return ElementTree.SubElement(root, "g", attributes)


def _add_to_svg(layer, item, corner):
    """Add a curve or text; SVG counts y downwards from the upper left `corner` of the sheet."""
    if isinstance(item, Curve):
        points = (item.points - corner) * [1, -1]
        path = "M " + " L ".join(f"{x:.6f},{y:.6f}" for x, y in points)
        ElementTree.SubElement(layer, "path", {"d": path + " Z" if item.closed else path})
        return
    x, y = (item.position - corner) * [1, -1]
    attributes = {
        "x": f"{x:.4f}",
        "y": f"{y:.4f}",
        "font-size": f"{item.height / CAP_HEIGHT:.4f}",
        "font-family": "sans-serif",
        "text-anchor": "middle" if item.centred else "start",
        "fill": layer.get("stroke"),
        "stroke": "none",
    }
    ElementTree.SubElement(layer, "text", attributes).text = item.text


def _add_to_dxf(space, item, layer):
    if isinstance(item, Curve):
        space.add_lwpolyline(item.points, close=item.closed, dxfattribs={"layer": layer})
        return
    alignment = require("ezdxf.enums").TextEntityAlignment
    text = space.add_text(
        item.text.translate(SPELLED),
        height=item.height,
        dxfattribs={"layer": layer, "style": "label"},
    )
    align = alignment.CENTER if item.centred else alignment.LEFT
    text.set_placement(item.position, align=align)
