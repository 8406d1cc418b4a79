"""``ngcloth study study.toml --out folder``: a study from a file, for schedulers, too."""

import csv
import itertools
import json
import sys
from importlib import import_module
from pathlib import Path

from ..errors import InputError
from ..scenes import NAMED
from .cases import checked_study_settings
from .study import Study

SUMMARY = "Solve many cases, from a TOML file; call again to go on."
FILE = """\
the file:
  scene = "hemisphere"      # or "module:function", of a module beside the file
  cases = [{ks = 1.0}, {ks = 10.0}]   # or the name of a CSV file beside it
  [grid]                    # or all combinations, in place of cases
  ks = [0.1, 1.0, 10.0]
  [settings]                # of ngcloth.solve
  maxh = 0.1

exit status: 0 all cases have converged, 1 some have not, 2 bad input or no place to write, 130
interrupted; study.csv in the folder has a row for each case.
"""


def add_parser(subparsers):
    """Add the command to those of argparse."""
    from argparse import RawDescriptionHelpFormatter

    parser = subparsers.add_parser(
        "study",
        help=SUMMARY,
        description=SUMMARY,
        epilog=FILE,
        formatter_class=RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", help="What to solve, see below.")
    text = "Folder for cases and table. Default %(default)s."
    parser.add_argument("--out", default="out", metavar="folder", help=text)
    text = "Solve the k-th of n parts of the cases, one for each job of an array, into one folder."
    parser.add_argument("--part", metavar="k/n", help=text)
    text = "How many to solve at a time. Default one for each core."
    parser.add_argument("--processes", type=int, metavar="int", help=text)
    text = "Let cases start from the nearest that is solved."
    parser.add_argument("--warm", action="store_true", help=text)
    text = "Tell what will be solved, what it will cost, and what is done; solve one case at most."
    parser.add_argument("--explain", action="store_true", help=text)
    parser.add_argument("--quiet", action="store_true", help="No line for each case.")


def run(arguments, say):
    """Do what the command line says.

    Parameters
    ----------
    arguments : Namespace
        As `add_parser` has it.
    say : callable
        Prints a line.

    Returns
    -------
    int
        The number of cases of the part that have not converged.

    Raises
    ------
    InputError
        If the file does not say what to solve.
    """
    make_scene, cases, settings = read(arguments.file)
    part = None if arguments.part is None else _part(arguments.part)
    study = Study(
        make_scene,
        cases,
        arguments.out or None,
        arguments.processes,
        warm=arguments.warm,
        part=part,
        log=None if arguments.quiet else _progress(say),
        **checked_study_settings(settings),
    )
    if arguments.explain:
        say(study.explain())
        return 0
    study.run()
    mine = study.table[slice(None) if part is None else slice(part[0] - 1, None, part[1])]
    failed = [row for row in mine if not row["converged"]]
    if not arguments.quiet and sys.stderr.isatty():
        print(file=sys.stderr)
    for row in failed:
        say(f"{row['key']}: {row['reason']}")
    say(f"{len(mine) - len(failed)} of {len(mine)} cases converged; in {arguments.out}: study.csv")
    return len(failed)


def _progress(say):
    """What prints lines of progress: each in the place of the last, on a terminal."""
    if not sys.stderr.isatty():
        return say
    return lambda line: print(f"\r{line}\x1b[K", end="", file=sys.stderr, flush=True)


def read(path):
    """What a TOML file says: the function that makes scenes, cases, and settings.

    Parameters
    ----------
    path : path
        Of the file; names in it are looked for beside it.

    Returns
    -------
    make_scene : callable
    cases : list of dict
    settings : dict

    Raises
    ------
    InputError
        If the file is not there, is no TOML, or does not say all this.
    """
    try:
        import tomllib
    except ImportError as error:
        raise InputError("file", str(path), "studies from TOML need Python 3.11") from error
    path = Path(path)
    try:
        told = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError("file", str(path), f"a TOML file ({error})") from error
    unknown = set(told) - {"scene", "cases", "grid", "settings"}
    if unknown or "scene" not in told or ("cases" in told) == ("grid" in told):
        allowed = "scene, cases or grid, and settings, and nothing else"
        raise InputError("file", str(path), allowed)
    cases = _grid(told["grid"]) if "grid" in told else told["cases"]
    if isinstance(cases, str):
        cases = _rows(path.parent / cases)
    settings = told.get("settings", {})
    if not isinstance(settings, dict):
        raise InputError("settings", settings, "a table of settings of ngcloth.solve")
    return _function(told["scene"], path.resolve().parent), cases, settings


def _function(name, folder):
    """The function of a name: one of `ngcloth.scenes`, or of a module of the user's."""
    if isinstance(name, str) and name in NAMED:
        return NAMED[name]
    allowed = f'one of {", ".join(NAMED)}, or "module:function" of a module beside the file'
    if not isinstance(name, str) or ":" not in name:
        raise InputError("scene", name, allowed)
    if str(folder) not in sys.path:  # which other processes are given, too
        sys.path.insert(0, str(folder))
    module, _, function = name.partition(":")
    if not all(part.isidentifier() for part in module.split(".")):
        raise InputError("scene", name, allowed)
    try:
        return getattr(import_module(module), function)
    except (ImportError, AttributeError) as error:
        raise InputError("scene", name, f"{allowed} ({error})") from error


def _grid(lists):
    """All combinations of lists of values, as cases."""
    if not isinstance(lists, dict) or not all(isinstance(each, list) for each in lists.values()):
        raise InputError("grid", lists, "a table of lists, one for each argument")
    return [dict(zip(lists, each, strict=True)) for each in itertools.product(*lists.values())]


def _rows(path):
    """The rows of a CSV file; cells that read as JSON are numbers, truth values or lists."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            lines = [(number, row) for number, row in enumerate(csv.reader(file), 1) if row]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError("cases", str(path), f"a CSV file ({error})") from error
    names = lines[0][1] if lines else []
    if len(set(names)) < len(names):
        raise InputError("cases", ",".join(names), f"different names at the head of {path.name}")
    for number, row in lines:
        if len(row) != len(names):
            allowed = f"{len(names)} cells separated by commas, as at the head"
            raise InputError(f"cases, line {number} of {path.name}", ",".join(row), allowed)
    return [dict(zip(names, map(_value, row), strict=True)) for _, row in lines[1:]]


def _value(cell):
    try:
        return json.loads(cell)
    except (TypeError, ValueError):
        return cell


def _part(text):
    """The numbers of ``k/n``."""
    k, slash, n = text.partition("/")
    if not (slash and k.isdecimal() and n.isdecimal()):
        raise InputError("part", text, "k/n, such as 3/10")
    return int(k), int(n)
