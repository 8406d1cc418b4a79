"""Files of a `Result` for other programs: fields for ParaView, threads, surfaces, fibres."""

import ngsolve as ngs
import numpy as np

from ..errors import check_number
from ..geometry.mirrors import SIGNS
from ..geometry.sheet import mesh_points
from ..problem.domain import MirroredDomain
from ..problem.fabric import directions
from ..problem.kinematics import Kinematics, gradient
from .fibres import fibres as fibres
from .files import checked_file, write_file
from .formats import obj, stl, xml
from .plot import check_right_angles, default_pitch, sample, thread_levels
from .tessellation import tessellation

# A limit counts as active where its slack is below this share of its greatest value. The barrier
# keeps slacks off zero: at 1 % the belts in which limits are active fall to pieces, at 5 % not.
ACTIVE = 5e-2
SETTLED = 1e-12  # of the patch, off their thread
FINE = 2e-4  # of the size: how near triangles of `surface` are to it, by default


def vtu(result, path):
    """Write the cloth with its fields for ParaView: on the surface, and flat.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    path : path
        Ends in ".vtu"; the flat patch goes beside it, "cloth.vtu" and "cloth_flat.vtu".

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    InputError
        If the path has another ending or names a folder, or its folder does not exist.
    OSError
        If a file cannot be written, which leaves that file as it was.

    Notes
    -----
    Cells are Lagrange triangles of the order of ψ, 2 at least: one for each element and mirror
    image, numbered by the cell array "element". The flat ones are exact; those on the surface
    interpolate it. ParaView draws them curved from a "Nonlinear Subdivision Level" of 2 on.
    Fields jump between elements, and so each cell has points of its own. Cells of the surface
    face the side of the cloth, `Surface.normal`; flat cells face upwards, so that where ``side``
    is -1 the flat patch shows the face that lies on the surface.

    Both files have the point data of `element_fields`, and the field data "converged", 0 or 1.
    """
    import pyvista as pv

    files = _files(path, ".vtu")
    nodes, swapped = _lagrange_nodes(max(result.settings["order"], 2))
    fields = element_fields(result, nodes)
    n, m = fields["psi"].shape[:2]
    cells = np.arange(n * m).reshape(n, m)
    sides = fields["theta"][:, 1:3] - fields["theta"][:, :1]
    orientation = np.sign(np.linalg.det(sides))  # mirror images turn their element over
    for file, place, side in zip(files, ("position", "psi"), (result.sheet.side, 1), strict=True):
        facing = np.where(side * orientation[:, None] > 0, cells, cells[:, swapped])
        faces = np.column_stack([np.full(n, m), facing])
        types = np.full(n, pv.CellType.LAGRANGE_TRIANGLE)
        grid = pv.UnstructuredGrid(faces.ravel(), types, fields[place].reshape(-1, 3))
        for name, values in fields.items():
            grid.point_data[name] = values.reshape(n * m, *values.shape[2:])
        grid.cell_data["element"] = np.arange(n)
        grid.field_data["converged"] = [int(result.converged)]
        write_file(file, xml(grid))
    return files


def threads(result, path, pitch=None):
    """Write threads as polylines of a VTK file: on the surface, and flat.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    path : path
        Ends in ".vtp"; the flat threads go beside it, "threads.vtp" and "threads_flat.vtp".
    pitch : float, optional
        Distance between neighbours on the flat patch, in units of length, at least a thousandth
        of the patch; by default about a twentieth of its width. Warp threads are the lines
        X2 = const, weft threads X1 = const, at the multiples of `pitch`.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    InputError
        If the path has another ending or names a folder, or its folder does not exist; if the
        pitch is not a length > 0 that has threads on the patch, or has too many.
    OSError
        If a file cannot be written, which leaves that file as it was.

    Notes
    -----
    The points lie on the surface, and on their thread to rounding, its ends to about 1e-6
    (1e-5 on surfaces from files). A thread runs in the direction of growing X1 or X2, to within
    1e-4 of the domain's size from the rim; the domain of a chart has to be star-shaped. Cell data:
    "weft", 0 or 1, and "level", the constant X2 or X1. Point data: "psi" and "position".
    """
    import pyvista as pv

    files = _files(path, ".vtp")
    if pitch is None:
        pitch = default_pitch(result.outline())
    check_number("pitch", pitch, 0, open_low=True)
    lines = thread_lines(result, pitch)
    theta = np.concatenate([line for _, _, line in lines])
    lengths = np.array([len(line) for _, _, line in lines])
    first = np.cumsum(lengths) - lengths
    cells = [np.r_[n, i : i + n] for i, n in zip(first, lengths, strict=True)]
    places = {
        "position": result.evaluate(result.whole.position, theta),
        "psi": _in_space(result.psi(*theta.T)),
    }
    for file, points in zip(files, places.values(), strict=True):
        mesh = pv.PolyData(points, lines=np.concatenate(cells))
        mesh.cell_data["weft"] = np.array([family for family, _, _ in lines])
        mesh.cell_data["level"] = np.array([level for _, level, _ in lines])
        mesh.point_data.update(places)
        write_file(file, xml(mesh))
    return files


def surface(result, path, tolerance=None):
    """Write the surface and the flat patch as triangles, STL or OBJ.

    Parameters
    ----------
    result : Result
        Solved or loaded.
    path : path
        Ends in ".stl" or ".obj"; the patch goes beside it, "dome.obj" and "dome_flat.obj".
    tolerance : float, optional
        How far sides of triangles may be from the surface, and on the patch from where they are,
        in units of length; by default 2e-4 of the diagonal of a box around the surface.

    Returns
    -------
    tuple of Path
        The two files.

    Raises
    ------
    InputError
        If the path has another ending or names a folder, or its folder does not exist; if the
        tolerance is not between a millionth and a tenth of the size.
    OSError
        If a file cannot be written, which leaves that file as it was.

    Notes
    -----
    The points lie on the surface, more of them where it or the net is curved; the domain of a
    chart has to be star-shaped. On surfaces from files they include the corners of the mesh.
    Triangles of the surface face the side of the cloth, those of the patch upwards.

    In OBJ files the texture coordinates UV of a point are its flat position, in units of length.
    Where `Surface.side` is -1, as on a sphere, the patch is drawn from its inner face: seen from
    outside, UV are left-handed, and writing in a texture would be mirrored.
    """
    files = _files(path, ".stl", ".obj")
    written = stl if files[0].suffix.lower() == ".stl" else obj
    size = _size(result)
    if tolerance is None:
        tolerance = FINE * size
    check_number("tolerance", tolerance, 1e-6 * size, 0.1 * size)
    theta, triangles = tessellation(result, tolerance)
    psi = result.psi(*theta.T)
    places = (result.evaluate(result.whole.position, theta), _in_space(psi))
    for file, points, side in zip(files, places, (result.sheet.side, 1), strict=True):
        write_file(file, written(points, triangles[:, ::side], psi))
    return files


def element_fields(result, points):
    """All fields at the same points of every element, mirror images of elements included.

    Parameters
    ----------
    result : Result
        Its fields are evaluated in each element of its mesh.
    points : array_like, (m, 2)
        Points of the reference triangle (0, 0), (1, 0), (0, 1).

    Returns
    -------
    dict of ndarray, (n, m) or (n, m, components), for n elements
        "theta": parameter point, 2 components. "psi" and "position": the point on the flat patch,
        its third component 0, and on the surface. "warp" and "weft": unit vectors along the
        threads of the first two families, tangent to the surface. "stretch1", "stretch2", "shear",
        "reaction", "jacobian", "angle", "thickness": as `Result.field` gives them, τ in units of
        force per flat area, the shear angle in degrees. ``"active_…"``, 0 or 1: whether the limit
        of that name is active, which means a slack below 5 % of its greatest value here; the slacks
        of a limit that has several are numbered, as in "active_elongation_1" for the warp.
    """
    scene, sheet = result.scene, result.sheet
    mesh, flat = result.state.space.mesh, result.state.components[:2]
    tensors = sheet.metric, scene.fabric, lambda: sheet.curvature
    cloth = Kinematics(gradient(*flat), *tensors, flat)
    rule = ngs.IntegrationRule([tuple(point) for point in points], [0.0] * len(points))
    mapped = mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)
    signs = SIGNS[: scene.copies, None, None, :]

    def at(expression):
        values = np.asarray(expression.Compile()(mapped))
        return values.reshape(mesh.ne, len(points), *expression.dims)

    def joined(values):
        return np.concatenate(np.broadcast_to(values, (scene.copies, *values.shape[-2:])))

    def on_surface(expression):
        # At edges between triangles, those of a file's surface have two values.
        if isinstance(result.domain, MirroredDomain):
            values = np.asarray(expression(_in_images(result, points)))
            return values.reshape(*theta.shape[:2], *expression.dims)
        return at(expression) if scene.copies == 1 else result.evaluate(expression, theta)

    centre = result.domain.centre
    theta = np.concatenate(centre + signs * (at(ngs.CF((ngs.x, ngs.y))) - centre))
    psi = np.concatenate(signs * at(ngs.CF(tuple(flat))))
    slopes = np.concatenate(signs[..., :, None] * signs[..., None, :] * at(cloth.gradient))
    tangents = on_surface(ngs.CF(result.whole.tangents, dims=(2, 3)))
    lines = directions(scene.fabric)
    threads = lines[:2] @ np.swapaxes(np.linalg.inv(slopes), -1, -2) @ tangents
    stretches = np.linalg.norm(threads, axis=-1)
    warp, weft = np.moveaxis(threads / stretches[..., None], -2, 0)
    shear = np.einsum("...i,...i->...", warp, weft)
    fields = {
        "theta": theta,
        "psi": _in_space(psi),
        "position": on_surface(result.whole.position),
        "warp": warp,
        "weft": weft,
        "stretch1": stretches[..., 0],
        "stretch2": stretches[..., 1],
        "shear": shear,
        "angle": np.degrees(np.arctan2(shear, np.linalg.norm(np.cross(warp, weft), axis=-1))),
        "thickness": joined(at(cloth.thickness)),
        "reaction": joined(at(cloth.reaction)),
        "jacobian": np.linalg.det(slopes),
    }
    for limit in scene.constraints:
        slacks = limit.slacks(cloth)
        for k, slack in enumerate(map(at, slacks), 1):
            name = f"active {limit.name}" + (f" {k}" if len(slacks) > 1 else "")
            active = slack < ACTIVE * slack.max()
            fields[name.replace(" ", "_")] = joined(active.astype(np.uint8))
    return fields


def _in_images(result, points):
    """Points of `Result.whole` at the same points (m, 2) of every element, image after image."""
    mesh, points = result.whole.mesh, np.asarray(points, dtype=float)
    turned = np.repeat(SIGNS.prod(axis=1) < 0, mesh.ne // len(SIGNS))
    reference = np.where(turned[:, None, None], points[:, ::-1], points)
    return mesh_points(mesh, np.repeat(np.arange(mesh.ne), len(points)), reference.reshape(-1, 2))


def thread_lines(result, pitch):
    """The threads at the multiples of `pitch`, as lines of parameter points.

    Parameters
    ----------
    result : Result
        Its threads are traced on all of the cloth, mirror images included.
    pitch : float
        As for `threads`.

    Returns
    -------
    list of (weft, level, theta)
        ``weft`` is 0 for a warp thread X2 = level and 1 for a weft thread X1 = level; ``theta``,
        (n, 2), runs along it. A thread that leaves the patch and comes back is several lines.
    """
    from matplotlib.figure import Figure

    check_right_angles(result)
    theta, triangles = sample(result)
    psi = result.psi(*theta.T)
    levels = [thread_levels(psi[:, 1 - weft], pitch) for weft in (0, 1)]
    axes = Figure().subplots()
    found = []
    for weft in (0, 1):
        contours = axes.tricontour(*theta.T, triangles, psi[:, 1 - weft], levels=levels[weft])
        for level, pieces in zip(levels[weft], contours.allsegs, strict=True):
            # The side of larger values is on the left of a contour.
            found += [(weft, level, piece[::-1] if weft else piece) for piece in pieces]
    lengths = [len(line) for _, _, line in found]
    weft, level = (np.repeat([line[i] for line in found], lengths) for i in (0, 1))
    exact = _onto_threads(result, weft, level, np.concatenate([line for _, _, line in found]))
    pieces = np.split(exact, np.cumsum(lengths)[:-1])
    return [(*line[:2], _apart(piece)) for line, piece in zip(found, pieces, strict=True)]


def _onto_threads(result, weft, level, theta, steps=10):
    """Points of the domain beside their threads, (n, 2), moved onto them by Newton's method.

    Points are near already: the slopes are those at the start, and most need two steps. To find a
    point in the mesh is what takes time.
    """
    domain, component = result.domain, 1 - weft
    low, high = np.array(domain.box).T
    theta, moving = theta.copy(), np.arange(len(theta))
    slope = result.slopes(theta)[moving, component]
    step = slope / (slope**2).sum(axis=1, keepdims=True)
    settled = SETTLED * np.ptp(level)
    for _ in range(steps):
        at = theta[moving]
        excess = result.psi(*at.T)[np.arange(len(at)), component[moving]] - level[moving]
        moved = np.clip(at - excess[:, None] * step[moving], low, high)
        going = (np.abs(excess) > settled) & domain.contains(moved)
        moving = moving[going]
        theta[moving] = moved[going]
        if not moving.size:
            break
    return theta


def _apart(line):
    """A line without the points that repeat the one before."""
    steps = np.linalg.norm(np.diff(line, axis=0), axis=1)
    return line[np.r_[True, steps > 1e-9 * steps.sum()]]


def _lagrange_nodes(order):
    """Where VTK has the points of a Lagrange triangle, (m, 2), and their order seen from behind."""
    from vtkmodules.vtkCommonDataModel import vtkLagrangeTriangle

    indices = np.zeros(((order + 1) * (order + 2) // 2, 3), dtype=int)
    for i, index in enumerate(indices):
        barycentric = [0, 0, 0]
        vtkLagrangeTriangle.BarycentricIndex(i, barycentric, order)
        index[:] = barycentric
    behind = [vtkLagrangeTriangle.Index((j, i, k), order) for i, j, k in indices.tolist()]
    return indices[:, :2] / order, behind


def _size(result):
    """The diagonal of a box around the surface."""
    theta, _ = sample(result, 12)
    return float(np.linalg.norm(np.ptp(result.evaluate(result.whole.position, theta), axis=0)))


def _in_space(flat):
    """Points of the plane, (..., 2), as points of space with third component 0."""
    return np.concatenate([flat, np.zeros_like(flat[..., :1])], axis=-1)


def _files(path, *endings):
    """The checked path, and its sibling for the flat patch."""
    path = checked_file(path, *endings)
    return path, checked_file(path.with_stem(path.stem + "_flat"))
