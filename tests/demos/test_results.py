"""The table of results on coarse meshes: energies, bars and slacks, and what it says of them."""

import csv
import sys

import numpy as np
import pytest
from loading import DEMOS, load

from ngcloth.result.certificate import LimitCheck


@pytest.fixture
def demo(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(DEMOS), *sys.path])
    return load("results")


def check(name, slack, tolerance=1.0):
    return LimitCheck(name, slack, tolerance, (0.0, 0.0), "")


def test_slacks_are_those_of_stretch_shear_and_pressure(demo):
    assert demo.relative_slack(check("elongation", 1 - 1 / 0.98)) == pytest.approx(-0.02)
    missed = demo.SHEAR_LIMIT**2 - (demo.SHEAR_LIMIT + 0.003) ** 2
    assert demo.relative_slack(check("shear limit", missed)) == pytest.approx(-0.003)
    assert demo.relative_slack(check("obstacle", -0.4, 1e-3 * 20)) == pytest.approx(-0.02)


def test_what_is_not_resolved_is_told(demo):
    row = dict.fromkeys(demo.COLUMNS, "") | {"reason": "CONVERGED", "certificate": "certified"}
    rows = [
        row | {"scene": name, "energy": 1.0, "energy_bar": bar, "reference": reference}
        for name, bar, reference in (("a", 0.005, 1.006), ("b", np.inf, np.nan), ("c", 0.1, 0.95))
    ]
    solved, sure, unsure, held = demo.in_short(rows)
    assert "3 of 3 solves converge, 3 are certified" in solved
    assert sure.endswith(": a.") and unsure.endswith("b (not resolved); c (± 10.0%).")
    assert "the bar holds it in 1; not in a." in held


def test_quick_run_holds_the_references_and_writes_both_files(demo, tmp_path):
    demo.main("--quick", str(tmp_path))
    with open(tmp_path / "results.csv", newline="") as file:
        rows = {row["scene"]: row for row in csv.DictReader(file)}
    assert {row["reason"] for row in rows.values()} == {"CONVERGED"}
    assert {row["certificate"] for row in rows.values()} == {"certified"}
    for name in ("hemisphere, ks/kc = 1", "hemicatenoid, ks/kc = 1"):
        energy, bar, reference = (
            float(rows[name][key]) for key in ("energy", "energy_bar", "reference")
        )
        assert abs(energy - reference) <= bar <= 1e-2 * energy
        assert len(rows[name]["chain"].split(", ")) == 2
    # A Chebyshev net covers half of the sphere without energy, below the shear limit.
    assert float(rows["sphere, p = 0.5"]["energy"]) < 1e-5
    assert all(float(row["worst_slack"]) > -1e-3 for row in rows.values())
    page = (tmp_path / "results.md").read_text(encoding="utf-8")
    assert page.count("| CONVERGED |") == len(rows)
