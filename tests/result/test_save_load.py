"""A saved result comes back whole; a damaged, foreign or half-written one is refused by name."""

import csv
import hashlib
import io
import json
import os
import pickle
import random
import re
import shutil
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from functools import cache
from pathlib import Path

import ngsolve as ngs
import numpy as np
import pytest

import ngcloth
from ngcloth import Disk, Elongation, InputError, Net, Reason, Rectangle, Scene, ShearLimit, Surface
from ngcloth.result import load as loading
from ngcloth.result import saved_fields
from ngcloth.result.history import Row
from ngcloth.result.reading import plain_arrays
from ngcloth.result.save import CHECKSUMS, FILES, hidden
from ngcloth.scenes import hemicatenoid, hemisphere, sphere

FIELDS = ("stretch1", "stretch2", "shear", "reaction", "jacobian")
TAUT = (Elongation(),)


class Locking:
    """A law of the user's own, whose repr has its address in it."""

    def __init__(self, stiffness=2.0):
        self.stiffness = stiffness

    def energy(self, I4, I6, I8):
        return 2 * (I4 - 1) ** 2 + (I6 - 1) ** 2 + 0.1 * (ngs.exp(I8**2) - 1)


def own_scene(bend=0.2, side=(-1.0, 1.2), limits=TAUT, start=None, facing=1):
    def chart(x, y):
        return x, y + 0.1 * x * y, 0.3 * x**2 + bend * y**2

    surface = Surface(chart, Rectangle((0.0, 1.5), side), side=facing)
    return Scene(surface, Locking(), limits, start, name="own")


SCENES = {
    "Chebyshev": (hemisphere, {"maxh": 0.3}),
    "unfinished, order 5": (
        lambda: hemisphere(symmetric=False),
        {"maxh": 0.6, "order": 5, "max_steps": 2},
    ),
    "elastic": (lambda: hemisphere(1.0), {"maxh": 0.3, "multiplier_order": 1}),
    "own": (own_scene, {"maxh": 0.4}),
}


@cache
def solved(name):
    make, settings = SCENES[name]
    return ngcloth.solve(make(), **settings)


@pytest.fixture(params=SCENES)
def result(request):
    return solved(request.param)


@pytest.fixture
def saved(tmp_path):
    """The folder of the elastic hemisphere."""
    solved("elastic").save(tmp_path / "saved")
    return tmp_path / "saved"


def needed(result):
    """The scene that a load of the result has to be given."""
    return own_scene() if result.scene.name == "own" else None


def sign(folder):
    """Make the checksums right again, as someone would who means harm."""
    lines = [f"{hashlib.sha256((folder / n).read_bytes()).hexdigest()}  {n}\n" for n in FILES]
    (folder / CHECKSUMS).write_text("".join(lines))


def refused(folder, *names, **options):
    with pytest.raises(InputError) as error:
        ngcloth.load(folder, **options)
    assert error.value.argument == "folder"
    assert any(name in str(error.value) for name in names), str(error.value)
    return str(error.value)


# Round trip ---------------------------------------------------------------------------------


def test_round_trip(result, tmp_path, capfd):
    folder = tmp_path / "a patch é"
    result.save(folder)
    loaded = ngcloth.load(str(folder), scene=needed(result))
    assert capfd.readouterr() == ("", "")
    domain = result.scene.surface.domain
    theta = domain.sample(9).T
    assert np.array_equal(loaded.psi(*theta), result.psi(*theta))
    assert np.array_equal(loaded.outline(50), result.outline(50))
    for name in FIELDS:
        assert np.array_equal(loaded.field(name, *theta), result.field(name, *theta))
    for name in ("energy", "normalized_energy", "area", "error", "extrema", "converged", "reason"):
        assert getattr(loaded, name) == getattr(result, name), name
    for name in ("newton_iterations", "seconds", "settings", "history"):
        assert getattr(loaded, name) == getattr(result, name), name
    assert loaded.equilibrium_residual == pytest.approx(result.equilibrium_residual, rel=1e-9)
    assert str(loaded) == str(result)
    assert all(isinstance(row, Row) for row in loaded.history)
    assert list(loaded.state.space.FreeDofs()) == list(result.state.space.FreeDofs())
    assert np.array_equal(loaded.state.vec.FV().NumPy(), result.state.vec.FV().NumPy())
    for found, expected in zip(loaded.limit_points, result.limit_points, strict=True):
        assert np.array_equal(found, expected)
    loaded.save(tmp_path / "again")
    again = ngcloth.load(tmp_path / "again", scene=needed(result))
    assert np.array_equal(again.outline(50), result.outline(50))


def test_why_it_stopped_is_kept(tmp_path):
    result = solved("unfinished, order 5")
    assert result.reason is Reason.STEP_BUDGET
    result.save(tmp_path / "x")
    loaded = ngcloth.load(tmp_path / "x")
    assert loaded.reason is Reason.STEP_BUDGET and not loaded.converged


def test_a_fresh_process_loads_the_same_patch(saved):
    script = "import ngcloth, sys; print(ngcloth.load(sys.argv[1]).outline(5).tolist())"
    run = subprocess.run([sys.executable, "-c", script, saved], capture_output=True, check=True)
    assert np.array_equal(json.loads(run.stdout), solved("elastic").outline(5))


@pytest.mark.parametrize("domain", [Disk(1e-3), Disk(1e3), Rectangle((100, 101), (1e-3, 2e-3))])
def test_domains_of_any_size(domain, tmp_path):
    width = domain.diameter
    scene = Scene(Surface(lambda x, y: (x, y, x * y / width), domain), Net())
    result = ngcloth.solve(scene, maxh=0.3 * width, order=3, max_steps=1)
    result.save(tmp_path / "x")
    loaded = ngcloth.load(tmp_path / "x", scene=scene)
    assert np.array_equal(loaded.outline(20), result.outline(20))


# What other programs read -------------------------------------------------------------------


def test_json_and_csv_tell_the_numbers(result, tmp_path):
    result.save(tmp_path / "x")
    record = json.loads((tmp_path / "x" / "result.json").read_text(encoding="utf-8"))
    assert record["summary"]["energy"] == result.energy
    assert record["summary"]["area"] == result.area
    assert record["settings"] == result.settings
    assert record["reason in words"] == str(result.reason)
    assert record["versions"]["ngsolve"] == ngs.__version__
    assert record["versions"]["ngcloth"] == ngcloth.__version__
    with open(tmp_path / "x" / "history.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == list(Row.__dataclass_fields__)
    assert len(rows) == len(result.history)
    assert float(rows[-1]["energy"]) == pytest.approx(result.normalized_energy, rel=1e-12)


def test_npz_holds_the_patch(result, tmp_path):
    """Pattern and mesh from the arrays alone, without NGSolve."""
    result.save(tmp_path / "x")
    with np.load(tmp_path / "x" / "fields.npz", allow_pickle=False) as arrays:
        fields = dict(arrays)
    assert ("eta" in fields) == bool(result.scene.constraints)
    theta, psi = fields["theta"].reshape(-1, 2), fields["psi"].reshape(-1, 2)
    inside = result.scene.surface.domain.contains(theta)  # a few of the rim are 1e-4 outside
    assert np.abs(result.psi(*theta[inside].T) - psi[inside]).max() < 1e-12
    corners = fields["vertices"][fields["triangles"]]
    order = result.settings["order"]
    ends = [-1, order, 0]  # NGSolve's corners are at (1, 0), (0, 1), (0, 0)
    assert np.abs(np.sort(fields["theta"][:, ends], 1) - np.sort(corners, 1)).max() < 1e-12
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.sum(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    domain = result.scene.surface.domain
    exact = np.pi if isinstance(domain, Disk) else np.prod(np.ptp(domain.box, axis=1))
    assert area * result.scene.copies == pytest.approx(exact, rel=0.1)
    if "eta" in fields:
        radius = np.hypot(*(theta - domain.centre).T)
        rim = radius > 1 - 1e-9 if isinstance(domain, Disk) else np.abs(theta[:, 0]) < 1e-12
        assert rim.any() and np.abs(fields["eta"].reshape(-1, 2)[rim]).max() < 1e-12
        assert np.abs(fields["eta"]).max() > 1e-4


def test_history_without_lengths(saved):
    """Files written before rows had `length` and `active`, which are the last columns."""
    lines = (saved / "history.csv").read_text().splitlines()
    assert lines[0].endswith("seconds,length,active")
    (saved / "history.csv").write_text("".join(line.rsplit(",", 2)[0] + "\n" for line in lines))
    sign(saved)
    rows, expected = ngcloth.load(saved).history, solved("elastic").history
    assert [row.energy for row in rows] == [row.energy for row in expected]
    assert all(np.isnan(row.length) and row.active == 0 for row in rows)


# Damage -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*FILES, CHECKSUMS])
def test_no_flipped_bit_passes(name, saved):
    whole, chance = (saved / name).read_bytes(), random.Random(name)
    for position in {0, len(whole) - 1, *chance.sample(range(len(whole)), 60)}:
        damaged = bytearray(whole)
        damaged[position] ^= 1 << chance.randrange(8)
        (saved / name).write_bytes(damaged)
        refused(saved, *([name] if name in FILES else [*FILES, CHECKSUMS]))
    (saved / name).write_bytes(whole)
    ngcloth.load(saved)


@pytest.mark.parametrize("name", [*FILES, CHECKSUMS])
def test_missing_or_cut_off_files(name, saved):
    whole = (saved / name).read_bytes()
    for length in (0, 1, len(whole) // 2, len(whole) - 2):
        (saved / name).write_bytes(whole[:length])
        refused(saved, *([name] if name in FILES else [*FILES, CHECKSUMS]))
    (saved / name).unlink()
    assert f"{name} is missing" in refused(saved, name)


@pytest.mark.parametrize(
    "change",
    [
        {"format": "another"},
        {"version": 2},
        {"version": None},
        {"reason": "HAPPY"},
        {"cost": "much"},
        {"settings": None},
        {"settings": {"maxh": 0.1}},
        {"scene": {"recipe": {"scene": "eval", "arguments": {}}, "name": "x"}},
        {"scene": {"recipe": {"scene": "sphere", "arguments": {"portion": 7}}, "name": "x"}},
        {"scene": {"recipe": {"scene": "sphere", "arguments": {"colour": 7}}, "name": "x"}},
        {"scene": {"recipe": [], "name": "x"}},
    ],
    ids=str,
)
def test_foreign_json(change, saved):
    record = json.loads((saved / "result.json").read_text(encoding="utf-8"))
    (saved / "result.json").write_text(json.dumps(record | change))
    sign(saved)
    refused(saved, "result.json")


@pytest.mark.parametrize("text", ["", "[]", "{}", "null", "no JSON", "\xff", "[" * 100000])
def test_no_json_of_ours(text, saved):
    (saved / "result.json").write_bytes(text.encode("latin-1"))
    sign(saved)
    refused(saved, "result.json")


@pytest.mark.parametrize(
    "edit",
    [
        lambda text: text.replace("phase", "stage", 1),
        lambda text: re.sub("barrier,[^,]+", "barrier,one", text, count=1),
        lambda text: re.sub("barrier,[^,]+", "barrier", text, count=1),
        lambda text: text.replace(",active", ""),
        lambda text: "",
    ],
)
def test_foreign_history(edit, saved):
    (saved / "history.csv").write_text(edit((saved / "history.csv").read_text()))
    sign(saved)
    refused(saved, "history.csv")


def cut(array):
    return array[:-1]


def wrong_vertex(triangles):
    return np.where(np.arange(len(triangles))[:, None] == 3, 10**6, triangles)


def wrong_vertex_of_one(triangles):
    return np.where(np.arange(len(triangles)) == 3, -1, triangles)


@pytest.mark.parametrize(
    "name, edit",
    [
        ("state", cut),
        ("state", lambda state: state * 1.001),
        ("state", lambda state: state[::-1]),
        ("psi", cut),
        ("psi", lambda psi: psi * np.nan),
        ("theta", lambda theta: theta + 1e-3),
        ("vertices", lambda vertices: vertices * 1.01),
        ("vertices", lambda vertices: vertices.astype(str)),
        ("triangles", wrong_vertex),
        ("triangles", lambda triangles: -triangles),
        ("triangles", lambda triangles: triangles[:, :2]),
        ("triangles", lambda triangles: triangles + 0.5),
        ("segments", lambda segments: segments[:, ::-1]),
        ("segments", lambda segments: segments + np.array([0, 0, 1])),
        ("limit_triangles", cut),
        ("limit_triangles", wrong_vertex_of_one),
        ("limit_reference", cut),
        ("limit_reference", lambda reference: reference + 0.5),
        ("limit_reference", lambda reference: reference * np.nan),
        ("limit_reference", lambda reference: reference.astype(int)),
    ],
)
def test_foreign_fields(name, edit, saved):
    with np.load(saved / "fields.npz") as arrays:
        fields = dict(arrays)
    np.savez(saved / "fields.npz", **fields | {name: edit(fields[name])})
    sign(saved)
    refused(saved, "fields.npz")
    np.savez(saved / "fields.npz", **{key: fields[key] for key in fields if key != name})
    sign(saved)
    refused(saved, "fields.npz")


def test_limit_points_are_optional(saved):
    """In files written before there were any."""
    fields = arrays_of(saved / "fields.npz")
    old = {name: array for name, array in fields.items() if not name.startswith("limit_")}
    assert len(old) == len(fields) - 2
    np.savez(saved / "fields.npz", **old)
    sign(saved)
    assert not len(ngcloth.load(saved).limit_points.triangles)


def test_more_limit_points_than_a_solve_asks(saved):
    """Each would take kilobytes of a certificate."""

    def edit(fields, record):
        number = 435 * len(fields["triangles"]) + 1
        fields["limit_triangles"] = np.zeros(number, dtype=int)
        fields["limit_reference"] = np.full((number, 2), 0.25)

    rewrite(saved, edit)
    assert "limit points" in refused(saved, "fields.npz")


def test_fields_of_another_result(saved, tmp_path):
    solved("Chebyshev").save(tmp_path / "other")
    shutil.copy(tmp_path / "other" / "fields.npz", saved)
    sign(saved)
    refused(saved, "fields.npz")


# Files that contradict themselves -----------------------------------------------------------


def arrays_of(path):
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)


def rewrite(saved, edit):
    """Change arrays and result.json as one would who means harm, and make the checksums right."""
    fields = arrays_of(saved / "fields.npz")
    record = json.loads((saved / "result.json").read_text(encoding="utf-8"))
    edit(fields, record)
    np.savez(saved / "fields.npz", **fields)
    (saved / "result.json").write_text(json.dumps(record), encoding="utf-8")
    sign(saved)


def scaled(factor, fields):
    n = len(fields["state"]) // 2  # ψ, before an η of the same order
    fields["state"][:n] *= factor
    fields["psi"] *= factor


@pytest.mark.parametrize("factor", [0.0, 1.3, 1 + 1e-6, -1.0])
def test_scaled_patches_are_not_taken_with_the_old_energy(factor, tmp_path):
    result = solved("own")
    result.save(tmp_path / "x")
    rewrite(tmp_path / "x", lambda fields, record: scaled(factor, fields))
    if factor == -1:  # half a turn: the same patch
        loaded = ngcloth.load(tmp_path / "x", scene=own_scene())
        assert np.array_equal(loaded.outline(9), -result.outline(9))
        return
    told = refused(tmp_path / "x", "cost", scene=own_scene())
    assert "is not what ψ gives" in told


def test_a_scaled_patch_with_all_its_numbers(saved):
    """Limits tell: with λ < 1 nothing has converged, whatever the energies."""
    right = solved("elastic")
    state = ngs.GridFunction(right.state.space)
    state.vec.data = right.state.vec
    state.vec.FV().NumPy()[: right.state.space.Range(1).stop] *= 1.3
    cost = loading._cost_of(replace(right, state=state))
    slack = replace(right, state=state, cost=cost, history=[])
    assert slack.unfolded and slack.extrema["stretch1"][0] < 0.8
    slack.save(saved)
    refused(saved, "its ψ is folded or beyond a limit")
    replace(slack, reason=Reason.STEP_BUDGET).save(saved)
    assert ngcloth.load(saved).energy == slack.energy


def eta_of_nan(fields, record):
    fields["eta"][:], fields["state"][-1] = np.nan, np.nan


def eta_of_another(fields, record):
    fields["eta"] *= 2


def complex_psi(fields, record):
    fields["psi"] = fields["psi"] * (1 + 1j)


def complex_state(fields, record):
    fields["state"] = fields["state"] + 0j


def one_more(fields, record):
    fields["more"] = np.zeros(3)


def one_triangle_less(fields, record):
    for name in ("triangles", "theta", "psi", "eta"):
        fields[name] = fields[name][1:]


def turned_triangles(fields, record):
    fields["triangles"] = fields["triangles"][:, ::-1]


def beyond_the_rim(fields, record):
    fields["vertices"] = fields["vertices"] * 1.5


@pytest.mark.parametrize(
    "edit, told",
    [
        (eta_of_nan, "of finite numbers"),
        (eta_of_another, "eta at the nodes"),
        (complex_psi, "psi is not an array"),
        (complex_state, "state is not an array"),
        (one_more, "other arrays"),
        (one_triangle_less, "triangle"),
        (turned_triangles, "turned over"),
        (beyond_the_rim, "outside the domain"),
    ],
)
def test_arrays_that_are_not_a_patch(edit, told, saved):
    rewrite(saved, edit)
    assert told in refused(saved, "fields.npz")


@pytest.mark.parametrize(
    "path, value, told",
    [
        (("cost",), 0.1, "cost"),
        (("cost",), float("nan"), "cost"),
        (("summary", "energy"), 0.1, "energy"),
        (("summary", "area"), 0.1, "area"),
        (("summary", "converged"), False, "converged"),
        (("newton_iterations",), 0, "steps"),
        (("seconds",), float("inf"), "seconds"),
        (("settings", "quadrature"), None, "quadrature"),
        (("settings", "quadrature"), 1, "quadrature"),
        (("settings", "multiplier_order"), 4, "multiplier_order"),
        (("settings", "order"), 4, "array"),
        (("settings", "order"), 10**9, "quadrature"),
        (("settings", "quadrature"), 1001, "quadrature 1000"),
        (("settings", "quadrature"), 1000, "points"),
        (("settings", "accuracy"), "fine", "accuracy"),
        (("settings", "accuracy"), None, "accuracy"),
        (("settings", "barrier_end"), [1e-3], "barrier_end"),
        (("settings", "barrier_end"), None, "barrier_end"),
        (("settings", "maxh"), "small", "maxh"),
        (("error", "energy"), 10**400, "int too large"),
        (("error", "energy"), True, "not of bars"),
        (("error", "energy"), -1.0, "not of bars"),
    ],
)
def test_numbers_that_are_not_of_this_patch(path, value, told, saved, monkeypatch):
    monkeypatch.setattr(saved_fields, "MOST_POINTS", 10**5)

    def edit(fields, record):
        *within, last = path
        for name in within:
            record = record[name]
        record[last] = value

    rewrite(saved, edit)
    assert told in refused(saved, "result.json", "fields.npz")


@pytest.mark.parametrize("name", ["order", "quadrature", "multiplier_order"])
def test_settings_are_whole(name, saved):
    rewrite(saved, lambda fields, record: record["settings"].pop(name))
    assert name in refused(saved, "result.json")


def test_the_last_row_is_of_this_patch(saved):
    lines = (saved / "history.csv").read_text().splitlines()
    energy = str(solved("elastic").history[-1].energy)
    assert energy in lines[-1]
    lines[-1] = lines[-1].replace(energy, "0.1")
    (saved / "history.csv").write_text("\n".join(lines) + "\n")
    sign(saved)
    assert "last row" in refused(saved, "result.json")


def shear_squared(cloth):
    return cloth.shear**2 + 0.01 * cloth.fabric.energy(cloth.I4, cloth.I6, cloth.I8)


def test_another_cost_is_another_scene(tmp_path):
    """Also with files from before the cost was in scene.npz: the cost of ψ tells."""
    scene = replace(hemisphere(10.0), cost=shear_squared)
    result = ngcloth.solve(scene, maxh=0.5, max_steps=4)
    result.save(tmp_path / "x")
    others = [
        replace(scene, cost=lambda cloth: 2 * shear_squared(cloth)),
        replace(scene, cost=None),
    ]
    for other in others:
        with pytest.raises(InputError, match="the scene that was solved; cost differ"):
            ngcloth.load(tmp_path / "x", scene=other)
    points = arrays_of(tmp_path / "x" / "scene.npz")
    assert points.pop("cost").shape == points["theta"].shape[:1]
    np.savez(tmp_path / "x" / "scene.npz", **points)
    sign(tmp_path / "x")
    assert ngcloth.load(tmp_path / "x", scene=scene).cost == result.cost
    refused(tmp_path / "x", "cost", scene=others[0])
    refused(tmp_path / "x", "cost", scene=others[1])


@pytest.mark.parametrize("name", [*FILES, CHECKSUMS])
@pytest.mark.parametrize("kind", ["pipe", "folder", "link"])
def test_only_plain_files_are_read(name, kind, saved, tmp_path):
    """A pipe would be waited for; a link leads to what is not in the folder."""
    (saved / name).rename(tmp_path / name)
    if kind == "pipe":
        os.mkfifo(saved / name)
    elif kind == "folder":
        (saved / name).mkdir()
    else:
        (saved / name).symlink_to(tmp_path / name)
    assert "not a plain file" in refused(saved, name)
    with pytest.raises(InputError, match=f"here is {name}"):
        solved("Chebyshev").save(saved)
    assert os.path.lexists(saved / name) and (tmp_path / name).exists()


@pytest.mark.parametrize("name", [*FILES, CHECKSUMS])
def test_files_of_bounded_size(name, saved, monkeypatch):
    monkeypatch.setitem(loading.LARGEST, name, (saved / name).stat().st_size - 1)
    assert "larger than" in refused(saved, name)


def packed(*members, method=zipfile.ZIP_DEFLATED):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, data in members:
            archive.writestr(name, data)
    return file.getvalue()


def npy(array, shape=None):
    """An npy file of an array, with another shape in its header than it has."""
    file = io.BytesIO()
    told = np.lib.format.header_data_from_array_1_0(array) | ({"shape": shape} if shape else {})
    np.lib.format.write_array_header_1_0(file, told)
    return file.getvalue() + array.tobytes()


@pytest.mark.parametrize(
    "data, told",
    [
        (packed(("x.npy", npy(np.zeros(10**5)))), "larger than"),
        (packed(("x.npy", npy(np.zeros(8), (10**12,)))), "another size"),
        (packed(("x.npy", npy(np.zeros(8), (-8,)))), "another size"),
        (packed(("x.npy", npy(np.zeros(8))), ("x", npy(np.zeros(8)))), "one name"),
        (packed(("x.npy", npy(np.zeros(8))), method=zipfile.ZIP_BZIP2), "another way"),
        (packed(*((f"{i}", b"") for i in range(101))), "members"),
    ],
)
def test_arrays_of_bounded_size(data, told):
    """Before memory is taken for what they unpack to, or say that they do."""
    with pytest.raises(ValueError, match=told):
        plain_arrays(data, 10**5)


# Code is not run ----------------------------------------------------------------------------


class Trap:
    """Leaves a trace where it is unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return os.mkdir, (str(self.path),)


@pytest.mark.parametrize("name", ["fields.npz", "scene.npz"])
def test_no_pickle_is_opened(name, saved, tmp_path):
    with np.load(saved / name) as arrays:
        fields = dict(arrays)
    trap = np.array([Trap(tmp_path / "sprung")], dtype=object)
    np.savez(saved / name, **fields | {"theta": trap})
    sign(saved)
    refused(saved, name)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("folder", [None, 3, "", b"x", "\0", ["x"]])
def test_paths(folder, tmp_path):
    refused(folder, "folder")
    with pytest.raises(InputError, match="folder"):
        solved("Chebyshev").save(folder)


def test_folders_that_hold_no_result(tmp_path):
    refused(tmp_path / "nowhere", "missing")
    refused(tmp_path, "missing")
    (tmp_path / "file").write_text("x")
    refused(tmp_path / "file", CHECKSUMS)


# Which scene it was -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make, arguments",
    [
        (hemisphere, (10,)),
        (sphere, (0.85, np.float64(0.5), 0.9)),
        (hemicatenoid, (np.float32(1.0), True)),
        (hemicatenoid, ()),
    ],
)
def test_named_scenes_say_how_they_were_made(make, arguments):
    scene = make(*arguments)
    recipe = json.loads(json.dumps(scene.recipe))
    again = ngcloth.scenes.NAMED[recipe["scene"]](**recipe["arguments"])
    assert recipe["scene"] == make.__name__
    for name in ("name", "fabric", "constraints", "start", "symmetric", "tie_break"):
        assert getattr(again, name) == getattr(scene, name), name
    assert replace(scene, symmetric=False).recipe is None


def test_a_scene_of_ones_own_is_asked_for(tmp_path):
    solved("own").save(tmp_path / "x")
    with pytest.raises(InputError, match="scene = None: the scene 'own' that was solved"):
        ngcloth.load(tmp_path / "x")
    with pytest.raises(InputError, match="an ngcloth.Scene"):
        ngcloth.load(tmp_path / "x", scene="own")


@pytest.mark.parametrize(
    "scene, difference",
    [
        (lambda: own_scene(bend=0.2001), "position"),
        (lambda: own_scene(side=(-1.0, 1.1999)), "theta"),
        (lambda: own_scene(facing=-1), "cloth"),
        (lambda: own_scene(limits=()), "constraints"),
        (lambda: own_scene(limits=(Elongation(), ShearLimit(0.99))), "constraints"),
        (lambda: own_scene(start=(0.8, 0.8)), "start"),
        (lambda: replace(own_scene(), fabric=Net(kc=(2.0, 1.0), ks=0.1)), "cloth"),
        (lambda: replace(own_scene(), fabric=Locking(stiffness=2.1)), "stiffness"),
        (lambda: replace(own_scene(), name="theirs"), "name"),
        (hemisphere, "name, symmetric"),
    ],
)
def test_another_scene_is_not_taken_for_it(scene, difference, tmp_path):
    solved("own").save(tmp_path / "x")
    with pytest.raises(InputError, match=difference) as error:
        ngcloth.load(tmp_path / "x", scene=scene())
    assert error.value.argument == "scene"


def test_a_changed_named_scene_is_not_taken_for_the_original(saved, tmp_path):
    changed = replace(hemisphere(1.0), fabric=Net(ks=1.5))
    with pytest.raises(InputError, match="cloth differ"):
        ngcloth.load(saved, scene=changed)
    assert ngcloth.load(saved, scene=hemisphere(1.0)).converged
    ngcloth.solve(changed, maxh=0.5, max_steps=2).save(tmp_path / "changed")
    with pytest.raises(InputError, match="scene = None"):
        ngcloth.load(tmp_path / "changed")
    assert ngcloth.load(tmp_path / "changed", scene=changed).scene.fabric.ks == 1.5


def test_a_shear_limit_is_part_of_the_scene(tmp_path):
    loose, tight = (own_scene(limits=(ShearLimit(limit),)) for limit in (0.9, 0.89))
    replace(solved("own"), scene=loose).save(tmp_path / "x")
    assert ngcloth.load(tmp_path / "x", scene=loose)
    with pytest.raises(InputError, match="cloth differ"):
        ngcloth.load(tmp_path / "x", scene=tight)


# One result or the other, at any moment -----------------------------------------------------


def test_a_result_is_replaced(saved):
    solved("Chebyshev").save(saved)
    assert ngcloth.load(saved).scene.name == solved("Chebyshev").scene.name
    assert [path.name for path in saved.parent.iterdir()] == ["saved"]


def test_nothing_else_is_replaced(saved, tmp_path):
    pattern = saved / "pattern.svg"
    pattern.write_text("<svg/>")
    with pytest.raises(InputError, match="here is pattern.svg"):
        solved("Chebyshev").save(saved)
    assert pattern.read_text() == "<svg/>"
    pattern.unlink()
    (saved / CHECKSUMS).unlink()
    with pytest.raises(InputError, match="here is fields.npz"):
        solved("Chebyshev").save(saved)
    assert (saved / "fields.npz").exists()
    (tmp_path / "file").write_text("mine")
    for folder in (tmp_path / "file", tmp_path / "file" / "within"):
        with pytest.raises(InputError, match="folder"):
            solved("Chebyshev").save(folder)
    assert (tmp_path / "file").read_text() == "mine"


def test_new_and_empty_folders_are_taken(tmp_path):
    (tmp_path / "empty").mkdir()
    for folder in (tmp_path / "empty", tmp_path / "new" / "below"):
        solved("Chebyshev").save(folder)
        assert ngcloth.load(folder).converged


def test_a_failed_save_leaves_the_old_result(saved, monkeypatch):
    def fail(path, data):
        raise OSError("no space left on device")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(InputError, match="no space"):
        solved("Chebyshev").save(saved)
    assert ngcloth.load(saved).scene.name == solved("elastic").scene.name
    assert [path.name for path in saved.parent.iterdir()] == ["saved"]


def test_no_link_is_followed_to_write(saved, tmp_path):
    """Where a save keeps its work until it is done, a link leads elsewhere."""
    (tmp_path / "elsewhere" / "result").mkdir(parents=True)
    hidden(saved, "new").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="a place to write to"):
        solved("Chebyshev").save(saved)
    assert [path.name for path in (tmp_path / "elsewhere").rglob("*")] == ["result"]
    assert ngcloth.load(saved).scene.name == solved("elastic").scene.name


def test_names_that_are_too_long(tmp_path):
    for name in ("x" * 250, "x" * 1000):
        with pytest.raises(InputError, match="too long"):
            solved("Chebyshev").save(tmp_path / name)
    refused(tmp_path / ("x" * 1000), "too long")
    assert not list(tmp_path.iterdir())


SAVING = """
import sys, ngcloth
result = ngcloth.load(sys.argv[1])
print("ready", flush=True)
sys.stdin.readline()
for _ in range(int(sys.argv[3])): result.save(sys.argv[2])
"""


def test_two_processes_save_to_one_folder(saved, tmp_path):
    """And this one reads it all the while: one of the two results is there, whole."""
    solved("Chebyshev").save(tmp_path / "other")
    target = tmp_path / "target"
    shutil.copytree(saved, target)
    names = {solved(name).scene.name for name in ("Chebyshev", "elastic")}
    command = [sys.executable, "-c", SAVING]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    savers = [
        subprocess.Popen([*command, folder, target, "20"], **pipes)
        for folder in (saved, tmp_path / "other")
    ]
    assert [process.stdout.readline() for process in savers] == [b"ready\n"] * 2
    for process in savers:
        process.stdin.write(b"\n")
        process.stdin.flush()
    found = set()
    while any(process.poll() is None for process in savers):
        found.add(ngcloth.load(target).scene.name)
    for process in savers:
        assert (process.communicate()[1], process.returncode) == (b"", 0)
    assert found <= names and ngcloth.load(target).scene.name in names
    assert {path.name for path in tmp_path.iterdir()} == {"saved", "other", "target"}


def test_killed_at_any_moment(saved, tmp_path):
    """A process that saves two results in turn is killed: one of them is there, whole."""
    solved("Chebyshev").save(tmp_path / "other")
    script = (
        "import sys, ngcloth; a, b = map(ngcloth.load, sys.argv[1:3]); print('ready', flush=True)\n"
        "while True: a.save(sys.argv[3]); b.save(sys.argv[3])"
    )
    names = {solved(name).scene.name for name in ("Chebyshev", "elastic")}
    target, chance = tmp_path / "target", random.Random(1)
    shutil.copytree(saved, target)
    for _ in range(3):
        command = [sys.executable, "-c", script, saved, tmp_path / "other", target]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
            assert process.stdout.readline() == b"ready\n"
            time.sleep(chance.uniform(0.0, 0.2))
            process.kill()
        assert ngcloth.load(target).scene.name in names
    solved("elastic").save(target)
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {"saved", "other", "target"}


def test_cut_off_between_the_two_renames(saved, monkeypatch):
    """The one moment at which the folder is not there: the old result is read from beside it."""
    rename = os.rename

    def dies(source, target):
        if str(target) == str(saved):
            raise KeyboardInterrupt
        rename(source, target)

    monkeypatch.setattr(os, "rename", dies)
    with pytest.raises(KeyboardInterrupt):
        solved("Chebyshev").save(saved)
    monkeypatch.undo()
    assert not saved.exists()
    assert ngcloth.load(saved).scene.name == solved("elastic").scene.name
    solved("Chebyshev").save(saved)
    assert ngcloth.load(saved).scene.name == solved("Chebyshev").scene.name
    assert [path.name for path in saved.parent.iterdir()] == ["saved"]


# Pickle -------------------------------------------------------------------------------------


def valley(x, y):
    return x, y, 0.3 * x**2 + 0.1 * y**2


@pytest.mark.parametrize("name", ["Chebyshev", "elastic", "valley"])
def test_pickle(name):
    if name == "valley":
        scene = Scene(Surface(valley, Disk()), Locking(), TAUT)
        result = ngcloth.solve(scene, maxh=0.5, max_steps=3)
    else:
        result = solved(name)
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.outline(50), result.outline(50))
    assert str(again) == str(result) and again.history == result.history
    assert again.settings == result.settings and again.scene.recipe == result.scene.recipe
    assert np.array_equal(again.state.vec.FV().NumPy(), result.state.vec.FV().NumPy())


def test_pickle_of_a_solve_that_did_not_converge():
    error = ngcloth.SolveError(solved("unfinished, order 5"))
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) and again.result.reason is Reason.STEP_BUDGET
    assert again.result.energy == error.result.energy
