"""``ngcloth study study.toml``: what files may say, and how it ends."""

import csv
import sys

import pytest

import ngcloth
from ngcloth import __main__ as cli
from ngcloth.studies.shell import read

OWN = """
import ngcloth
def bowl(ks, height=0.4, fabric="net"):
    if ks < 0:
        raise RuntimeError("no such cloth")
    surface = ngcloth.Surface(lambda x, y: (x, y, height * (x**2 + y**2)), ngcloth.Disk())
    return ngcloth.Scene(surface, ngcloth.Net(ks=ks), [ngcloth.Elongation()], symmetric=True)
"""
STUDY = """
scene = "bowls:bowl"
cases = [{ks = 1.0}, {ks = 3.0, height = 0.3}, {ks = -1}]
[settings]
maxh = 1.0
order = 2
"""


@pytest.fixture
def toml(tmp_path, monkeypatch):
    """A study in a file, with a module of its own beside it."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "bowls", raising=False)
    (tmp_path / "bowls.py").write_text(OWN)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path / "study.toml"


def test_a_study_from_the_shell_in_parts(toml, capsys):
    out = toml.parent / "out"
    command = ["study", str(toml), "--out", str(out), "--processes", "1", "--part"]
    assert cli.main([*command, "1/2"]) == 1
    printed = capsys.readouterr().out
    assert "2 to solve" in printed and "1 of 2 cases converged" in printed
    assert "RuntimeError: no such cloth" in printed
    with open(out / "study.csv", newline="") as file:
        reasons = [row["reason"] for row in csv.DictReader(file)]
    assert reasons == ["converged", "not solved yet", "RuntimeError: no such cloth"]
    (toml.parent / "done.toml").write_text(STUDY.replace(", {ks = -1}", ""))
    command[1] = str(toml.parent / "done.toml")
    assert cli.main([*command[:-1], "--quiet"]) == 0
    with open(out / "study.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["converged"] for row in rows] == ["True", "True"]
    assert rows[0]["height"] == "" and float(rows[1]["height"]) == 0.3
    assert cli.main([*command[:-1], "--explain"]) == 0
    assert "to do   0" in capsys.readouterr().out


def test_progress_is_one_line_on_a_terminal(toml, capsys, monkeypatch):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    command = ["study", str(toml), "--out", str(toml.parent / "out"), "--processes", "1"]
    assert cli.main([*command, "--part", "3/3"]) == 1
    shown = capsys.readouterr().err
    assert shown.count("\n") == 1 and shown.count("\r") == 2
    assert "1 of 1 solved, 1 of them failed, 0 s left" in shown


def test_cases_are_a_list_a_grid_or_a_table(toml):
    make, cases, settings = read(toml)
    assert make.__name__ == "bowl" and settings == {"maxh": 1.0, "order": 2}
    assert cases == [{"ks": 1.0}, {"ks": 3.0, "height": 0.3}, {"ks": -1}]
    toml.write_text('scene = "hemisphere"\n[grid]\nks = [0.0, 1.0]\nsymmetric = [true, false]')
    make, cases, _ = read(toml)
    assert make is ngcloth.scenes.hemisphere and len(cases) == 4
    assert {"ks": 1.0, "symmetric": False} in cases
    (toml.parent / "cases.csv").write_text("ks,height,fabric\n1,0.5,net\n2.5,1e-1,tulle\n")
    toml.write_text('scene = "bowls:bowl"\ncases = "cases.csv"')
    assert read(toml)[1] == [
        {"ks": 1, "height": 0.5, "fabric": "net"},
        {"ks": 2.5, "height": 0.1, "fabric": "tulle"},
    ]


@pytest.mark.parametrize(
    ("argument", "text"),
    [
        ("file", "scene = "),
        ("file", "cases = [{ks = 1.0}]"),
        ("file", 'scene = "hemisphere"'),
        ("file", 'scene = "hemisphere"\ncases = []\n[grid]\nks = [1]'),
        ("file", 'scene = "hemisphere"\ncases = []\nsetting = 1'),
        ("scene", 'scene = "hemispheres"\ncases = [{ks = 1.0}]'),
        ("scene", 'scene = "bowls:bowls"\ncases = [{ks = 1.0}]'),
        ("scene", 'scene = "nowhere:bowl"\ncases = [{ks = 1.0}]'),
        ("scene", 'scene = ":bowl"\ncases = [{ks = 1.0}]'),
        ("scene", 'scene = ".bowls:bowl"\ncases = [{ks = 1.0}]'),
        ("log", 'scene = "hemisphere"\ncases = [{ks = 1.0}]\n[settings]\nlog = 1'),
        ("scene", "scene = 1\ncases = [{ks = 1.0}]"),
        ("grid", 'scene = "hemisphere"\n[grid]\nks = 1.0'),
        ("cases", 'scene = "hemisphere"\ncases = "none.csv"'),
        ("cases", 'scene = "hemisphere"\ncases = 3'),
        ("settings", 'scene = "hemisphere"\nsettings = 3\ncases = [{ks = 1.0}]'),
        ("maxh", 'scene = "hemisphere"\ncases = [{ks = 1.0}]\n[settings]\nmaxh = -1'),
        ("cases\\[0\\]\\['ks'\\]", 'scene = "hemisphere"\ncases = [{ks = nan}]'),
    ],
)
def test_files_that_say_something_else(argument, text, toml, capsys):
    toml.write_text(text)
    out = toml.parent / "out"
    assert cli.main(["study", str(toml), "--out", str(out)]) == 2
    complaint = capsys.readouterr().err
    assert complaint.startswith("ngcloth: " + argument.replace("\\", "") + " = ")
    assert not out.exists()


@pytest.mark.parametrize(
    ("argument", "text"),
    [
        ("cases = 'ks,ks'", "ks,ks\n1,2\n"),
        ("cases, line 2 of cases.csv = '1,5'", "ks\n1,5\n"),
        ("cases, line 3 of cases.csv = '1'", "ks,height\n1,2\n1\n"),
        ("cases = []", ""),
    ],
)
def test_tables_whose_rows_do_not_fit(argument, text, toml, capsys):
    """Two columns of one name, decimal commas, cells that are missing, or nothing."""
    (toml.parent / "cases.csv").write_text(text)
    toml.write_text('scene = "hemisphere"\ncases = "cases.csv"')
    assert cli.main(["study", str(toml), "--out", str(toml.parent / "out")]) == 2
    assert capsys.readouterr().err.startswith(f"ngcloth: {argument}")


def test_other_mistakes_at_the_shell(toml, tmp_path, capsys):
    for options in (["--part", "3"], ["--part", "0/2"], ["--processes", "0"], ["--out", ""]):
        assert cli.main(["study", str(toml), "--out", str(tmp_path / "out"), *options]) == 2
    assert cli.main(["study", str(tmp_path / "none.toml")]) == 2
    assert "TOML" in capsys.readouterr().err
