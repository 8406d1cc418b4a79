"""The threads of a `Result` element by element: a table, or shells of a structural solver."""

import io
from pathlib import Path

import numpy as np

from ..errors import InputError, check_integer, check_number
from . import solver_files
from .files import checked_file, write_file
from .shells import CENTROID, shells

FORMATS = {
    "csv": (".csv",),
    "abaqus": (".inp",),
    "calculix": (".inp",),
    "nastran": (".bdf", ".nas", ".dat", ".fem"),
    "lsdyna": (".k", ".key"),
}
COMMENTS = {"abaqus": "** ", "calculix": "** ", "nastran": "$ ", "lsdyna": "$ "}
THICKNESSES = 1e-9, 1.0  # over the size of the patch
HIGHEST = {"lsdyna": 1}  # order of the triangles; 2 elsewhere


def fibres(result, path, format=None, *, thickness=None, order=None):
    """Write the thread directions of every element, as a table or for a structural solver.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    path : path
        Its ending says the format, where `format` does not: ".csv"; ".bdf", ".nas", ".dat" and
        ".fem" for Nastran; ".k" and ".key" for LS-DYNA. ".inp" needs `format`.
    format : {"csv", "abaqus", "calculix", "nastran", "lsdyna"}, optional
        "nastran" is for OptiStruct as well.
    thickness : float, optional
        Of the flat cloth, in units of length, from 1e-9 of the patch's size to that; needed for
        solvers. On the surface that of incompressible cloth is written, t0/(areal stretch).
    order : {1, 2}, optional
        Of the triangles for a solver: three nodes, or six with the middles of the sides on the
        surface. By default 2, and 1 for LS-DYNA, which has no other.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        If the path has another ending or names a folder, or its folder does not exist; if there is
        no such format, or the ending is that of several; if thickness or order are missing, out of
        range, or given for a table, which has neither; if the patch is folded, which a table shows.
    OSError
        If a file cannot be written, which leaves that file as it was.

    Notes
    -----
    A table has one row for each element and mirror image, in the order of the cells of `vtu`: its
    number, the point x, y, z of the surface at its centroid (units of length), and there the unit
    vectors along warp and weft, both stretches, the angle between the threads and the shear angle
    in degrees, and the thickness over that of the flat cloth.

    For solvers, these elements are shells, in the same order from number 1; neighbours share their
    nodes. The first material axis is the warp at the centroid, projected on the element, the third
    the side of the cloth. See docs/to_a_structural_solver.md for what each program makes of it.
    """
    file, format = _checked(path, format)
    if format == "csv":
        for name, value in (("thickness", thickness), ("order", order)):
            if value is not None:
                raise InputError(name, value, "None for a table, which has no shells")
        write_file(file, _table(result))
        return file
    highest = HIGHEST.get(format, 2)
    order = check_integer("order", highest if order is None else order, 1, highest)
    if thickness is None:
        raise InputError("thickness", thickness, "a length > 0, of the flat cloth")
    low, high = (float(share * np.sqrt(result.area)) for share in THICKNESSES)
    thickness = check_number("thickness", thickness, low, high)
    if not result.unfolded:
        allowed = "a patch that is not folded: where it is, shells would have a thickness below 0"
        raise InputError("result", result.scene.name, allowed)
    written = shells(result, order, thickness)
    text = "\n".join(
        [
            *(COMMENTS[format] + line for line in _told(result, thickness)),
            *getattr(solver_files, format)(written, thickness),
            "",
        ]
    )
    write_file(file, text.encode("ascii", "replace"))
    return file


def _checked(path, format):
    """The file to write and its format, by name or ending."""
    if format is not None:
        if not isinstance(format, str) or format not in FORMATS:
            raise InputError("format", format, "one of " + ", ".join(FORMATS))
        return checked_file(path, *FORMATS[format]), format
    file = checked_file(path, *dict.fromkeys(sum(FORMATS.values(), ())))
    fitting = [name for name, endings in FORMATS.items() if file.suffix.lower() in endings]
    if len(fitting) > 1:
        raise InputError("format", format, f"one of {', '.join(fitting)} for {Path(path).name}")
    return file, fitting[0]


def _told(result, thickness):
    """What the head of a file says of it."""
    state = "converged" if result.converged else f"NOT CONVERGED: {result.reason}"
    return [
        f"ngcloth: {state}, {result.scene.name}",
        f"flat cloth {thickness:.9g} thick; material axis 1 is the warp",
    ]


def _table(result):
    from .fields import element_fields

    fields = {name: v[:, 0] for name, v in element_fields(result, [CENTROID]).items()}
    columns = ["position", "warp", "weft", "stretch1", "stretch2"]
    rows = np.column_stack(
        [
            np.arange(len(fields["angle"])),
            *(fields[name] for name in columns),
            90 - fields["angle"],
            fields["angle"],
            fields["thickness"],
        ]
    )
    header = (
        "element,x,y,z,warp_x,warp_y,warp_z,weft_x,weft_y,weft_z,stretch1,stretch2,angle_deg,"
        "shear_angle_deg,thickness"
    )
    table = io.StringIO()
    np.savetxt(table, rows, ["%d"] + ["%.12g"] * 14, ",", header=header, comments="")
    return table.getvalue().encode()
