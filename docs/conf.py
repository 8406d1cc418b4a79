"""The site: ``sphinx-build -W -n docs build/docs``."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]
# Demos and the tour, in processes of their own, import this ngcloth, too.
os.environ["PYTHONPATH"] = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])

import make_gallery  # noqa: E402
import make_reference  # noqa: E402

import ngcloth  # noqa: E402

project = "ngcloth"
version = release = ngcloth.__version__
extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx-mathjax-offline",  # equations without a network
]
html_theme = "furo"
html_title = f"ngcloth {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_show_sourcelink = html_copy_source = False
pygments_style = "friendly"

# Pages: they are read on GitHub, too, hence ```math and links to files of the repository.
myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3

# The tour is run at every build, where its files do not stay.
nb_execution_mode = "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
nb_merge_streams = True
nb_output_stderr = "remove"  # remarks of other packages, with paths of the machine

# The reference: docstrings name what they speak of in `single backquotes`, parameters included.
default_role = "py:obj"
autodoc_member_order = "bysource"
autodoc_typehints = "none"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False


# Names that have no page: of parameters and constants, and some more.
nitpick_ignore_regex = [("py:obj", r"[a-z_0-9]+|[A-Z_]+|ngcloth\.plot\.LABELS|ngcloth\.scenes")]
nitpick_ignore = [("py:obj", "SymbolicEnergy")]


def escaped(app, what, name, obj, options, lines):
    """|γ| in a docstring is no substitution."""
    lines[:] = [line.replace("|", r"\|") for line in lines]


def from_ngcloth(app, env, node, contnode):
    """`Result.plot` in a docstring is that of ngcloth, `Surface.side` on the page of `Surface`."""
    target, python = node["reftarget"], env.get_domain("py")
    if node["refdomain"] != "py" or target.startswith("ngcloth."):
        return None
    node["refspecific"] = target[0].isupper()  # of any module
    names = [target, target.partition(".")[0]] if target[0].isupper() else [f"ngcloth.{target}"]
    to = env, node["refdoc"], app.builder, "obj"
    found = (python.resolve_xref(*to, name, node, contnode) for name in names)
    return next((reference for reference in found if reference is not None), None)


def setup(app):
    """Write gallery and reference before pages are looked for."""
    app.connect("config-inited", make_gallery.write)
    app.connect("config-inited", make_reference.write)
    app.connect("autodoc-process-docstring", escaped)
    app.connect("missing-reference", from_ngcloth)
