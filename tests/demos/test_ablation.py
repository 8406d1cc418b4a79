"""The ablation table: complete, each change made and undone, failures counted as the budget."""

import sys
from concurrent.futures import Executor, Future

import pytest
from loading import DEMOS

sys.path.insert(0, str(DEMOS))  # the demo imports its rows as a script does
import ablation

from ngcloth import scenes
from ngcloth.solver import start

TINY = [
    ablation.Solve("taut", lambda: scenes.hemisphere(ks=1), {"maxh": 0.3}, "CONVERGED"),
    ablation.Solve("net", lambda: scenes.hemisphere(), {"maxh": 0.3}, "CONVERGED"),
]


class Here(Executor):
    """Runs each task in this process, before the next thing happens."""

    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future


def test_no_constant_is_forgotten():
    for module, constants in ablation.CONSTANTS.items():
        assert set(constants) == {name for name in vars(module) if name.isupper()}


def test_solves():
    names = [solve.name for solve in ablation.solves()]
    assert len(set(names)) == len(names) >= 60


def test_each_change_is_made_and_undone():
    for (name, how), (owner, attribute, value) in ablation.changes().items():
        before = getattr(owner, attribute)
        assert value != before, (name, how)
        with ablation.changed(owner, attribute, value):
            assert getattr(owner, attribute) is value
        assert getattr(owner, attribute) is before


def test_a_change_reaches_modules_that_import_what_is_changed():
    before = ablation.interior_point.near_start
    with ablation.changed(start, "near_start", None):
        assert ablation.interior_point.near_start is None
    assert ablation.interior_point.near_start is before


def test_fractions_near_one_are_scaled_from_there():
    assert ablation.scaled(0.97, 2) == pytest.approx(0.94)
    assert ablation.scaled(5, 0.5) == 2 and ablation.scaled(-0.1, 2) == -0.2


def test_a_change_costs_steps_and_a_failure_the_budget():
    base = ablation.outcomes(ablation.BASE, TINY)
    assert not ablation.failures(TINY, base)
    for key in (("NEARLY", "off"), ("DAMPING", "doubled")):  # of one each
        assert [one.steps for one in ablation.outcomes(key, TINY)] != [one.steps for one in base]
    impossible = [TINY[0]._replace(expected="SINGULAR"), TINY[1]]
    found = ablation.outcomes(ablation.BASE, impossible)
    line = ablation.line(ablation.BASE, impossible, found, base)
    assert line["failures"] == 1 and line["steps"] == ablation.BUDGET + base[1].steps


def test_a_worse_minimum_is_told():
    base = ablation.outcomes(ablation.BASE, TINY[:1])
    found = [base[0]._replace(energy=1.01 * base[0].energy)]
    assert len(ablation.higher(TINY[:1], found, base)) == 1
    assert ablation.higher(TINY[:1], base, base) == []


def test_page(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(ablation, "ProcessPoolExecutor", lambda *_, **__: Here())
    monkeypatch.setattr(ablation, "solves", lambda: TINY)
    monkeypatch.setattr(ablation, "CONSTANTS", {ablation.start: {"RIGID_STEPS": 0}})
    monkeypatch.setattr(ablation, "PAGE", tmp_path / "ablation.md")
    ablation.main()
    text = ablation.PAGE.read_text(encoding="utf-8")
    assert "| RIGID_STEPS | start | off: 30 → 0 |" in text and "- failures: solves" in text
    assert text.count("\n| ") == 2 + 1 + 3 + len(ablation.BRANCHES)
    ablation.PAGE.unlink()
    capsys.readouterr()
    ablation.main("--only", "filter")
    assert not ablation.PAGE.exists()  # it would not be the whole table
    assert capsys.readouterr().out.count("\n| filter | Filter | off |") == 1
    with pytest.raises(SystemExit, match="none of RIGID_STEPS"):
        ablation.main("--only", "nothing")
