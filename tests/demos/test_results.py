"""The table of results on coarse meshes, and how it is extrapolated."""

import csv
import sys

import numpy as np
import pytest
from loading import DEMOS, load


@pytest.fixture
def demo(monkeypatch):
    monkeypatch.setattr(sys, "path", [str(DEMOS), *sys.path])
    return load("results")


def test_power_is_extrapolated_with_a_bar_that_holds_it(demo):
    sizes = np.array([0.2, 0.15, 0.1, 0.07])
    value, bar, q = demo.limit(sizes, 3 + 2 * sizes**1.5)
    assert value == pytest.approx(3, abs=1e-6) and q == pytest.approx(1.5)
    assert bar >= 2 * 0.07**1.5 - 1e-6


def test_scatter_is_not_extrapolated(demo):
    assert demo.limit([0.3, 0.2, 0.1, 0.05], [9, 1, 3, 2]) == (2, 2, None)
    assert demo.limit([0.3, 0.2], [1, 4]) == (4, 3, None)


def test_failed_solves_do_not_count(demo):
    rows = [
        {"scene": "a", "maxh": h, "reason": reason, "energy": energy, "area": 1.0}
        for h, reason, energy in ((0.2, "CONVERGED", 1.0), (0.1, "BLOCKED", 7.0))
    ]
    assert demo.limits(rows)["a"]["energy"][0] == 1


def test_of_several_starts_the_lowest_counts(demo):
    rows = [
        {"scene": name, "maxh": 0.2, "reason": "CONVERGED", "energy": energy, "area": 1.0}
        for name, energy in (("cap, p = 1", 2.0), ("cap, p = 1, start turned", 1.0))
    ]
    assert demo.limits(rows) == {"cap, p = 1": {"energy": (1, 0, None), "area": (1, 0, None)}}


def test_quick_run_holds_the_known_energies_and_writes_both_files(demo, tmp_path):
    demo.main("--quick", str(tmp_path))
    with open(tmp_path / "results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["reason"] for row in rows} == {"CONVERGED"}
    numbers = ("maxh", "energy", "area")
    found = demo.limits([row | {key: float(row[key]) for key in numbers} for row in rows])
    value, bar, _ = found["hemisphere, ks/kc = 1"]["energy"]
    assert abs(value - 0.1835) <= bar <= 2e-3
    value, bar, _ = found["hemicatenoid, ks/kc = 1"]["energy"]
    assert abs(value - 0.122) <= bar <= 0.02
    # A Chebyshev net covers half of the sphere without energy, below the shear limit.
    value, bar, _ = found["sphere, p = 0.5"]["energy"]
    assert abs(value) <= bar + 2e-3 and bar < 5e-3
    page = (tmp_path / "results.md").read_text(encoding="utf-8")
    assert page.count("| CONVERGED |") == len(rows)
