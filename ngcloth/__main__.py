"""From the shell: ``ngcloth hemisphere --ks 100 --maxh 0.1 --out out/``, or ``python -m ngcloth``.

Solves a scene of `ngcloth.scenes`, or covers a surface from a file: ``ngcloth part.step --ks 10``;
and writes all there is to take away into one folder. Options are the parameters of the scene and of
`ngcloth.solve`, with the help that their docstrings give. ``ngcloth study study.toml --out folder``
solves many cases.
"""

import argparse
import inspect
import os
import re
import sys
import warnings
from contextlib import nullcontext, suppress
from functools import partial
from pathlib import Path

from .errors import InputError
from .geometry import cad
from .geometry.file_surface import MESHES, UNITS, FileSurface
from .output.progress import ProgressBar
from .problem.surface import Surface
from .result.history import Reason
from .result.result import Result
from .scenes import NAMED, part
from .solver.solve import solve
from .studies import shell as study
from .version import __version__

CONVERGED, NOT_CONVERGED, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
SETTINGS = ("maxh", "order", "barrier_end", "max_steps")
PITCH = 0.1  # of the threads in threads.vtp: that of the pattern, 10 mm at 100 mm to the unit
STATUS = (
    f"exit status: {CONVERGED} converged, {NOT_CONVERGED} not converged, {BAD_INPUT} bad input or "
    f"no place to write, {INTERRUPTED} interrupted; without convergence the files hold the last "
    "good iterate"
)


def _report(result, path):
    from .output.report import report

    there = [name for name in FILES if (path.parent / name).is_file() and name != path.name]
    report(result, path, there)


def _threads(result, path):
    file = isinstance(result.scene.surface, FileSurface)
    result.export_threads(path, None if file else PITCH)


FILES = {
    "result": Result.save,
    "pattern.svg": Result.export_svg,
    "pattern.dxf": Result.export_dxf,
    "cloth.vtu": Result.export_vtu,
    "threads.vtp": _threads,
    "surface.obj": Result.export_surface,
    "fibres.csv": Result.export_fibres,
    "report.html": _report,
}


def main(argv=None):
    """Solve the scene that the command line names, and write its files.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default those of the process.

    Returns
    -------
    int
        The exit status: 0 only for a result that has converged and is written, 1 for one that has
        not converged, 2 for bad input or a file that cannot be written, 130 after Ctrl-C. Files
        hold the last good iterate, too, where the solve stopped or was interrupted after a step.

    Raises
    ------
    SystemExit
        After ``--help`` and ``--version``, with status 0, and for arguments that cannot be parsed,
        with status 2.
    """
    argv = list(sys.argv[1:] if argv is None else argv)
    if argv and Path(argv[0]).suffix.lower() in (*cad.ENDINGS, *MESHES):
        argv.insert(0, "part")
    for flag in {"--warp", "--at"}.intersection(argv[:-1]):  # a minus would look like an option
        place = argv.index(flag)
        argv[place : place + 2] = ["=".join(argv[place : place + 2])]
    arguments = _parser().parse_args(argv)
    try:
        if arguments.scene == "study":
            return NOT_CONVERGED if study.run(arguments, _say) else CONVERGED
        return _solve_and_write(arguments)
    except (InputError, OSError) as error:
        _complain(error)
        return BAD_INPUT
    except KeyboardInterrupt:
        _complain("interrupted")
        return INTERRUPTED


class _Parser(argparse.ArgumentParser):
    def error(self, message):
        self.exit(BAD_INPUT, f"{self.prog}: {message} (--help tells more)\n")


def _parser():
    parser = _Parser(
        prog="ngcloth",
        description="Find the flat patch of woven cloth that best covers a surface: solve a named "
        "scene and write result, cut pattern, fields and report.",
        epilog=STATUS,
    )
    parser.add_argument("--version", action="version", version=f"ngcloth {__version__}")
    scenes = parser.add_subparsers(dest="scene", metavar="scene", required=True)
    texts = {}
    for make in NAMED.values():
        texts |= _documented(make)
    for name, make in (NAMED | {"part": part}).items():
        summary = _plain(inspect.getdoc(make).partition("\n")[0])
        one = scenes.add_parser(name, help=summary, description=summary, epilog=STATUS)
        if make is part:
            _add_file(one)
        names = [each for each in inspect.signature(make).parameters if each != "surface"]
        group = one.add_argument_group("the scene")
        _add_options(group, make, texts | _documented(make), names)
        group = one.add_argument_group("the solve")
        _add_options(group, solve, _documented(solve), SETTINGS)
        group.add_argument("--quiet", action="store_true", help="No line for each step, no bar.")
        group = one.add_argument_group("the outcome")
        text = f"Folder for {', '.join(FILES)}. Default %(default)s."
        group.add_argument("--out", default="out", metavar="folder", help=text)
    study.add_parser(scenes)
    return parser


def _add_file(parser):
    """The arguments that choose a surface from a file."""
    group = parser.add_argument_group("the surface")
    endings = ", ".join([*cad.ENDINGS, *MESHES])
    group.add_argument(
        "file", help=f"A file of these: {endings}. 'part' may be left out before it."
    )
    text = "Numbers, from 0, or names of the faces of a CAD file to be covered. Default all."
    group.add_argument("--faces", nargs="+", metavar="face", help=text)
    text = "The unit of length of facets, and of all that is written. Default %(default)s."
    group.add_argument("--unit", choices=list(UNITS), default="mm", help=text)
    text = "On which side of the faces the cloth lies. Default %(default)s, to which most look."
    group.add_argument("--side", type=int, choices=[1, -1], default=1, help=text)


def _surface(arguments):
    """The surface that the arguments of `_add_file` choose."""
    path, options = arguments.file, {"unit": arguments.unit, "side": arguments.side}
    if Path(path).suffix.lower() in MESHES:
        if arguments.faces:
            raise InputError("faces", arguments.faces, f"none for {path}, which is not of faces")
        return Surface.from_mesh(path, **options)
    faces = [int(face) if face.isdecimal() else face for face in arguments.faces or ()]
    return Surface.from_cad(path, faces or None, **options)


def _documented(function):
    """The parameters of a function as its docstring tells them, {name: (kind, text)}."""
    section = inspect.getdoc(function).partition("Parameters\n----------\n")[2]
    section = re.split(r"\n\w+\n-+\n", section)[0]
    entries = re.findall(r"^(\w+) : (.*)\n((?: {4}.*\n?|\n)+)", section, re.MULTILINE)
    return {name: (kind.partition(",")[0], _plain(text)) for name, kind, text in entries}


def _plain(text):
    """Text of a docstring as one line for argparse."""
    return " ".join(text.replace("`", "").replace("%", "%%").split())


def _add_options(group, function, texts, names=None):
    """One option for each parameter of a function, or for those named."""
    parameters = inspect.signature(function).parameters
    for name in names or parameters:
        (kind, text), default = texts[name], parameters[name].default
        flag = "--" + name.replace("_", "-")
        if kind == "bool":
            action = argparse.BooleanOptionalAction
            group.add_argument(flag, action=action, default=default, help=text)
            continue
        if default is not None and "default" not in text.lower():
            text += " Default %(default)s."
        converter = {"float": float, "int": int, "(float": _triple}[kind]
        kind = "x,y,z" if converter is _triple else kind
        group.add_argument(flag, type=converter, default=default, metavar=kind, help=text)


def _triple(text):
    """Three numbers between commas."""
    try:
        x, y, z = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"three numbers x,y,z, not {text!r}") from None
    return x, y, z


def _solve_and_write(arguments):
    def chosen(names):
        return {name: getattr(arguments, name) for name in names}

    make = (NAMED | {"part": part})[arguments.scene]
    if make is part:
        arguments.surface = _surface(arguments)
    scene = make(**chosen(inspect.signature(make).parameters))
    folder = _checked_folder(arguments.out)
    bar = None if arguments.quiet else _progress_bar()
    log = None if arguments.quiet else partial(_say, write=bar.print) if bar else _say
    with bar or nullcontext():
        result = solve(scene, log=log, callback=bar, **chosen(SETTINGS))
    _say(result)
    if result.reason is Reason.INTERRUPTED:
        _complain("interrupted")
    else:
        _say(result.certificate())
        if not result.converged:
            _complain(f"not converged: {result.reason}")
    written, failed = _write(result, folder)
    _say(f"in {folder}: {', '.join(written)}")
    if result.reason is Reason.INTERRUPTED:
        return INTERRUPTED
    if failed:
        return BAD_INPUT
    return CONVERGED if result.converged else NOT_CONVERGED


def _progress_bar():
    """A bar below the lines, if there is a terminal to draw it on and tqdm to draw it; or None."""
    if sys.stderr.isatty():
        with suppress(ImportError):
            return ProgressBar()
    return None


def _checked_folder(out):
    """`out` as a path, after a look at whether a folder can be there."""
    if not out:
        raise InputError("out", out, "the name of a folder")
    folder = Path(out)
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
        raise InputError("out", out, f"a folder to write to; {there} is none")
    return folder


def _write(result, folder):
    """Write the `FILES`, and return the names of those that are there and of those that failed.

    A file that wants an optional package is left out, with a line that says what to install; this
    is no failure. No file of an earlier result stays beside those of this one.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written, failed = [], []
    with warnings.catch_warnings(record=True) as warned:
        for name, write in FILES.items():
            path = folder / name
            for earlier in (path, path.with_stem(path.stem + "_flat")):
                if earlier.is_file():
                    earlier.unlink()
            try:
                write(result, path)
                written.append(name)
            except ImportError as error:
                _complain(f"{name} left out: {error}")
            except (InputError, OSError) as error:
                _complain(f"{name} not written: {error}")
                failed.append(name)
    for text in dict.fromkeys(str(warning.message) for warning in warned):
        _complain(f"warning: {text}")
    return written, failed


def _say(text, write=print):
    """Print a text at once, and not in blocks, where the output goes to a file."""
    try:
        write(text)
        sys.stdout.flush()
    except OSError as error:
        _give_up(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            _complain(f"standard output: {error}")


def _complain(what):
    try:
        print("ngcloth:", *str(what).split(), file=sys.stderr, flush=True)
    except OSError:
        _give_up(sys.stderr)


def _give_up(stream):
    """Say no more where nobody reads any longer, as after ``| head``: the files are what counts."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def run():
    """The command ``ngcloth``: `main`, after a look at the streams it is to write to."""
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # closed: without a stand-in a file would take its number
            setattr(sys, name, open(os.devnull, "r+", encoding="utf-8"))
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(errors="replace")  # not every console has Greek letters
    sys.exit(main())


if __name__ == "__main__":
    run()
