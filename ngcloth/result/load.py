"""Reading a saved result back: checks every file, runs nothing that is in them."""

import csv
import io
import json
from contextlib import contextmanager
from math import isfinite

import ngsolve as ngs
import numpy as np

from .. import scenes
from ..errors import InputError, check_integer, check_number
from ..geometry.sheet import mesh_points
from ..problem.bars import UNKNOWN, read
from ..problem.kinematics import Kinematics, gradient
from ..problem.scene import Scene
from .alone import alone
from .history import COLUMNS, FIRST_COLUMNS, Reason, Row
from .reading import plain_arrays, plain_bytes
from .result import Result
from .save import (
    CHECKSUMS,
    FILES,
    FORMAT,
    SURFACE,
    VERSION,
    checked_path,
    checksum,
    fingerprint,
    hidden,
    scene_words,
)
from .saved_fields import ROUNDING, check_fields, limit_points, same, saved_sheet, saved_state

# The most bytes of each file, and of its arrays once unpacked. A million triangles of order 2 fit.
LARGEST = {CHECKSUMS: 2**10, "result.json": 2**20, "history.csv": 2**26}
LARGEST |= {"scene.npz": 2**26, "fields.npz": 2**28}
# NGSolve takes seconds for a mesh of order 100, and a tenth for a rule of degree 1000.
HIGHEST_ORDER, HIGHEST_DEGREE = 100, 1000
NO_STRAIN = 1e-18  # of the square of a strain of rounding


@alone
def load(folder, scene=None):
    """Read a result that `Result.save` has written.

    No code is run and no pickle read; cost, energy, area and whether limits hold are compared with
    what ψ gives. Ask `Result.certificate` whether ψ is a minimum, if the files are not your own.
    What is promised for files of strangers is in docs/security.md. A scene of `ngcloth.scenes` is
    made again from its name and arguments; one of your own, charts being code, has to be given.

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
    return restored(_found(folder), scene, folder)


def restored(files, scene=None, folder="pickle"):
    """The result in the `files` of `save.contents`, which errors call `folder`."""
    with _reading(folder, "result.json"):
        record = _record(files["result.json"], folder)
        reason, settings = Reason[record["reason"]], dict(record["settings"])
        numbers = {
            "cost": float(record["cost"]),
            "newton_iterations": int(record["newton_iterations"]),
            "seconds": float(record["seconds"]),
            "error": read(record.get("error", UNKNOWN)),  # none in files of before
        }
    with _reading(folder, "scene.npz"):
        expected = plain_arrays(files["scene.npz"], LARGEST["scene.npz"])
    scene = _scene(scene, record, expected, folder)
    with _reading(folder, "result.json"):
        _check_settings(settings, scene)
    with _reading(folder, "fields.npz"):
        fields = plain_arrays(files["fields.npz"], LARGEST["fields.npz"])
        points = limit_points(fields)
        check_fields(fields, settings, scene)
        points.check(len(fields["triangles"]))
        sheet = saved_sheet(scene, fields, settings["order"])
        state = saved_state(scene, sheet.mesh, settings, fields)
    with _reading(folder, "history.csv"):
        history = _history(files["history.csv"])
    result = Result(
        scene=scene,
        state=state,
        reason=reason,
        history=history,
        settings=settings,
        sheet=sheet,
        limit_points=points,
        **numbers,
    )
    with _reading(folder, "result.json"):
        _check_against_psi(result, record.get("summary", {}))
    return result


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


def _found(folder):
    """The files of a folder, read again where a save replaces it meanwhile."""
    while True:
        with _reading(folder, CHECKSUMS):
            place, before = _place(folder)
        try:
            return _verified(place, folder)
        except InputError:
            with _reading(folder, CHECKSUMS):
                if _place(folder) == (place, before):
                    raise


def _place(folder):
    """Where the files are, and what tells the place from one that a save has put there since."""
    place = checked_path(folder)
    if not place.exists() and hidden(place, "previous").exists():
        place = hidden(place, "previous")  # a save was cut off while it put a new result there
    status = place.stat()
    return place, (status.st_ino, status.st_ctime_ns)


def _verified(place, folder):
    """The bytes of all files, {name: bytes}, after a look at their checksums."""
    with _reading(folder, CHECKSUMS):
        lines = plain_bytes(place / CHECKSUMS, LARGEST[CHECKSUMS]).decode("ascii").split("\n")
        sums = {name: value for value, name in (line.split("  ") for line in lines if line)}
    files = {}
    for name in FILES:
        with _reading(folder, name):
            files[name] = plain_bytes(place / name, LARGEST[name])
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


def _scene(scene, record, expected, folder):
    """The scene that was saved: the one given, or made from its recipe, and compared."""
    if scene is not None:
        argument, value = "scene", scene.name
    else:
        argument, value = "folder", str(folder)
        with _reading(folder, "result.json"):
            recipe, name = record["scene"]["recipe"], record["scene"]["name"]
            if recipe is None:
                allowed = f"the scene {name!r} that was solved; its functions are not in the files"
                raise InputError("scene", None, allowed)
            if recipe["scene"] == "part":
                with _reading(folder, "scene.npz"):
                    surface = _surface(expected)
                scene = scenes.part(surface, **recipe["arguments"])
            else:
                scene = scenes.NAMED[recipe["scene"]](**recipe["arguments"])
    expected = {name: each for name, each in expected.items() if not name.startswith(SURFACE)}
    words, found = scene_words(scene), fingerprint(scene)
    with _reading(folder, "scene.npz"):
        if "cost" not in expected:  # written before it was kept; the cost of ψ is compared anyhow
            found.pop("cost", None)
        if expected.keys() - {"cost", "warp"} != found.keys() - {"cost", "warp"}:
            raise ValueError(f"it has other arrays than {', '.join(found)}")
        differing = [key for key in words if words[key] != record["scene"][key]]
        keys = sorted(expected.keys() | found)
        differing += [key for key in keys if not same(found.get(key), expected.get(key))]
    if differing:
        text = f"the scene that was solved; {', '.join(differing)} differ"
        raise InputError(argument, value, text)
    return scene


def _surface(expected):
    """The surface from a file whose arrays are among those of scene.npz."""
    from ..geometry.cad import CadSurface
    from ..geometry.facets import FacetSurface

    arrays = {name.removeprefix(SURFACE): each for name, each in expected.items()}
    return (CadSurface if "brep" in arrays else FacetSurface).of_arrays(arrays)


def _check_settings(settings, scene):
    """Refuse settings that a result cannot do without, or would not end with."""
    order = check_integer("order", settings["order"], 1)
    degree = check_integer("quadrature", settings["quadrature"], 2 * order - 2)
    if order > HIGHEST_ORDER or degree > HIGHEST_DEGREE:
        raise ValueError(f"its order is above {HIGHEST_ORDER}, or quadrature {HIGHEST_DEGREE}")
    if scene.in_equilibrium and check_integer("", settings["multiplier_order"], 1) > order:
        raise ValueError("its multiplier_order is larger than its order")
    numbers = {"maxh", "accuracy"} & settings.keys()
    for name in numbers | ({"barrier_end"} if scene.constraints else set()):
        check_number(name, settings[name], 0)


def _history(data):
    rows = list(csv.reader(io.StringIO(data.decode("utf-8"), newline="")))
    if tuple(rows[0]) not in (COLUMNS, FIRST_COLUMNS):
        raise ValueError(f"its columns are not {', '.join(COLUMNS)}")
    types = [Row.__dataclass_fields__[name].type for name in rows[0]]
    return [Row(*(kind(text) for kind, text in zip(types, row, strict=True))) for row in rows[1:]]


def _check_against_psi(result, summary):
    """Refuse numbers, and a "converged", that ψ contradicts."""
    scene, history, cost = result.scene, result.history, _cost_of(result)
    kc = scene.fabric.stiffness

    def same(value, found):
        scale = ROUNDING * abs(found) + NO_STRAIN * result.area
        return isfinite(found) and abs(value - found) <= scale

    pairs = {"cost": (result.cost, cost)}
    for name, unit in {"energy": kc, "area": 1, "converged": 1}.items():
        if name in summary:
            pairs[name] = summary[name] / unit, getattr(result, name) / unit
    if result.converged and history:
        unit = scene.copies * kc / scene.normalisation
        pairs["energy of the last row"] = history[-1].energy, unit * cost
    differing = [name for name, pair in pairs.items() if not same(*pair)]
    if differing:
        raise ValueError(f"its {', '.join(differing)} is not what ψ gives")
    steps = history[-1].newton if history else 0
    if not (result.newton_iterations >= steps >= 0 and 0 <= result.seconds < np.inf):
        raise ValueError("its steps or seconds are not those of its history")
    if result.converged and not (result.unfolded and _within_limits(result)):
        raise ValueError("it is converged, and its ψ is folded or beyond a limit")


def _within_limits(result):
    """Whether all slacks are positive where the solve asked them, up to rounding."""
    mesh = result.state.space.mesh
    points = mesh.MapToAllElements({ngs.ET.TRIG: _rule(result)}, ngs.VOL)
    points = np.concatenate([points, mesh_points(mesh, *result.limit_points)])
    cloth, limits = _cloth(result), result.scene.constraints
    values = [c.Compile()(points) for limit in limits for c in limit.slacks(cloth)]
    return all(c.min() >= -ROUNDING * np.abs(c).max() for c in values)


def _cloth(result):
    sheet, psi, fabric = result.sheet, result.state.components[:2], result.scene.fabric
    return Kinematics(gradient(*psi), sheet.metric, fabric, lambda: sheet.curvature, psi)


def _rule(result):
    """The integration rule of the solve."""
    return ngs.IntegrationRule(ngs.TRIG, 2 * ((result.settings["quadrature"] + 1) // 2))


def _cost_of(result):
    """`Result.cost`, from ψ."""
    cloth, scene, fabric = _cloth(result), result.scene, result.scene.fabric
    cost = cloth.energy if scene.cost is None else scene.cost(cloth)
    integral = ngs.dx(intrules={ngs.ET.TRIG: _rule(result)})
    return ngs.Integrate(
        cloth.jacobian * cost / fabric.stiffness * integral, result.state.space.mesh
    )
