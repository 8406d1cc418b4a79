"""The stability table: three rows by default, a tenth of it as a slow test."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from loading import DEMOS

sys.path.insert(0, str(DEMOS))  # the demo imports its rows as a script does
import stability
import stability_page
from stability_cases import EXPLANATIONS, SOLVES, cases

CASES = {(case.axis, case.value): case for case in cases()}
SCRIPT = """
import json, os, signal, sys, time
import stability
from stability_cases import Case, cases
CASES = {{(case.axis, case.value): case for case in cases()}}
print(json.dumps({expression}, default=float))
"""


def rows(cases):
    """Rows of an expression for cases."""
    return value(f"[stability.run(case) for case in {cases}]")


def value(expression):
    """What an expression is in a fresh process: forks of one with threads may hang."""
    root = str(Path(DEMOS).parent)
    out = subprocess.run(
        [sys.executable, "-c", SCRIPT.format(expression=expression)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([root, str(DEMOS)])},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=300,
    )
    return json.loads(out.stdout.splitlines()[-1])


def test_the_table_covers_the_axes():
    assert len(CASES) == len(cases()) >= 100
    axes = " ".join(axis for axis, _ in CASES)
    for word in (
        "ks/kc kc1/kc2 scale barrier_end γmax portion height ellipsoid bump stretched sheared "
        "maxh order start turn noise"
    ).split():
        assert word in axes
    assert set(EXPLANATIONS) <= set(CASES)


def test_the_patch_does_not_depend_on_the_unit_of_stiffness():
    axis = "scale of kc = ks"
    soft, hard = rows(f"[CASES[{axis!r}, value] for value in ('1e-09', '1e+09')]")
    assert soft["outcome"] == hard["outcome"] == "CONVERGED"
    assert soft["newton_steps"] == hard["newton_steps"]
    for name in ("energy", "stretch_min", "stretch_max", "shear_max"):
        assert soft[name] == pytest.approx(hard[name], rel=1e-9)
    assert not any(map(stability.wrong, (soft, hard)))


def test_a_bad_start_is_refused():
    (refused,) = rows("[CASES['bad starts', '(-0.5, 0.5), inverted']]")
    assert refused["outcome"].startswith("InputError: start = (-0.5, 0.5): J = det")
    assert not stability_page.failed(refused)


def test_a_crash_and_a_hang_are_rows():
    crash = "Case('none', 'crash', lambda: os.kill(os.getpid(), signal.SIGSEGV))"
    hang = "Case('none', 'hang', lambda: time.sleep(60), limit=1)"
    crashed, hung = rows(f"[{crash}, {hang}]")
    assert crashed["outcome"].startswith("crash, exit code -")
    assert hung["outcome"] == "not ended in 1 s"
    assert stability_page.failed(crashed) and stability_page.failed(hung)


def counted(axes, steps):
    """Cases of some axes with limits, and rows that say they converge in ever more steps."""
    chosen = [case for case in cases() if case.axis in axes]
    rows = [
        dict.fromkeys(stability.COLUMNS, "")
        | {"axis": case.axis, "value": case.value, "expected": case.expected}
        | {"outcome": "CONVERGED", "certificate": "certified", "newton_steps": number}
        for number, case in zip(steps, chosen, strict=False)
    ]
    return rows, chosen[: len(rows)]


def test_rows_that_lack_a_finer_mesh_are_solved_on_one():
    """The Chebyshev net of 83 % of the sphere, its threads nearly on one line, is resolved then."""
    case = "CASES['portion of the sphere, Chebyshev', '0.83']"
    coarse, fine = value(f"[stability.run({case}), stability.on_finer_meshes({case})]")
    assert stability.uncertified(coarse) and "the mesh leaves" in coarse["certificate"]
    assert fine["certificate"] == "certified" and fine["maxh"] < 0.5 * coarse["maxh"]
    assert fine["energy"] < 0.1 * coarse["energy"]


def test_rows_that_no_mesh_mends_are_left():
    refused, overlaps = "the mesh leaves 0.06 of the stress unbalanced", "the rim meets itself"
    for axis, certificate, retried in (
        ("order, Chebyshev", refused, True),
        ("order, Chebyshev", "certified", False),
        ("order, Chebyshev", overlaps, False),
        ("maxh, Chebyshev", refused, False),
    ):
        (row,), chosen = counted([axis], [7])
        row["certificate"] = certificate
        assert stability.for_finer_meshes([row], chosen) == [(row, chosen[0])] * retried


def test_the_rows_of_steep_axes_with_limits_go_to_ipopt():
    portions, heights = (
        "portion of the sphere, γmax = cos π/6",
        "height of the hemicatenoid, ks = 0",
    )
    rows, chosen = counted(["γmax, hemisphere ks = 1"], [7, 8, 9, 20])
    assert stability.for_peer(rows, chosen) == []  # grows by 20/7
    rows, chosen = counted([portions], [7, 8, 9, 21])
    assert [case.value for _, case in stability.for_peer(rows, chosen)] == [
        "0.01",
        "0.05",
        "0.1",
        "0.3",
    ]
    for axis in (heights, "barrier_end, hemisphere ks = 1"):  # no limits, no optimum
        assert stability.for_peer(*counted([axis], [7, 21])) == []


def test_the_page_compares_with_ipopt():
    rows, _ = counted(["ks/kc, hemisphere"], [7, 8, 9, 30])
    assert "IPOPT" not in " ".join(stability.summary(rows))
    for row, steps in zip(rows[1:], (10, 20, "Maximum_Iterations_Exceeded"), strict=True):
        row["ipopt_steps"] = steps
    rows[1]["newton_steps"] = 11
    assert stability.growth(rows, "ipopt_steps") == {"ks/kc, hemisphere": (10, 20)}
    assert (
        "less than 3 over 1 of them. ngcloth takes more steps than IPOPT in 1 of 2 rows"
        in (stability.summary(rows)[-1])
    )


def test_ipopt_needs_more_steps_for_a_higher_bump():
    axis = "bump on a plane, ks = 1"
    low, high = value(f"[stability.peer_steps(CASES[{axis!r}, height]) for height in ('0.1', '1')]")
    assert 6 < low < high < 120


@pytest.mark.slow
def test_a_tenth_of_the_table(tmp_path):
    code = "import sys, stability; stability.main(sys.argv[1], pick=slice(0, None, 10))"
    subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(Path(DEMOS).parent), str(DEMOS)])},
        check=True,
    )
    with open(tmp_path / "stability.csv", newline="", encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    posed = [row for row in found if row["expected"] == SOLVES]
    assert not any(map(stability.wrong, found))
    assert len(found) == len(CASES) // 10 + 1
    assert sum(row["outcome"] == "CONVERGED" for row in posed) >= 0.95 * len(posed)
    assert "## Summary" in (tmp_path / "stability.md").read_text(encoding="utf-8")
