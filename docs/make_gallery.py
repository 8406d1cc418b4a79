"""The gallery of the site: a card and a page for each demo that `demos/README.md` numbers.

A page has the demo's own words, its picture and its source; those of `RUN` are run for it, and show
what they print and draw as well. All demos would take too long.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
import textwrap
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parent
DEMOS = DOCS.parent / "demos"
INTRODUCTION = """One question after another, in reading order. Each page has the mathematics of a
question, its picture, and the script, which you can run from a clone of the repository:
`python demos/hemisphere.py`. Sections (§) and figures (Fig.) are those of the paper; times are of
one core that had other work as well."""
RUN = ("hemisphere", "own_fabric")
ENTRY = re.compile(
    r"^\*\*\d+\. \[(?P<name>\w+)\.py\]\([^)]*\)\*\* \((?P<about>[^)]*)\)\.\s(?P<text>.*?)\n"
    r"(\n!\[[^\]]*\]\((?P<picture>[^)]*)\)|\n|\Z)",
    re.DOTALL | re.MULTILINE,
)
MOVED = (("](../docs/", "](../"), (".py)", ".md)"))  # links of demos/README.md, in the gallery


@dataclass
class Demo:
    """What `demos/README.md` says of a demo, and what the demo says itself."""

    name: str
    about: str
    text: str
    picture: str | None

    def __post_init__(self):
        self.question, _, self.answer = " ".join(self.text.split()).partition("? ")
        source = (DEMOS / f"{self.name}.py").read_text(encoding="utf-8")
        module = ast.parse(source)
        self.first = module.body[0].end_lineno + 1  # line of the source after its words
        title, _, self.words = ast.get_docstring(module).partition("\n")
        self.title = re.sub(r" \(§[^)]*\)|\.$", "", title)

    def card(self):
        """Its card of the gallery."""
        picture = [f":img-bottom: {self.picture}"] if self.picture else []
        head = [f":::{{grid-item-card}} {self.question}?", f":link: {self.name}", ":link-type: doc"]
        return [*head, *picture, "", self.answer, ":::", ""]

    def page(self):
        """Its page."""
        about = self.about[0].upper() + self.about[1:]
        lines = [f"# {self.title}", "", f"*{about} to run.*", ""]
        if self.picture:
            lines += [f"![{self.question}?]({self.picture})", ""]
        lines += [_markdown(self.words), ""]
        if self.name in RUN:
            printed, figures = self.run()
            lines += ["## What it prints", "", "```text", printed.rstrip(), "```", ""]
            lines += ["## What it draws", "", *(f"![{f}]({f})" for f in figures), ""]
        script = f"../../demos/{self.name}.py"
        lines += ["## The script", "", f"```{{literalinclude}} {script}", f":lines: {self.first}-"]
        return [*lines, "```", ""]

    def run(self):
        """What it prints, and the figures that it draws, relative to the gallery."""
        folder = DOCS / "gallery" / self.name
        folder.mkdir()
        environment = os.environ | {"MPLBACKEND": "Agg", "PYTHONIOENCODING": "utf-8"}
        done = subprocess.run(
            [sys.executable, DEMOS / f"{self.name}.py"],
            cwd=folder,
            env=environment,
            capture_output=True,
            encoding="utf-8",
        )
        if done.returncode:
            raise RuntimeError(f"{self.name}.py failed:\n{done.stderr}")
        figures = sorted(folder.rglob("*.png"))
        return done.stdout, [figure.relative_to(folder.parent).as_posix() for figure in figures]


def demos():
    """The demos by sections of `demos/README.md`, {title: list of `Demo`}."""
    text = (DEMOS / "README.md").read_text(encoding="utf-8")
    for there, here in MOVED:
        text = text.replace(there, here)
    _, *sections = re.split(r"^## ", text, flags=re.MULTILINE)
    found = {}
    for section in sections:
        title, _, rest = section.partition("\n")
        entries = [Demo(**entry.groupdict()) for entry in ENTRY.finditer(rest)]
        if entries:
            found[title] = entries
    return found


def write(*_):
    """Write the pages of the gallery to `docs/gallery`."""
    folder = DOCS / "gallery"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    index = ["# Gallery", "", INTRODUCTION, ""]
    names = []
    for title, entries in demos().items():
        index += [f"## {title}", "", "::::{grid} 1 2 2 2", ":gutter: 3", ""]
        for demo in entries:
            (folder / f"{demo.name}.md").write_text("\n".join(demo.page()), encoding="utf-8")
            index += demo.card()
            names.append(f"{demo.name.replace('_', ' ').capitalize()} <{demo.name}>")
        index += ["::::", ""]
    index += ["```{toctree}", ":hidden:", "", *names, "```", ""]
    (folder / "index.md").write_text("\n".join(index), encoding="utf-8")


def _markdown(words):
    """Text of a docstring as Markdown: what stands in by four blanks is set as it is."""
    text = re.sub(r"(^    .*\n?)+", lambda found: _fenced(found[0]), words, flags=re.MULTILINE)
    special = re.compile(r"(?s)^```.*?^```|`[^`]*`|[*_$]", re.MULTILINE)
    return special.sub(lambda found: found[0] if "`" in found[0] else f"\\{found[0]}", text)


def _fenced(lines):
    return f"```text\n{textwrap.dedent(lines).rstrip()}\n```\n"
