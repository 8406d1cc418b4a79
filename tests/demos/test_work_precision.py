"""The report on run times, on a tiny subset: rows, ratios and page, and what a row measures."""

import csv
import shutil
import sys

import numpy as np
import pytest
from loading import DEMOS

sys.path.insert(0, str(DEMOS))  # the demo imports its helpers as a script does
import against_build
import measuring
import work_precision as demo

TINY = {"hemisphere, ks = 1": ((0.4,), (), (0.4, 0.3), (0.4,))}


@pytest.fixture(scope="module")
def rows():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "ACCURACIES", (2e-2,))
        return demo.run(TINY, exact=False)


def test_rows(rows):
    assert {tuple(row) for row in rows} == {tuple(demo.COLUMNS)}
    assert {row["reason"] for row in rows} == {"CONVERGED"}
    default, weak, paper = (
        demo.select(rows, "hemisphere, ks = 1", curve, 0.4)[0]
        for curve in (demo.DEFAULT, demo.WEAK, demo.PAPER)
    )
    assert paper["energy"] == pytest.approx(weak["energy"], rel=5e-2)  # no points between
    assert paper["newton_steps"] > 10 * weak["newton_steps"]
    bar = [row for row in rows if row["curve"] == demo.REFERENCE][1]
    for name in demo.MEASURES:
        assert 0 < bar[name] < default[name] < 0.1
    assert all(80 < row["import_megabytes"] < row["peak_megabytes"] < 2000 for row in rows)
    for row in rows:  # others are too coarse for coarser ones, and know no error
        chain = row["maxh"] <= 0.3
        assert chain == (row["last_mesh_steps"] < row["newton_steps"])
        assert chain == np.isfinite(row["energy_bar"])


def test_bars(rows):
    """One solve has a chain of meshes; its bar is as asked for, of the size of the error."""
    (line,) = demo.bars(rows)
    assert line["curve"] == demo.TO_ACCURACY and 0.3 < float(line["bar over error"]) < 12
    assert float(line["bar"]) <= 2e-2 * float(line["E/(2π kc)"])


def test_ratios(rows):
    (line,) = demo.against_paper(rows)
    assert float(line["ratio"]) > 5
    peers = list(demo.against_peer(rows))
    for line in peers:
        assert "not equal" not in line["energies apart"]
        assert int(line["on the finest mesh"]) <= int(line["steps, ngcloth"])
    assert len(peers) == sum(row["curve"] == demo.PEER for row in rows)
    (line,) = demo.growth(rows)
    assert (line["scene"], line["exponent of time"]) == ("hemisphere, ks = 1", "–")


def test_exponents():
    """Time like n², memory beyond the imports like n; meshes below 2000 unknowns do not count."""
    lines = [
        {
            "scene": "a",
            "curve": demo.DEFAULT,
            "maxh": 1 / n,
            "triangles": n // 8,
            "dofs": n,
            "newton_steps": 20,
            "last_mesh_steps": 10,
            "cpu_seconds": 1e-6 * n**2 if n > 1000 else 5.0,
            "peak_megabytes": 120 + 1e-3 * n,
            "import_megabytes": 120,
            "reason": "CONVERGED" if n < 50000 else "STEP_BUDGET",
        }
        for n in (64000, 1000, 4000, 16000)
    ]
    (line,) = demo.growth(lines)
    assert line["exponent of time"] == "2.00" and line["of memory"] == "1.00"
    assert line["triangles"] == "125, 500, 2000, 8000"
    assert line["on the finest mesh"] == "10, 10, 10, (10)"


def test_steps_on_the_last_mesh():
    scene = measuring.SCENES["hemisphere, ks = 1"]()
    result = measuring.ngcloth.solve(scene, maxh=0.1)
    fine = [row for row in result.history if row.phase != "coarse"]
    assert len(fine) <= result.last_mesh_iterations < result.newton_iterations


def test_profile():
    """Disjoint parts make the whole; matrices and systems take most of it."""
    parts, total, steps = measuring.profile("hemisphere, ks = 1", 0.07)
    assert sum(parts.values()) == pytest.approx(total)
    assert min(parts.values()) >= 0 and parts["rest"] < 0.2 * total and steps > 5
    assert parts["matrix"] + parts["factorisation, solution"] > 0.2 * total


def test_linearisations():
    """Both take the same steps; lines have their milliseconds and seconds."""
    lines = list(demo.linearisations({"hemisphere, ks = 1": 0.3}))
    assert [line["linearisation"] for line in lines] == ["automatic", "closed form"]
    assert lines[0]["Newton steps"] == lines[1]["Newton steps"] > 5
    assert all(float(line["ms, a Newton matrix"]) > 0 for line in lines)


def test_cold_start():
    imports, first, second = measuring.cold_start(times=1)
    assert imports > 0 and second > 0 and first > 0


def test_exact_net():
    """At order 8 the hemisphere's net, by its own equation, is met to 1e-6 everywhere."""
    row, probes = measuring.solve("hemisphere, Chebyshev", "order 8", order=8, maxh=0.3)
    assert row["energy"] == pytest.approx(2.0e-13, rel=0.1)
    found = measuring.errors(row, probes, measuring.exact("hemisphere, Chebyshev"))
    assert found["energy_error"] == row["energy"]
    assert found["outline_error"] < 5e-7 and found["stretch_error"] < 1e-6


def test_budget():
    row, _ = measuring.solve(
        "hemisphere, ks = 1", demo.PAPER, maxh=0.4, schedule="paper", cpu_budget=0
    )
    assert row["reason"] == "CALLBACK" and row["newton_steps"] < 50


def test_outline_does_not_feel_a_shift(rows):
    outline = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    one = {"outline": outline - outline.mean(axis=0), "stretch": np.ones((1, 2))}
    found = measuring.errors(rows[0], one, (rows[0], {**one, "stretch": np.full((1, 2), 1.1)}))
    assert found == pytest.approx({"energy_error": 0, "outline_error": 0, "stretch_error": 0.1})


def test_files(rows, tmp_path, monkeypatch):
    monkeypatch.setattr(demo, "run", lambda *args, **kwargs: rows)
    apart = {"Cold start": [{"ratio": "1.5", "import": "1.23"}]}
    monkeypatch.setattr(demo, "measured_apart", lambda *args: apart)
    demo.main("--quick", str(tmp_path))
    with open(tmp_path / "work_precision.csv", newline="") as file:
        read = list(csv.DictReader(file))
    assert [float(row["energy"]) for row in read] == pytest.approx([row["energy"] for row in rows])
    text = (tmp_path / "work_precision.md").read_text(encoding="utf-8")
    assert "## Cold start\n\n| ratio | import |\n| --- | --- |\n| 1.5 | 1.23 |" in text
    assert "Omissions and tweaking" in text and f"ngsolve {demo.ngs.__version__}" in text
    (plot,) = tmp_path.glob("*.png")
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_readme_quotes_the_report():
    docs = DEMOS.parent / "docs" / "work_precision.md"
    table = docs.read_text(encoding="utf-8").split("## In short\n\n")[1].split("\n\n")[0]
    assert table.count("\n") >= 5
    assert table in (DEMOS.parent / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def head(tmp_path_factory):
    folder = tmp_path_factory.mktemp("head")
    against_build.extract("HEAD", folder)
    return folder


def test_a_build_against_itself(head, monkeypatch):
    monkeypatch.setattr(against_build, "ROUNDS", 1)
    wanted = [
        ("hemisphere, ks = 1", {"maxh": 0.4, "barrier_end": 1e-2}),
        ("hemisphere, Chebyshev", {"maxh": 0.4}),
    ]
    rows = against_build.compare((head, head), wanted, certificate=True)
    *lines, total = against_build.table(("a", "b"), wanted, rows, certificate=True)
    assert [line["scene"] for line in lines] == [scene for scene, _ in wanted]
    assert lines[0]["settings"] == "maxh 0.4, barrier_end 0.01"
    for line in lines:
        assert line["steps, a"] == line["steps, b"] and int(line["steps, a"]) > 2
        assert line["E, a"] == line["E, b"]
    for build in "ab":
        seconds = [float(line[f"total, s, {build}"]) for line in lines]
        assert float(total[f"total, s, {build}"]) == pytest.approx(sum(seconds), abs=2e-3)
        assert min(seconds) > 0
    ratio = float(total["total, s, b"]) / float(total["total, s, a"])
    assert float(total["total, ratio"]) == pytest.approx(ratio, abs=0.02)


def test_each_build_solves_by_its_own_tree(head, tmp_path, monkeypatch):
    """One that always ends at a strong barrier takes fewer steps, to a higher energy."""
    monkeypatch.setattr(against_build, "ROUNDS", 1)
    shutil.copytree(head, tmp_path, dirs_exist_ok=True)
    with open(tmp_path / "ngcloth" / "__init__.py", "a") as file:
        file.write("\nweak = solve\ndef solve(*a, **k): return weak(*a, **k, barrier_end=0.5)\n")
    scene = "hemisphere, ks = 1"
    ((one,), (other,)) = against_build.compare((head, tmp_path), [(scene, {"maxh": 0.4})])[0]
    assert other["steps"] < one["steps"] and other["energy"] > 1.001 * one["energy"]
    with pytest.raises(RuntimeError, match="was imported"), against_build.build(DEMOS):
        pass


def test_solves_against_builds():
    """Those of the report's default and of order 2, or two coarse meshes of each scene."""
    every, quick = against_build.solves(), against_build.solves(quick=True)
    assert {scene for scene, _ in every} == {scene for scene, _ in quick} == set(measuring.SCENES)
    assert len(quick) == 22 < len(every)
    assert ("hemisphere, ks = 1", {"maxh": 0.1, "order": 2, "barrier_end": 1e-5}) in every
    assert all(settings.get("order", 2) == 2 for _, settings in every)
