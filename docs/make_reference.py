"""The reference of the site: a page for each public name, from its docstring."""

import inspect
import re
import shutil
from enum import Enum
from operator import attrgetter
from pathlib import Path
from pydoc import locate

import ngcloth

# A title, the rooms whose public names come under it, and what else their docstrings speak of.
GROUPS = {
    "Pose a problem": (
        ("problem", "scenes", "geometry"),
        [f"scenes.{name}" for name in (*ngcloth.scenes.NAMED, "part")]
        + ["problem.kinematics.Kinematics", "geometry.cad.from_cad", "geometry.facets.from_mesh"]
        + ["geometry.cad.Face", "geometry.sheet.Sheet"],
    ),
    "Solve it": (("solver", "energy", "study"), []),
    "Trust it and take it away": (
        ("result", "output"),
        ["result.certificate.Certificate", "result.certificate.LimitCheck", "result.history.Row"]
        + [f"plot.{name}" for name in ("draw", "patch", "domain", "history", "convergence")]
        + ["plot.sample", "view.cloth", "fields.vtu", "fields.threads", "fields.surface"]
        + ["fields.fibres", "fields.element_fields", "output.pattern.cut_pattern"],
    ),
    "Compare with the exact net": (
        ("chebyshev",),
        [
            f"chebyshev.{name}"
            for name in ("ChebyshevNet", "sphere_angle", "sphere_singular_portion")
        ],
    ),
    "When something is wrong": (("errors",), []),
}
MORE = "More"


def write(*_):
    """Write the pages of the reference to `docs/reference`."""
    folder = Path(__file__).parent / "reference"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    index = ["# Reference", "", "Every public name of ngcloth, from the docstrings.", ""]
    names = []
    for title, group in grouped().items():
        index += [f"## {title}", "", *map(entry, group), ""]
        names += group
    index += ["```{toctree}", ":hidden:", "", *names, "```", ""]
    (folder / "index.md").write_text("\n".join(index), encoding="utf-8")
    for name in names:
        (folder / f"{name}.md").write_text("\n".join(page(name)), encoding="utf-8")


def grouped():
    """All names of the reference, as of ngcloth, by titles."""
    public = [name for name in ngcloth.__all__ if not inspect.ismodule(getattr(ngcloth, name))]
    rooms = {name: getattr(ngcloth, name).__module__.split(".")[1] for name in public}
    groups = {
        title: [name for name in public if rooms[name] in known] + more
        for title, (known, more) in GROUPS.items()
    }
    rest = [name for name in public if not any(name in names for names in groups.values())]
    return groups | ({MORE: rest} if rest else {})


def found(name):
    """What is called so in ngcloth; a function of the name of its module is the function."""
    try:
        return attrgetter(name)(ngcloth)
    except AttributeError:
        return locate(f"ngcloth.{name}")


def entry(name):
    """Its line of the index: a link, and the first line of its docstring."""
    summary = inspect.getdoc(found(name)).partition("\n")[0]
    summary = re.sub(r"[*_$<]", r"\\\g<0>", summary)
    return f"- [{name}]({name}.md): {summary}"


def page(name):
    """The lines of its page."""
    value = found(name)
    kind, options = "function", []
    if inspect.isclass(value):
        kind, options = "class", ["   :members:"]
        if issubclass(value, Enum):
            options.append("   :undoc-members:")
        elif not issubclass(value, Exception):
            options.append("   :inherited-members:")
    head = [f"# {name}", "", "```{eval-rst}", f".. auto{kind}:: ngcloth.{name}"]
    return [*head, *options, "```", ""]
