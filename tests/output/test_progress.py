"""The progress bar: where it is drawn, what it says, and that it takes nothing from the log."""

import io
import re
import sys

import numpy as np
import pytest

import ngcloth
from ngcloth import __main__ as cli
from ngcloth.output.progress import ProgressBar
from ngcloth.scenes import hemisphere


class Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.fixture
def put_at_terminal(monkeypatch):
    """To be called in the test: pytest puts its own stderr back after the fixtures."""

    def put():
        monkeypatch.setattr(sys, "stderr", Terminal())
        return sys.stderr

    return put


def shown(stream):
    """The states of the bar, {step: (μ, percent)}, as they were drawn."""
    pattern = r"μ (\S+), residual \S+, step (\d+) +(\d+)% \|"
    found = re.findall(pattern, stream.getvalue())
    return {int(step): (float(mu), int(percent)) for mu, step, percent in found}


def test_the_bar_follows_the_barrier_down(put_at_terminal):
    terminal = put_at_terminal()
    with ProgressBar() as bar:
        result = ngcloth.solve(hemisphere(10.0), maxh=0.35, barrier_end=1e-2, callback=bar)
    states = shown(terminal)
    assert list(states) == [row.newton for row in result.history]
    # From the first μ to 1e-2, in decades, whatever the steps in between.
    first = result.history[0].mu
    assert len({mu for mu, _ in states.values()}) > 2
    for mu, percent in states.values():  # the μ shown has one digit
        assert percent == pytest.approx(100 * np.log(first / mu) / np.log(first / 1e-2), abs=4)
    assert terminal.getvalue().endswith("\r")  # taken away at the end


def test_lines_stay_whole_above_the_bar(put_at_terminal, capsys):
    terminal = put_at_terminal()
    with ProgressBar() as bar:
        result = ngcloth.solve(hemisphere(10.0), maxh=0.5, callback=bar, log=bar.print)
    lines = capsys.readouterr().out.splitlines()
    rows = [line for line in lines if " barrier " in line]
    assert rows == list(map(str, result.history)) and shown(terminal)


def test_every_solve_has_its_own_bar(put_at_terminal):
    terminal = put_at_terminal()
    with ProgressBar() as bar:
        for end, full in ((1e-1, 100), (1e-3, 0)):
            settings = {"maxh": 0.5, "order": 2, "barrier_end": end, "max_steps": 6}
            ngcloth.solve(hemisphere(1.0), callback=bar, **settings)
            assert max(percent for _, percent in shown(terminal).values()) >= full
            terminal.truncate(0)
            terminal.seek(0)


def test_silent_without_terminal_or_barrier(put_at_terminal, capsys):
    with ProgressBar() as bar:
        ngcloth.solve(hemisphere(10.0), maxh=0.5, callback=bar)
    assert capsys.readouterr() == ("", "")
    terminal = put_at_terminal()
    with ProgressBar() as bar:
        ngcloth.solve(hemisphere(), maxh=0.5, callback=bar)
    assert terminal.getvalue() == ""


def test_taken_up_again_where_it_was(put_at_terminal, tmp_path):
    terminal = put_at_terminal()
    settings = {"maxh": 0.35, "barrier_end": 1e-2, "checkpoint": tmp_path / "run.npz"}
    cut = ngcloth.solve(hemisphere(10.0), max_steps=3, **settings)
    with ProgressBar() as bar:
        ngcloth.solve(hemisphere(10.0), callback=bar, **settings)
    states = shown(terminal)
    assert min(states) > 3
    first, last = cut.history[0].mu, cut.history[-1].mu
    done = 100 * np.log(first / last) / np.log(first / 1e-2)
    assert states[min(states)][1] >= int(done) > 10  # not from 0 %


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm", None)
    with pytest.raises(ImportError, match=r"ngcloth\[progress\]"):
        ProgressBar()


@pytest.mark.parametrize(
    ("options", "there", "drawn"),
    [([], True, True), ([], False, False), (["--quiet"], True, False)],
)
def test_the_command_line_draws_it_if_it_can(
    options, there, drawn, put_at_terminal, monkeypatch, tmp_path, capsys
):
    terminal = put_at_terminal()
    monkeypatch.setattr(cli, "FILES", {})
    if not there:
        monkeypatch.setitem(sys.modules, "tqdm", None)
    arguments = ["hemisphere", "--ks", "10", "--maxh", "0.5", "--out", str(tmp_path), *options]
    assert cli.main(arguments) == 0
    assert bool(shown(terminal)) == drawn
    assert ("  barrier  " in capsys.readouterr().out) == (not options)
    assert "ngcloth:" not in terminal.getvalue()  # tqdm is not missed
