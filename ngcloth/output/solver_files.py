"""Shells with their fibre directions as input of structural solvers.

Each function takes `Shells` and the thickness of the flat cloth, and returns the text to include in
a model; the material, number 1 or named CLOTH, is the user's, with its first axis along the warp.
"""

import numpy as np


def abaqus(shells, thickness):
    """Abaqus: S3 or STRI65, axes and thickness as distributions over the elements.

    *ORIENTATION of a shell needs its second line, which names the axis about normal to it: left to
    the default, 1, not the first axis but the second would be projected on the shell.
    """
    kind = {3: "S3", 6: "STRI65"}[shells.triangles.shape[1]]
    m = len(shells.triangles)
    yield from _abaqus_mesh(shells, [f"*ELEMENT, TYPE={kind}, ELSET=CLOTH"] + [None] * (m - 1))
    yield "*DISTRIBUTION TABLE, NAME=AXES_TABLE"
    yield "COORD3D, COORD3D"
    yield "*DISTRIBUTION, NAME=AXES, LOCATION=ELEMENT, TABLE=AXES_TABLE"
    yield ", 1., 0., 0., 0., 1., 0."
    for element, axes in enumerate(shells.axes, 1):
        yield f"{element}, {_listed(axes[:2].ravel())}"
    yield "*ORIENTATION, NAME=WARP, SYSTEM=RECTANGULAR"
    yield "AXES"
    yield "3, 0."
    yield "*DISTRIBUTION TABLE, NAME=THICKNESS_TABLE"
    yield "LENGTH"
    yield "*DISTRIBUTION, NAME=THICKNESS, LOCATION=ELEMENT, TABLE=THICKNESS_TABLE"
    yield f", {thickness:.9g}"
    for element, value in enumerate(shells.thickness, 1):
        yield f"{element}, {value:.9g}"
    yield (
        "*SHELL SECTION, ELSET=CLOTH, MATERIAL=CLOTH, ORIENTATION=WARP, SHELL THICKNESS=THICKNESS"
    )
    yield f"{thickness:.9g}, 5"


def calculix(shells, thickness):
    """CalculiX: S3 or S6, a set, an orientation and a section for each element.

    Of a *DISTRIBUTION shells take the first line, all of them. Elements whose thicknesses differ in
    a node are joined by a rigid body there, so that the thickness is that of the nodes.
    """
    kind = {3: "S3", 6: "S6"}[shells.triangles.shape[1]]
    m = len(shells.triangles)
    yield from _abaqus_mesh(
        shells, [f"*ELEMENT, TYPE={kind}, ELSET=E{element}" for element in range(1, m + 1)]
    )
    yield "*ELSET, ELSET=CLOTH"
    for element in range(1, m + 1):
        yield f"E{element}"
    yield "*NODAL THICKNESS"
    for node, value in enumerate(shells.nodal_thickness, 1):
        yield f"{node}, {value:.9g}"
    for element, axes in enumerate(shells.axes, 1):
        yield f"*ORIENTATION, NAME=O{element}, SYSTEM=RECTANGULAR"
        yield _listed(axes[:2].ravel())
        yield (
            f"*SHELL SECTION, ELSET=E{element}, MATERIAL=CLOTH, ORIENTATION=O{element}, "
            "NODAL THICKNESS"
        )
        yield f"{thickness:.9g}"


def nastran(shells, thickness):
    """Nastran and OptiStruct: CTRIA3 with THETA, or CTRIA6 with MCID; thickness at the corners.

    Where sides are curved, an angle from them is told differently by different programs; the x-axis
    of a coordinate system is projected on the element by all.
    """
    curved = shells.triangles.shape[1] == 6
    for node, point in enumerate(shells.nodes, 1):
        yield from _card("GRID", [node, None, *map(float, point)])
    yield from _card("PSHELL", [1, 1, float(thickness), 1, None, 1])
    for element, nodes in enumerate(shells.triangles + 1, 1):
        corners = 3 * [float(shells.thickness[element - 1])]
        if curved:
            warp, across, normal = shells.axes[element - 1]
            yield from _card("CORD2R", [element, 0, 0.0, 0.0, 0.0, *normal, *warp])
            yield from _card("CTRIA6", [element, 1, *nodes.tolist(), element, None, *corners])
        else:
            angle = float(shells.warp_angles[element - 1])
            end = [None, None, None, None, *corners]
            yield from _card("CTRIA3", [element, 1, *nodes.tolist(), angle, *end])


def lsdyna(shells, thickness):
    """LS-DYNA: *ELEMENT_SHELL_THICKNESS_BETA, the angle from side N1-N2, which AOPT=0 is for."""
    yield "*KEYWORD"
    yield "*NODE"
    for node, point in enumerate(shells.nodes, 1):
        yield f"{node:8d}" + "".join(f"{value:16.9g}" for value in point)
    yield "*ELEMENT_SHELL_THICKNESS_BETA"
    for element, (first, second, third) in enumerate(shells.triangles + 1, 1):
        yield "".join(f"{n:8d}" for n in (element, 1, first, second, third, third))
        values = [*4 * [shells.thickness[element - 1]], shells.warp_angles[element - 1]]
        yield "".join(f"{value:16.9g}" for value in values)
    yield "*END"


def _abaqus_mesh(shells, headings):
    """Nodes and elements, each element after its heading, if it has one."""
    yield "*NODE, NSET=CLOTH"
    for node, point in enumerate(shells.nodes, 1):
        yield f"{node}, {_listed(point)}"
    for element, (heading, nodes) in enumerate(zip(headings, shells.triangles, strict=True), 1):
        if heading:
            yield heading
        yield f"{element}, " + ", ".join(str(node + 1) for node in nodes)


def _listed(values):
    return ", ".join(f"{value:.9g}" for value in np.asarray(values) + 0.0)


def _card(name, fields):
    """A card of Nastran in fields of 16 characters, None for an empty one."""
    cells = [_cell(field) for field in fields]
    rows = [cells[i : i + 4] for i in range(0, len(cells), 4)]
    rows += [[""]] * (len(rows) % 2)  # cards of wide fields have an even number of lines
    for number, row in enumerate(rows):
        head = f"{name}*" if number == 0 else "*"
        yield (f"{head:8}" + "".join(f"{cell:>16}" for cell in row)).rstrip()


def _cell(field):
    if field is None:
        return ""
    return str(field) if isinstance(field, int) else f"{field:.8E}"
