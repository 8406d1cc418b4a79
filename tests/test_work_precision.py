"""The work-precision demo on a tiny subset: one number, and what its closing ratios are made of."""

import importlib.util
from pathlib import Path

import pytest

PATH = Path(__file__).parent.parent / "demos" / "work_precision.py"


@pytest.fixture(scope="module")
def demo():
    spec = importlib.util.spec_from_file_location("work_precision", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rows(demo):
    return demo.run(meshes={2: (0.2,), 8: (0.3,)}, paper_meshes=(0.4,))


def test_rows(demo, rows):
    assert [tuple(row) for row in rows] == 3 * [tuple(demo.COLUMNS)]
    assert [row["reason"] for row in rows] == 3 * ["CONVERGED"]
    assert rows[1]["energy"] == pytest.approx(2.0e-13, rel=0.1)
    assert rows[1]["outline_error"] < 5e-7
    assert rows[2]["newton_steps"] > 10 * rows[0]["newton_steps"]


def test_quickest(demo, rows):
    assert demo.quickest(rows, 1e-3, order=2) is rows[0]
    assert demo.quickest(rows, 1e-12) is rows[1]
    assert demo.quickest(rows, 1e-2, "paper") is rows[2]
    assert demo.quickest(rows, 1e-20) is None


def test_plot(demo, rows, tmp_path):
    demo.plot(rows, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
