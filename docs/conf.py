"""Settings of Sphinx for the pages of the documentation.

sphinx-build -E -W -n --keep-going -b html docs docs/_build/html
"""

from __future__ import annotations

import os
import re
import sys
from functools import partialmethod
from pathlib import Path
from typing import Any

from docutils import nodes
from nbclient import NotebookClient
from pydantic import BaseModel
from pygments.lexers.special import TextLexer

from crinoid import __version__

project = "crinoid"
project_copyright = author = "The crinoid developers"
version = release = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = ["gallery.js"]
html_title = f"crinoid {version}"
html_show_sphinx = False
highlight_language = "none"
toc_object_entries_show_parents = "hide"

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4  # as GitHub makes them

# the tutorials: pages with code that runs; a page that has not changed keeps its output
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
# without execution MyST-NB does not know the language of the cells
suppress_warnings = ["myst-nb.lexer"]
nb_merge_streams = True
# outputs arrive in chunks, which MyST-NB alone joins by line breaks
NotebookClient.__init__ = partialmethod(NotebookClient.__init__, coalesce_streams=True)
os.environ["TTY_COMPATIBLE"] = "0"  # no progress bars, which a kernel asks for
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])

default_role = "py:obj"
nitpick_ignore_regex = [
    # other projects: links to them take their indexes, which each build would have to fetch
    (
        r"py:.*",
        r"(collections|control|enum|equinox|gymnasium|jax|jaxlib|jaxtyping|matplotlib|numpy|os|pathlib|pydantic"
        r"|xarray)\..*",
    ),
    (r"py:.*", r"(types|typing)\..*|(np\.)?ndarray|Array|Axes|Bool|Float|Int|PPoly|NoneType"),
    # types of arguments that no user makes (names in docstrings are py:obj)
    (r"py:class", r"crinoid\.dynamics\..*"),
    (r"py:class", r"crinoid\.scenario\.(sensor\.Reading|vehicle\.Hull)|Builder|Numbers|Source"),
    (r"py:class", r"crinoid\.scenario\.actuator\.(Chamber|Tendon)"),
    (r"py:class", r"crinoid\.(flow\.currents\.Shear|elements\.(rigid\..*|elastic\.Elastic))"),
    (
        r"py:class",
        r"crinoid\.elements\.(material\.Strained|oscillators\.Oscillation|tendon_friction\..*)",
    ),
    (
        r"py:class",
        r"crinoid\.simulation\.loop\..*|crinoid\.actuation\.actuator\.Actuators|crinoid\.rod\.section\.Rod",
    ),
    (r"py:class", r"crinoid\.control\.(braking|hybrid|lqg|mpc|neural|observer|policy|qp)\..*"),
    (r"py:class", r"(crinoid\.assembly\.response\.)?ResponseParameters"),
    (r"py:class", r"Float\[Array|Mapping\[int|Recording|Scene|tuple\[(Sensor|float)"),
    # type variables
    (r"py:class", r"crinoid\.results\.result\.Tree|crinoid\.compilation\.program\.[PR]|P"),
]
autodoc_member_order = "bysource"
autodoc_default_options = {
    "members": True,
    "special-members": "__call__",
    "exclude-members": "model_config, model_post_init",
}
autodoc_inherit_docstrings = False
autodoc_preserve_defaults = True
autosummary_generate = False
napoleon_google_docstring = False
napoleon_attr_annotations = False  # types of fields are in the signature of their class
napoleon_use_param = False  # types of arguments are words, not links
napoleon_use_rtype = False

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "develop/contributing.md",
    "CHANGELOG.md": "develop/changelog.md",
    "CODE_OF_CONDUCT.md": "develop/conduct.md",
    "SECURITY.md": "develop/security.md",
}
"""Pages of these files, which lie outside of this folder."""


def linked(text: str, folder: Path, page: Path) -> str:
    """Return the text of a file in ``folder`` with its links as they are seen from a page."""

    def seen(found: re.Match[str]) -> str:
        path = (folder / found[1]).resolve()
        if not path.is_relative_to(ROOT) or not path.exists():
            return found[0]
        name = PAGES.get(path.relative_to(ROOT).as_posix())
        to = ROOT / "docs" / name if name else path
        return f"]({Path(os.path.relpath(to, page.parent)).as_posix()}"

    return re.sub(r"\]\(([\w./-]+)", seen, text)


def read(app: Any, docname: str, source: list[str]) -> None:
    """Mend the links of a page of this folder."""
    page = Path(app.env.doc2path(docname))
    if page.suffix == ".md":
        source[0] = linked(source[0], page.parent, page)


def included(app: Any, path: Path, docname: str, source: list[str]) -> None:
    """Mend the links of a file that a page includes."""
    page = Path(app.env.doc2path(app.env.docname))  # MyST gives the page without its folder
    source[0] = linked(source[0], (ROOT / "docs" / path).parent, page)


def plain(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep napoleon from taking the words before a colon for the type of a field."""
    if what == "data" and lines[:1] == (type(obj).__doc__ or "").splitlines()[:1]:
        lines.clear()  # of tuples in general
    if what in {"attribute", "data", "property"}:
        lines[:0] = ["..", ""]


def keys(
    app: Any, what: str, name: str, obj: Any, options: Any, signature: str, returns: str
) -> tuple[str, str] | None:
    """Show the keys of a table without types, which its fields say in many words."""
    if not (what == "class" and issubclass(obj, BaseModel)):
        return None
    fields = [f"{key}{'' if f.is_required() else '=...'}" for key, f in obj.model_fields.items()]
    return f"({', '.join(['*', *fields] if fields else [])})", returns


def short(app: Any, doctree: nodes.document) -> None:
    """Name the arrays of JAX as one imports them."""
    for text in list(doctree.findall(nodes.Text)):
        if "jaxlib._jax." in text:
            text.parent.replace(text, nodes.Text(text.replace("jaxlib._jax.", "")))


def lined(app: Any, doctree: nodes.document) -> None:
    """Mark blocks of tables with lines, which do not wrap."""
    for block in doctree.findall(nodes.literal_block):
        if "\N{BOX DRAWINGS HEAVY HORIZONTAL}" in block.astext():
            block["classes"].append("lined")


def setup(app: Any) -> None:
    """Connect the functions above."""
    app.add_lexer("csv", TextLexer)
    app.connect("autodoc-process-docstring", plain, priority=400)  # before napoleon
    app.connect("autodoc-process-signature", keys)
    app.connect("doctree-read", short)
    app.connect("doctree-read", lined)
    app.connect("source-read", read)
    app.connect("include-read", included)
