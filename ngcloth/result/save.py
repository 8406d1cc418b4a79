"""Writing a result: one folder of open formats, there as a whole or not at all."""

import csv
import hashlib
import io
import json
import os
import platform
import shutil
from contextlib import contextmanager, suppress
from dataclasses import astuple
from pathlib import Path

import ngsolve as ngs
import numpy as np

from ..errors import InputError
from ..geometry.file_surface import FileSurface
from ..problem.bars import written
from ..problem.kinematics import Kinematics
from .history import COLUMNS
from .reading import is_plain

try:
    import fcntl
except ImportError:  # not on Windows
    fcntl = None

FORMAT, VERSION = "ngcloth result", 1
FILES = ("result.json", "history.csv", "scene.npz", "fields.npz")
CHECKSUMS = "SHA256SUMS"
SURFACE = "surface_"  # before the names of arrays of a surface
LIMIT = "limit_"  # and of `Result.limit_points`
# A flat strain on top of a scene's start, so that its fingerprint feels every stiffness.
SHEARED = ((1.0, 0.2), (-0.1, 1.05))


def save(result, folder):
    """Write a result to a folder.

    ============  ==================================================================================
    result.json   scene in words and as recipe, reason, numbers, settings, versions
    history.csv   one line per accepted step, the columns of `Row`
    fields.npz    θ (``theta``), ψ (``psi``) and, in scenes with constraints, v (``eta``) at the
                  nodes (i/p, j/p), i + j ≤ p, j fastest, of every triangle, p the order of ψ, each
                  (triangles, nodes, 2); all coefficients (``state``); and the mesh of the domain or
                  its quarter: ``vertices`` (n, 2), ``triangles`` (k, 3) by vertex, ``segments``
                  (m, 3) by two vertices and the edge of the domain, from 1, on which they lie; of
                  a surface from a file, its points in space at the nodes of each triangle, of the
                  order of ψ and of a higher one (``nodes2``, ``nodes4``); in scenes with limits
                  `Result.limit_points` (``limit_triangles``, ``limit_reference``)
    scene.npz     what the scene is at points of its domain; see `fingerprint`; and the surface, if
                  it came from a file (``surface_…``)
    SHA256SUMS    checksums of the above, as ``sha256sum -c`` reads them
    ============  ==================================================================================

    Parameters
    ----------
    result : Result
        Converged or not.
    folder : path
        Made with its parents. An empty folder, or one that holds nothing but a saved result, is
        replaced; at any moment the old result or the new one is there, whole, for `load`. Of
        several processes that save to one folder, the last one's result stays.

    Raises
    ------
    InputError
        If `folder` is something else, or cannot be written: what was there is there still.
    """
    target, files = checked_path(folder), contents(result)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with _workshop(hidden(target, "new")) as workshop:
            _put(files, target, workshop / "result", folder)
    except OSError as error:
        raise InputError("folder", str(folder), f"a place to write to ({error})") from error


def contents(result):
    """What `save` writes, {name: bytes}, the checksums last."""
    files = {
        "result.json": json.dumps(_record(result), indent=2, ensure_ascii=False, default=_plain),
        "history.csv": _table(result.history),
        "scene.npz": _packed(**fingerprint(result.scene), **_surface(result.scene)),
        "fields.npz": _packed(**_fields(result)),
    }
    files = {n: each.encode() if isinstance(each, str) else each for n, each in files.items()}
    lines = [f"{checksum(files[name])}  {name}\n" for name in FILES]
    return files | {CHECKSUMS: "".join(lines).encode()}


@contextmanager
def _workshop(folder):
    """An empty folder that one save at a time has, and that is gone after it."""
    handle = None
    while handle is None:
        with suppress(FileExistsError):
            os.mkdir(folder)
        if not fcntl:
            break
        handle = _locked(folder)
    try:
        shutil.rmtree(folder / "result", ignore_errors=True)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        if fcntl:
            os.close(handle)


def _locked(folder):
    """A handle of the folder, locked until it is closed; None if the folder is gone meanwhile."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except FileNotFoundError:  # another save's, which has just ended
        return None
    with suppress(FileNotFoundError):
        fcntl.flock(handle, fcntl.LOCK_EX)  # the system ends it with the process
        if os.path.samestat(os.fstat(handle), os.lstat(folder)):
            return handle
    os.close(handle)
    return None


def _put(files, target, new, folder):
    """Write files to the folder `new`, and put it in the place of `target`."""
    if target.exists():
        _check_replaceable(target, folder)
    previous = hidden(target, "previous")
    new.mkdir()
    for name, data in files.items():
        (new / name).write_bytes(data)
    if target.exists():
        shutil.rmtree(previous, ignore_errors=True)
        os.rename(target, previous)
    # Between these two lines `load` falls back on `previous`.
    os.rename(new, target)
    shutil.rmtree(previous, ignore_errors=True)


def fingerprint(scene):
    """What a scene is, as numbers at points of its domain: the same only for the same scene.

    Returns
    -------
    dict of ndarray
        "theta" (n, 2), the points; "position" (n, 3), φ; "start" (n, 2), ψ of the start; "cloth"
        (n, ...), energy density, reaction and all slacks of the start, sheared; in scenes with
        one, "cost" (n,) of the same, which files written before it was kept do not have, and
        "warp" (2, 3), the direction of the warp and where it is held. For a
        surface from a file, "surface" (1, 9) in place of "position": corners of its box, area,
        length of sharp edges and least radius; the rest is of a cap of its size.
    """
    surface = scene.tried_on
    theta, place = surface.domain.sample(4), scene.start_expression()
    start = ngs.CF(place)
    start_gradient = ngs.CF(
        tuple(component.Diff(t) for component in (start[0], start[1]) for t in (ngs.x, ngs.y)),
        dims=(2, 2),
    )
    sheared = ngs.CF(SHEARED, dims=(2, 2)) * start_gradient
    tensors = surface.metric, scene.fabric, lambda: surface.curvature
    cloth = Kinematics(sheared, *tensors, place)
    felt = [cloth.energy, cloth.reaction]
    felt += [slack for limit in scene.constraints for slack in limit.slacks(cloth)]
    expressions = {"position": surface.position, "start": start, "cloth": ngs.CF(tuple(felt))}
    if scene.cost is not None:
        expressions["cost"] = scene.cost(cloth)
    values = {name: surface.evaluate(each, theta) for name, each in expressions.items()}
    if scene.warp is not None:
        values["warp"] = np.array([scene.warp, scene.at])
    if isinstance(scene.surface, FileSurface):
        file = scene.surface
        numbers = [*file.box.ravel(), file.area, file.sharp, file.least_radius]
        del values["position"]
        values["surface"] = np.array([numbers])
    return {"theta": theta} | values


def _surface(scene):
    """The arrays of a surface from a file."""
    if not isinstance(scene.surface, FileSurface):
        return {}
    return {f"{SURFACE}{name}": array for name, array in scene.surface.arrays().items()}


def scene_words(scene):
    """What a scene is, in words and plain values."""
    return {
        "name": scene.name,
        "symmetric": scene.symmetric,
        "tie_break": float(scene.tie_break),
        "stiffness": float(scene.fabric.stiffness),
        "constraints": [limit.name for limit in scene.constraints],
    }


def at_nodes(expression, mesh, order):
    """Values of a vector expression at the nodes of every triangle, (triangles, nodes, dim)."""
    nodes = [(i / order, j / order) for i in range(order + 1) for j in range(order + 1 - i)]
    rule = ngs.IntegrationRule(nodes, [0.0] * len(nodes))
    values = np.asarray(expression(mesh.MapToAllElements({ngs.ET.TRIG: rule}, ngs.VOL)))
    return values.reshape(mesh.ne, len(nodes), expression.dim)


def checked_path(folder):
    """`folder` as an absolute `Path`."""
    allowed = "the path of a folder"
    if not isinstance(folder, str | os.PathLike) or not str(folder):
        raise InputError("folder", folder, allowed)
    try:
        return Path(folder).expanduser().resolve()
    except (TypeError, ValueError, OSError, RuntimeError) as error:
        raise InputError("folder", folder, f"{allowed} ({error})") from None


def hidden(target, role):
    """The folder beside `target` in which a save keeps what is not, or no longer, the result."""
    return target.with_name(f".{target.name}.ngcloth-{role}")


def checksum(data):
    """SHA-256 of bytes, as text."""
    return hashlib.sha256(data).hexdigest()


def _check_replaceable(target, folder):
    """Refuse whatever holds, or might hold, a file that `save` has not written."""
    allowed = "a new or empty folder, or one that holds a saved result and nothing else"
    if not target.is_dir():
        raise InputError("folder", str(folder), allowed)
    here = sorted(target.iterdir())
    others = [path for path in here if path.name not in (*FILES, CHECKSUMS) or not is_plain(path)]
    if others or (here and target / CHECKSUMS not in here):
        raise InputError("folder", str(folder), f"{allowed}; here is {(others or here)[0].name}")


def _table(history):
    text = io.StringIO(newline="")
    rows = csv.writer(text)
    rows.writerow(COLUMNS)
    rows.writerows(astuple(row) for row in history)
    return text.getvalue()


def _packed(**arrays):
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def _fields(result):
    mesh, order = result.state.space.mesh, result.settings["order"]
    names = {"psi": slice(0, 2), "eta": slice(2, 4)}
    fields = {"theta": ngs.CF((ngs.x, ngs.y))} | {
        name: ngs.CF(tuple(result.state.components[part]))
        for name, part in names.items()
        if result.state.components[part]
    }
    nodes = {name: at_nodes(field, mesh, order) for name, field in fields.items()}
    nodes |= {f"nodes{order}": points for order, points in result.sheet.nodes.items()}
    if result.scene.constraints:
        points = result.limit_points._asdict()
        nodes |= {f"{LIMIT}{name}": array for name, array in points.items()}
    return {"state": result.state.vec.FV().NumPy()} | nodes | _triangulation(mesh.ngmesh)


def _triangulation(mesh):
    triangles, segments = mesh.Elements2D().NumPy(), mesh.Elements1D().NumPy()
    edges = np.array([region.edgenr for region in mesh.EdgeDescriptors()])
    ends, edge = segments["nodes"][:, :2] - 1, edges[segments["index"] - 1]
    return {
        "vertices": mesh.Coordinates(),
        "triangles": triangles["nodes"][:, :3] - 1,
        "segments": np.column_stack([ends, edge]),
    }


def _record(result):
    from ..version import __version__

    versions = {
        "ngcloth": __version__,
        "ngsolve": ngs.__version__,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }
    return {
        "format": FORMAT,
        "version": VERSION,
        "scene": scene_words(result.scene)
        | {"in words": str(result.scene), "recipe": result.scene.recipe},
        "reason": result.reason.name,
        "reason in words": str(result.reason),
        "cost": result.cost,
        "newton_iterations": result.newton_iterations,
        "seconds": result.seconds,
        "settings": result.settings,
        "error": written(result.error),
        "summary": {
            "converged": result.converged,
            "energy": result.energy,
            "normalized_energy": result.normalized_energy,
            "area": result.area,
            "extrema": result.extrema,
        },
        "versions": versions,
    }


def _plain(number):
    """A NumPy number as one that JSON knows."""
    if isinstance(number, np.generic):
        return number.item()
    raise TypeError(f"{number!r} has no place in a JSON file")
