"""Reading a saved result back: checks every file, runs nothing that is in them."""

import csv
import io
import json
from contextlib import contextmanager

import netgen.meshing
import ngsolve as ngs
import numpy as np
from netgen.occ import OCCGeometry

from .. import scenes
from ..errors import InputError, check_integer
from ..problem.scene import Scene
from .history import COLUMNS, FIRST_COLUMNS, Reason, Row
from .result import Result
from .save import (
    CHECKSUMS,
    FILES,
    FORMAT,
    VERSION,
    at_nodes,
    checked_path,
    checksum,
    fingerprint,
    hidden,
    scene_words,
)


def load(folder, scene=None):
    """Read a result that `Result.save` has written.

    No code is run and no pickle read. A scene of `ngcloth.scenes` is made again from its name and
    arguments; one of your own, charts being code, has to be given.

    Parameters
    ----------
    folder : path
        Written by `Result.save`.
    scene : Scene, optional
        The scene that was solved; needed unless it is one of `ngcloth.scenes`, unchanged.

    Returns
    -------
    Result
        Equal to the one saved, and as good for everything that a result can do.

    Raises
    ------
    InputError
        If the folder is missing, or a file in it is missing, damaged, foreign or of another
        version, which the error names; or if the scene is missing, or another one.
    """
    if scene is not None and not isinstance(scene, Scene):
        raise InputError("scene", scene, "an ngcloth.Scene")
    place = checked_path(folder)
    if not place.exists() and hidden(place, "previous").exists():
        place = hidden(place, "previous")  # a save was cut off while it put a new result there
    files = _verified(place, folder)
    with _reading(folder, "result.json"):
        record = _record(files["result.json"], folder)
        reason, settings = Reason[record["reason"]], dict(record["settings"])
        order = check_integer("order", settings["order"], 1)
        numbers = {
            "cost": float(record["cost"]),
            "newton_iterations": int(record["newton_iterations"]),
            "seconds": float(record["seconds"]),
        }
    scene = _scene(scene, record, _arrays(files, "scene.npz", folder), folder)
    fields = _arrays(files, "fields.npz", folder)
    with _reading(folder, "fields.npz"):
        _check_mesh(fields, order)
        mesh = _mesh(scene, fields, order)
        state = _state(scene, mesh, settings, fields)
    with _reading(folder, "history.csv"):
        history = _history(files["history.csv"])
    return Result(
        scene=scene, state=state, reason=reason, history=history, settings=settings, **numbers
    )


@contextmanager
def _reading(folder, name):
    """Whatever a foreign file breaks on the way becomes one kind of error, with its name."""
    try:
        yield
    except Exception as error:
        if isinstance(error, InputError) and error.argument in ("folder", "scene"):
            raise
        missing = isinstance(error, FileNotFoundError)
        told = f"is damaged or foreign ({type(error).__name__}: {error})"
        text = f"a folder that Result.save has written; {name} {'is missing' if missing else told}"
        raise InputError("folder", str(folder), text) from error


def _verified(place, folder):
    """The bytes of all files, {name: bytes}, after a look at their checksums."""
    with _reading(folder, CHECKSUMS):
        lines = (place / CHECKSUMS).read_bytes().decode("ascii").split("\n")
        sums = {name: value for value, name in (line.split("  ") for line in lines if line)}
    files = {}
    for name in FILES:
        with _reading(folder, name):
            files[name] = (place / name).read_bytes()
            if checksum(files[name]) != sums.get(name):
                raise ValueError(f"its checksum is not the one in {CHECKSUMS}")
    return files


def _record(data, folder):
    record = json.loads(data)
    if record["format"] != FORMAT:
        raise ValueError(f"it is {record['format']!r}, not {FORMAT!r}")
    if record["version"] != VERSION:
        text = f"version {VERSION} of the format; result.json has version {record['version']}"
        raise InputError("folder", str(folder), f"{text}, by {record.get('versions')}")
    return record


def _arrays(files, name, folder):
    with _reading(folder, name), np.load(io.BytesIO(files[name]), allow_pickle=False) as arrays:
        return dict(arrays)


def _scene(scene, record, expected, folder):
    """The scene that was saved: the one given, or made from its recipe, and compared."""
    if scene is not None:
        argument, value = "scene", scene.name
    else:
        argument, value = "folder", str(folder)
        with _reading(folder, "result.json"):
            recipe, name = record["scene"]["recipe"], record["scene"]["name"]
            if recipe is None:
                allowed = f"the scene {name!r} that was solved; its chart is not in the files"
                raise InputError("scene", None, allowed)
            scene = scenes.NAMED[recipe["scene"]](**recipe["arguments"])
    words, found = scene_words(scene), fingerprint(scene)
    with _reading(folder, "scene.npz"):
        differing = [key for key in words if words[key] != record["scene"][key]]
        differing += [key for key in found if not _same(found[key], expected[key])]
    if differing:
        text = f"the scene that was solved; {', '.join(differing)} differ"
        raise InputError(argument, value, text)
    return scene


def _same(values, expected):
    """Whether arrays (..., n) agree to more digits than two machines may differ in."""
    if values.shape != expected.shape:
        return False
    size = np.where(np.isfinite(expected), np.abs(expected), 0).reshape(-1, expected.shape[-1])
    columns = size.max(axis=0)
    near = np.abs(values - expected) <= 1e-9 * columns + 1e-12 * columns.max()
    return bool(np.all(near | np.isclose(values, expected, rtol=0, atol=0, equal_nan=True)))


def _check_mesh(fields, order):
    """Refuse arrays that Netgen would take without a look, and fail on."""
    vertices, triangles, segments = (fields[n] for n in ("vertices", "triangles", "segments"))
    nodes = (len(triangles), (order + 1) * (order + 2) // 2, 2)
    shapes = {"vertices": (len(vertices), 2), "triangles": (len(triangles), 3), "theta": nodes}
    shapes |= {"segments": (len(segments), 3), "psi": nodes}
    for name, shape in shapes.items():
        if fields[name].shape != shape or not np.isfinite(fields[name]).all():
            raise ValueError(f"{name} is not an array {shape} of finite numbers")
    for name, ends in {"triangles": triangles, "segments": segments[:, :2]}.items():
        if ends.dtype.kind != "i" or not np.all((ends >= 0) & (ends < len(vertices))):
            raise ValueError(f"{name} has other entries than vertices")


def _mesh(scene, fields, order):
    """The mesh of the solve: vertices, triangles and rim from the file, curves from the domain."""
    face = scene.surface.domain.face(scene.symmetric)
    mesh = netgen.meshing.Mesh(dim=2)
    mesh.SetGeometry(OCCGeometry(face, dim=2))
    mesh.AddPoints(np.array(fields["vertices"], dtype=float))
    region = mesh.AddRegion("default", dim=2)
    mesh.AddElements(dim=2, index=region, data=fields["triangles"].astype(np.int32))
    segments = fields["segments"].astype(np.int32)
    for number, edge in enumerate(face.edges, start=1):
        region = mesh.AddRegion(edge.name, dim=1)
        place = mesh.EdgeDescriptor(region)
        place.edgenr, place.domin, place.domout, place.fdindex = number, 1, 0, 1
        ends = np.ascontiguousarray(segments[segments[:, 2] == number, :2])
        mesh.AddElements(dim=1, index=region, data=ends)
    mesh = ngs.Mesh(mesh)
    mesh.Curve(order)
    return mesh


def _state(scene, mesh, settings, fields):
    """The GridFunction of ψ, and of η if there are limits, on the space that the solve used."""
    order = settings["order"]
    mirrors = ("mirror1", "mirror2") if scene.symmetric else ("", "")
    components = [ngs.H1(mesh, order=order, dirichlet=line) for line in mirrors]
    if scene.in_equilibrium:
        fixed = [f"rim|{line}" if line else "rim" for line in mirrors]
        components += [
            ngs.H1(mesh, order=settings["multiplier_order"], dirichlet=lines) for lines in fixed
        ]
    state = ngs.GridFunction(ngs.FESpace(components), name="state")
    coefficients = state.vec.FV().NumPy()
    if coefficients.shape != fields["state"].shape:
        raise ValueError("its state does not belong to the mesh and the order")
    coefficients[:] = fields["state"]
    # Coefficients mean something only in the numbering and the basis that they were written in.
    found = {"theta": ngs.CF((ngs.x, ngs.y)), "psi": ngs.CF(tuple(state.components[:2]))}
    for name, field in found.items():
        if not _same(at_nodes(field, mesh, order), fields[name]):
            raise ValueError(f"{name} at the nodes is not what mesh and state give")
    return state


def _history(data):
    rows = list(csv.reader(io.StringIO(data.decode("utf-8"), newline="")))
    if tuple(rows[0]) not in (COLUMNS, FIRST_COLUMNS):
        raise ValueError(f"its columns are not {', '.join(COLUMNS)}")
    types = [Row.__dataclass_fields__[name].type for name in rows[0]]
    return [Row(*(kind(text) for kind, text in zip(types, row, strict=True))) for row in rows[1:]]
