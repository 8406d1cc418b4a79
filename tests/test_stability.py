"""The stability table: three rows by default, a tenth of it as a slow test."""

import csv
import os
import signal
import sys
import time

import pytest
from loading import DEMOS

sys.path.insert(0, str(DEMOS))  # the demo imports its rows as a script does
import stability
from stability_cases import SOLVES, Case, cases

CASES = {(case.axis, case.value): case for case in cases()}


def row(axis, value):
    return stability.run(CASES[axis, value])


def test_the_table_covers_the_axes():
    assert len(CASES) == len(cases()) >= 100
    axes = " ".join(axis for axis, _ in CASES)
    for word in (
        "ks/kc kc1/kc2 scale barrier_end γmax portion height ellipsoid bump stretched sheared "
        "maxh order start turn noise"
    ).split():
        assert word in axes
    assert set(stability.EXPLANATIONS) <= set(CASES)


def test_the_patch_does_not_depend_on_the_unit_of_stiffness():
    soft, hard = (row("scale of kc = ks", value) for value in ("1e-09", "1e+09"))
    assert soft["outcome"] == hard["outcome"] == "CONVERGED"
    assert soft["newton_steps"] == hard["newton_steps"]
    for name in ("energy", "stretch_min", "stretch_max", "shear_max"):
        assert soft[name] == pytest.approx(hard[name], rel=1e-9)
    assert not any(map(stability.wrong, (soft, hard)))


def test_a_bad_start_is_refused():
    refused = row("bad starts", "(-0.5, 0.5), inverted")
    assert refused["outcome"].startswith("InputError: start = (-0.5, 0.5): J = det")
    assert not stability.failed(refused)


def test_a_crash_and_a_hang_are_rows(monkeypatch):
    def crash():
        os.kill(os.getpid(), signal.SIGSEGV)

    crashed = stability.run(Case("none", "crash", crash))
    assert crashed["outcome"] == f"crash, exit code {-signal.SIGSEGV}"
    monkeypatch.setattr(stability, "PATIENCE", 1)
    begin = time.monotonic()
    hung = stability.run(Case("none", "hang", lambda: time.sleep(60), limit=1))
    assert hung["outcome"] == "not ended in 1 s" and time.monotonic() - begin < 20
    assert stability.failed(crashed) and stability.failed(hung)


@pytest.mark.slow
def test_a_tenth_of_the_table(tmp_path):
    rows = stability.main(tmp_path, pick=slice(0, None, 10))
    posed = [row for row in rows if row["expected"] == SOLVES]
    assert not any(map(stability.wrong, rows))
    assert sum(row["outcome"] == "CONVERGED" for row in posed) >= 0.95 * len(posed)
    with open(tmp_path / "stability.csv", newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == len(rows)
    assert "## Summary" in (tmp_path / "stability.md").read_text(encoding="utf-8")
