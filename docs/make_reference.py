"""The reference of the site: a page for each public name, and for what its docstring speaks of."""

import inspect
import re
import shutil
import sys
from enum import Enum
from operator import attrgetter
from pathlib import Path
from pydoc import locate

import ngcloth

# A title, the rooms whose public names come under it, and more names.
GROUPS = {
    "Pose a problem": (
        ("problem", "geometry", "fabrics"),
        [f"scenes.{name}" for name in (*ngcloth.scenes.NAMED, "part")],
    ),
    "Solve it": (("solver", "studies"), []),
    "Trust it and take it away": (
        ("result", "output"),
        ["result.certificate.Certificate", "result.certificate.LimitCheck", "result.history.Row"]
        + ["output.pattern.cut_pattern", "fields.element_fields"]
        + [f"plot.{name}" for name in ("draw", "patch", "domain", "history", "convergence")],
    ),
    "Compare with the exact net": (
        (),
        ["chebyshev.ChebyshevNet", "chebyshev.sphere_angle", "chebyshev.sphere_singular_portion"],
    ),
    "When something is wrong": (("errors",), []),
}
MORE = "More"
QUOTED = re.compile(r"(?<!`)`([\w.]+)`(?!`)")


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
    entries = [f"{name} <{place(name)}>" for name in names]
    index += ["```{toctree}", ":hidden:", "", *entries, "```", ""]
    (folder / "index.md").write_text("\n".join(index), encoding="utf-8")
    for name in names:
        (folder / f"{place(name)}.md").write_text("\n".join(page(name)), encoding="utf-8")


def grouped():
    """All names of the reference, as of ngcloth, by titles."""
    public = [name for name in ngcloth.__all__ if not inspect.ismodule(getattr(ngcloth, name))]
    rooms = {name: getattr(ngcloth, name).__module__.split(".")[1] for name in public}
    groups = {
        title: [name for name in public if rooms[name] in known] + more
        for title, (known, more) in GROUPS.items()
    }
    groups[MORE] = [name for name in public if all(name not in group for group in groups.values())]
    listed = {id(found(name)) for group in groups.values() for name in group}
    for group in groups.values():
        for name in group:  # which grows
            for other in spoken_of(name):
                if id(found(other)) not in listed:
                    listed.add(id(found(other)))
                    group.append(other)
    return {title: group for title, group in groups.items() if group}


def found(name):
    """What is called so in ngcloth; a function of the name of its module is the function."""
    try:
        return attrgetter(name)(ngcloth)
    except AttributeError:
        return locate(f"ngcloth.{name}")


def spoken_of(name):
    """Names, as of ngcloth, of the classes and functions in quotes in its docstrings."""
    value = found(name)
    members = inspect.getmembers(value) if inspect.isclass(value) else ()
    text = "\n".join(inspect.getdoc(each) or "" for each in (value, *dict(members).values()))
    module = vars(sys.modules[value.__module__])
    for quoted in dict.fromkeys(QUOTED.findall(text)):
        if quoted.startswith("ngcloth."):
            other = quoted.removeprefix("ngcloth.")
        elif quoted[0].isupper() and hasattr(module.get(quoted), "__qualname__"):
            other = f"{module[quoted].__module__}.{quoted}".removeprefix("ngcloth.")
        else:
            continue
        known = found(other)
        if inspect.isclass(known) or inspect.isfunction(known) and "." not in known.__qualname__:
            yield other


def kind(name):
    """The directive of Sphinx for it."""
    return "class" if inspect.isclass(found(name)) else "function"


def place(name):
    """The name of its page: some file systems take `Study` and `study` for one."""
    return f"{kind(name)}.{name}"


def entry(name):
    """Its line of the index: a link, and the first line of its docstring."""
    summary = inspect.getdoc(found(name)).partition("\n")[0]
    summary = re.sub(r"[*_$<]", r"\\\g<0>", summary)
    return f"- [{name}]({place(name)}.md): {summary}"


def page(name):
    """The lines of its page."""
    value, options = found(name), []
    if inspect.isclass(value):
        options = ["   :members:"]
        if issubclass(value, Enum):
            options.append("   :undoc-members:")
        elif not issubclass(value, Exception):
            options.append("   :inherited-members:")
    head = [f"# {name}", "", "```{eval-rst}", f".. auto{kind(name)}:: ngcloth.{name}"]
    return [*head, *options, "```", ""]
