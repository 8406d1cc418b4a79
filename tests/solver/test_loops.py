"""How a solve is stopped, watched and taken up again; other costs, starts and schedules."""

import dataclasses
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import ngcloth
from ngcloth import Reason, Scene, solve
from ngcloth.energy.closed_form import ClosedFormLagrangian
from ngcloth.result.history import Row
from ngcloth.scenes import hemicatenoid, hemisphere, sphere
from ngcloth.solver.checkpoint import Checkpoint

solving = import_module("ngcloth.solver.solve")
meshes = import_module("ngcloth.solver.meshes")

SCENES = {"Chebyshev": (hemicatenoid(), 0.3), "limits": (hemisphere(10.0), 0.35)}


@pytest.fixture(params=SCENES)
def case(request):
    return SCENES[request.param]


def test_callback_sees_each_step_and_stops(case):
    scene, maxh = case
    seen = []

    def watch(result):
        assert result.reason is Reason.RUNNING and not result.converged
        seen.append((result.area, result.history[-1].newton))
        return len(seen) == 3

    result = solve(scene, maxh=maxh, callback=watch)
    assert result.reason is Reason.CALLBACK and len(seen) == len(result.history) == 3
    assert (result.area, result.newton_iterations) == seen[-1]
    assert len({area for area, _ in seen}) == 3


@pytest.mark.parametrize(
    ("said", "stops"), [(np.True_, True), (np.False_, False), (np.ones(2), False)]
)
def test_what_a_callback_says_with_numpy(said, stops):
    result = solve(hemisphere(), maxh=0.5, callback=lambda result: said)
    assert (result.reason is Reason.CALLBACK) == stops
    assert result.converged != stops


def test_budget_of_seconds(case):
    scene, maxh = case
    result = solve(scene, maxh=maxh, max_seconds=1e-3)
    assert result.reason is Reason.TIME_BUDGET and not result.converged
    assert result.newton_iterations <= 1


def test_interrupt_returns_the_last_accepted_step(case):
    """An interrupt in the middle of the fourth step."""
    scene, maxh = case
    third = []

    def watch(result):
        if len(result.history) == 3:
            third.append(result.state.vec.FV().NumPy().copy())
        if len(result.history) == 4:
            result.state.vec.FV().NumPy()[:] = np.nan
            raise KeyboardInterrupt

    result = solve(scene, maxh=maxh, callback=watch)
    assert result.reason is Reason.INTERRUPTED and len(result.history) == 4
    assert np.isfinite(result.energy) and result.extrema["jacobian"][0] > 0
    assert not np.array_equal(result.state.vec.FV().NumPy(), third[0])


# What the rows tell -------------------------------------------------------------------------


@pytest.mark.parametrize("schedule", ["adaptive", "paper"])
def test_lengths_and_active_limits(schedule):
    """As the barrier weakens, limits are active at fewer points; at the end where s² < μ."""
    lines = []
    scene, settings = hemisphere(10.0), {"maxh": 0.5, "barrier_end": 1e-2, "tolerance": 1e-2}
    result = solve(scene, schedule=schedule, log=lines.append, **settings)
    rows, settings = result.history, result.settings
    assert result.converged and all(0 < row.length <= 1 for row in rows)
    assert min(row.length for row in rows) < 0.9 < max(row.length for row in rows) <= 1
    names = ("order", "quadrature", "inverse", "multiplier_order")
    arguments = (settings[name] for name in names)
    problem = ClosedFormLagrangian(scene, result.sheet, *arguments)
    problem.state.vec.data = result.state.vec
    problem.add_limit_points(result.limit_points)
    slacks = problem.slacks()
    assert 0 < rows[-1].active < 0.6 * rows[0].active <= 0.6 * slacks.size
    assert rows[-1].active == pytest.approx((slacks < 0.1).sum(), rel=0.1)
    header, *printed = (line for line in lines if "start" not in line)
    columns = header.split()
    for row, line in zip(rows, printed, strict=False):
        told = dict(zip(columns, line.split(), strict=True))
        assert float(told["length"]) == pytest.approx(row.length, rel=0.1)
        assert int(told["active"]) == row.active and len(line) == len(header) <= 110


@pytest.mark.parametrize("schedule", ["adaptive", "paper"])
def test_without_limits_none_is_active(schedule):
    rows = solve(hemisphere(), maxh=0.4, schedule=schedule, tolerance=1e-3).history
    assert all(row.active == 0 and 0 < row.length <= 1 for row in rows)
    assert rows[-1].length == 1


# Checkpoints --------------------------------------------------------------------------------


@pytest.mark.parametrize("steps", [1, 4])
def test_taken_up_again(case, tmp_path, steps):
    scene, maxh = case
    path = tmp_path / "run.npz"
    whole = solve(scene, maxh=maxh)
    cut = solve(scene, maxh=maxh, checkpoint=path, max_steps=steps)
    assert cut.reason is Reason.STEP_BUDGET and path.exists()
    rest = solve(scene, maxh=maxh, checkpoint=path)
    assert rest.converged and not path.exists()
    assert rest.newton_iterations == whole.newton_iterations
    assert len(rest.history) == len(whole.history)
    assert rest.energy == pytest.approx(whole.energy, rel=1e-9, abs=1e-12)
    assert rest.seconds > cut.seconds


SCRIPT = """
import ngcloth, sys
scene = ngcloth.scenes.hemisphere(10.0)
ngcloth.solve(scene, maxh=0.15, checkpoint=sys.argv[1], log=lambda line: print(line, flush=True))
"""


def test_killed_at_random_times(tmp_path):
    """SIGKILL, again and again; what is there is always good, and the end is the same."""
    path, moments = tmp_path / "run.npz", random.Random(3)
    command, environment = [sys.executable, "-c", SCRIPT, str(path)], os.environ | {}
    went_on = False
    for _ in range(20):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        for line in process.stdout:
            went_on = went_on or line.startswith("going on")
            if "barrier" in line and moments.random() < 0.5:
                time.sleep(0.02 * moments.random())
                process.send_signal(signal.SIGKILL)
                break
        process.stdout.close()
        if process.wait() == 0:
            break
        assert process.returncode == -signal.SIGKILL
        if path.exists():
            with np.load(path, allow_pickle=False) as found:
                assert np.isfinite(found["state"]).all()
    assert went_on
    result = solve(hemisphere(10.0), maxh=0.15, checkpoint=path)
    assert result.converged
    whole = solve(hemisphere(10.0), maxh=0.15)
    assert result.energy == pytest.approx(whole.energy, rel=1e-6)


def test_checkpoints_without_lengths_are_good(tmp_path):
    """Those written before rows had `length` and `active`, which were the last columns."""
    path = tmp_path / "run.npz"
    cut = solve(hemisphere(10.0), maxh=0.35, checkpoint=path, max_steps=4)
    with np.load(path) as found:
        arrays = dict(found)
    arrays["numbers"] = arrays["numbers"][:, :-2]
    np.savez(path, **arrays)
    rest = solve(hemisphere(10.0), maxh=0.35, checkpoint=path)
    assert rest.converged and rest.history[3].energy == cut.history[3].energy
    assert np.isnan(rest.history[3].length) and rest.history[4].length > 0


def no_mesh(*arguments):
    raise AssertionError("a mesh was made")


def refused(path, told, scene=None, **settings):
    with pytest.raises(ngcloth.InputError, match=told) as error:
        solve(scene or hemisphere(10.0), **{"maxh": 0.35, "checkpoint": path} | settings)
    assert error.value.argument == "checkpoint"


@pytest.fixture
def cut_off(tmp_path):
    """The checkpoint of two steps."""
    path = tmp_path / "run.npz"
    solve(hemisphere(10.0), maxh=0.35, checkpoint=path, max_steps=2)
    return path


def test_foreign_and_damaged_checkpoints(cut_off, monkeypatch):
    """They are refused before the mesh."""
    monkeypatch.setattr(meshes, "make_mesh", no_mesh)
    refused(cut_off, "another one's", hemisphere(11.0))
    refused(cut_off, "another one's", maxh=0.25)
    refused(cut_off, "another one's", dataclasses.replace(hemisphere(10.0), cost=energy))
    whole = cut_off.read_bytes()
    for damaged in (b"", whole[: len(whole) // 2], b"no archive", whole[:99] + whole[400:]):
        cut_off.write_bytes(damaged)
        refused(cut_off, "damaged")


def test_places_that_are_no_checkpoint(tmp_path, monkeypatch):
    """A pipe, read from, would be waited for; a folder or device is not to be replaced."""
    monkeypatch.setattr(meshes, "make_mesh", no_mesh)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", os.devnull, tmp_path / "none" / "run.npz", "", 3):
        refused(path, "path of a file")
    refused(tmp_path / ("x" * 1000), "too long")
    assert [path.name for path in tmp_path.iterdir()] == ["pipe"]


@pytest.mark.parametrize(
    "name, edit, told",
    [
        ("memory_s", None, "another build, without s"),
        ("memory_filter", None, "another build, without filter"),
        ("memory_s", lambda s: s[:, :-1], "another shape of s"),
        ("memory_filter", lambda pairs: np.zeros(3), "another shape of filter"),
        ("memory_rate", lambda rate: np.zeros(2), "another shape of rate"),
        ("memory_z", lambda z: np.full_like(z, np.nan), "damaged"),
        ("memory_z", lambda z: z.astype(str), "damaged"),
        ("state", lambda state: state[:-1], "another shape of the state"),
        ("state", lambda state: state * np.nan, "damaged"),
        ("state", lambda state: state + np.inf, "damaged"),
        ("state", lambda state: state * 1e300, "damaged"),
        ("numbers", lambda rows: rows * np.nan, "damaged"),
        ("numbers", lambda rows: rows[:, :3], "damaged"),
        ("phases", lambda phases: phases[:0], "damaged"),
        ("identity", None, "damaged"),
    ],
)
def test_checkpoints_of_another_build(name, edit, told, cut_off):
    with np.load(cut_off) as found:
        arrays = dict(found)
    there = arrays.pop(name)
    np.savez(cut_off, **arrays | ({} if edit is None else {name: edit(there)}))
    refused(cut_off, told)


@pytest.mark.parametrize("attribute", [(np, "savez"), (os, "replace"), (Path, "unlink")])
def test_a_full_disk_does_not_end_a_solve(attribute, tmp_path, monkeypatch):
    """Nor does one that takes nothing, or lets go of nothing."""

    def fail(*arguments, **options):
        raise OSError("no space left on device")

    whole, lines = solve(hemisphere(10.0), maxh=0.5), []
    monkeypatch.setattr(*attribute, fail)
    with pytest.warns(RuntimeWarning, match="without its checkpoint .no space"):
        path = tmp_path / "run.npz"
        result = solve(hemisphere(10.0), maxh=0.5, checkpoint=path, log=lines.append)
    assert result.converged and result.energy == pytest.approx(whole.energy, rel=1e-9)
    assert any("without its checkpoint (no space" in line for line in lines)
    if attribute[0] is not Path:
        assert not list(tmp_path.iterdir())


def test_a_folder_that_goes_away(tmp_path):
    (tmp_path / "here").mkdir()
    path = tmp_path / "here" / "run.npz"

    def remove(result):
        if path.exists():
            shutil.rmtree(path.parent)

    with pytest.warns(RuntimeWarning, match="without its checkpoint"):
        assert solve(hemisphere(10.0), maxh=0.5, checkpoint=path, callback=remove).converged


def test_one_checkpoint_of_many(tmp_path):
    """Each write is whole: what is there at any moment is one of them."""
    path = tmp_path / ("x" * 255)  # as long as names may be
    row = Row("flow", *[0.0] * 6, newton=1, seconds=1.0)

    def write(number):
        Checkpoint(path, {}).write(np.full(10**4, number), [row], {})
        state, rows, memory = Checkpoint(path, {}).found(10**4, (), 0)
        assert [each.newton for each in rows] == [1] and memory == {}
        return len(set(state.tolist()))

    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(write, range(100))) == {1}
    assert [each.name for each in tmp_path.iterdir()] == [path.name]
    Checkpoint(path, {}).remove()
    assert not list(tmp_path.iterdir())


# Costs, starts, schedules -------------------------------------------------------------------


def energy(cloth):
    return cloth.fabric.energy(cloth.I4, cloth.I6, cloth.I8)


def total_shear(cloth):
    return cloth.shear**2 + 0.01 * energy(cloth)


def test_energy_as_cost_needs_no_multiplier():
    """Without limits the minimum of E is in equilibrium: η vanishes up to what the mesh leaves."""
    scene = dataclasses.replace(hemisphere(10.0), constraints=())
    plain = solve(scene, maxh=0.25)
    held = solve(dataclasses.replace(scene, cost=energy), maxh=0.25)
    assert plain.converged and held.converged
    assert held.normalized_energy == pytest.approx(plain.normalized_energy, rel=1e-6)
    assert held.outline(50) == pytest.approx(plain.outline(50), abs=1e-5)
    eta = held.state.vec.FV().NumPy()[held.state.space.Range(2).start :]
    assert np.abs(eta).max() < 1e-3


def test_another_cost_is_lower_where_it_is_minimised():
    """Little shear at the price of stretch, in equilibrium; neither can beat the other's own."""
    stiff = hemisphere(10.0)
    usual = solve(stiff, maxh=0.25)
    other = solve(dataclasses.replace(stiff, cost=total_shear), maxh=0.25)
    assert other.converged and other.energy > 1.1 * usual.energy
    assert other.extrema["shear"][1] < 0.9 * usual.extrema["shear"][1]
    assert other.equilibrium_residual < 0.1


def test_bad_cost():
    with pytest.raises(ngcloth.InputError, match="cost"):
        Scene(hemisphere().surface, ngcloth.Net(), cost=3.0)


def test_minima_lowest_first():
    scene = sphere(0.8, shear_limit=np.cos(np.pi / 6))
    starts = [(0.1, 0.1), (0.1, 0.1), (0.5, 0.3)]
    found = ngcloth.minima(scene, starts, maxh=0.35, max_steps=150)
    assert 1 <= len(found) <= 2  # two starts are the same
    energies = [result.energy for result in found if result.converged]
    assert energies and energies == sorted(energies)


@pytest.mark.parametrize("kc", [1.0, (1.0, 2.0)])
def test_a_turned_patch_is_the_same_minimum_if_its_threads_are(kc):
    """A half turn changes no energy, a quarter turn none where warp and weft are alike."""
    chart = ngcloth.Surface(lambda x, y: (x, y, -0.1 * x * x - 0.6 * y * y), ngcloth.Disk())
    scene = Scene(chart, ngcloth.Net(kc=kc, ks=1.0), [ngcloth.Elongation()])
    starts = [(0.9, 0.8), (-0.9, -0.8), lambda x, y: (-0.8 * y, 0.9 * x)]
    found = ngcloth.minima(scene, starts, maxh=0.35, barrier_end=1e-4)
    assert all(result.converged for result in found)
    assert len(found) == (1 if kc == 1.0 else 2)


def test_paper_schedule_with_limits():
    """Slower by far, and to the same patch, up to limits between the points."""
    scene, settings = hemisphere(1.0), {"maxh": 0.35, "barrier_end": 1e-2}
    paper = solve(scene, schedule="paper", tolerance=1e-4, **settings)
    ours = solve(scene, **settings)
    assert paper.converged and ours.converged
    assert paper.normalized_energy == pytest.approx(ours.normalized_energy, rel=2.5e-2)
    assert paper.newton_iterations > 3 * ours.newton_iterations
    assert [row.phase for row in paper.history][0] == "saddle"
    assert paper.history[0].mu == 10.0 and paper.history[-1].mu == 1e-2


def test_folded_between_the_points_is_not_converged():
    """Few triangles on a long ellipsoid: J > 0 at the integration points, and not beside them."""

    def chart(x, y):
        square = x * x + y * y
        return 2 * x / (1 + square), 2 * y / (1 + square), 10 * (1 - square) / (1 + square)

    surface = ngcloth.Surface(chart, ngcloth.Disk())
    limits = (ngcloth.Elongation(),)
    scene = Scene(surface, ngcloth.Net(ks=1.0), limits, symmetric=True)
    result = solve(scene, maxh=0.25, max_steps=250)
    assert not result.converged or result.certificate().jacobian > 0
    if result.reason is Reason.FOLDED:
        assert not result.unfolded and "folds" in str(result)
