"""Settings of Sphinx for the pages of the documentation.

sphinx-build -E -W -n --keep-going -b html docs docs/_build/html
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from docutils import nodes
from pydantic import BaseModel
from pygments.lexers.special import TextLexer

from crinoid import __version__

project = "crinoid"
project_copyright = author = "The crinoid developers"
version = release = __version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"crinoid {version}"
html_show_sphinx = False
highlight_language = "none"
toc_object_entries_show_parents = "hide"

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4  # as GitHub makes them

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
    (r"py:class", r"crinoid\.scenario\.(sensor\.Reading|body\.Hull)|Builder|Numbers|Source"),
    (
        r"py:class",
        r"crinoid\.elements\.(material\.Strained|vortices\.Oscillation|tendon_friction\..*)",
    ),
    (
        r"py:class",
        r"crinoid\.simulation\.loop\..*|crinoid\.actuation\.actuator\.Actuators|crinoid\.rod\.section\.Rod",
    ),
    (r"py:class", r"crinoid\.control\.(braking|hybrid|lqg|mpc|neural|observer|policy|qp)\..*"),
    (r"py:class", r"Float\[Array|Mapping\[int|Recording|tuple\[(Sensor|float)"),
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
napoleon_use_rtype = False

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "CODE_OF_CONDUCT.md": "conduct.md",
    "SECURITY.md": "security.md",
}
"""Pages of these files, which lie outside of this folder."""


def linked(text: str, folder: Path) -> str:
    """Return the text of a file in ``folder`` with its links as they are seen from this folder."""

    def seen(found: re.Match[str]) -> str:
        path = (folder / found[1]).resolve()
        if not path.is_relative_to(ROOT) or not path.exists():
            return found[0]
        page = PAGES.get(path.relative_to(ROOT).as_posix())
        return f"]({page or Path(os.path.relpath(path, ROOT / 'docs')).as_posix()}"

    return re.sub(r"\]\(([\w./-]+)", seen, text)


def read(app: Any, docname: str, source: list[str]) -> None:
    """Mend the links of a page of this folder."""
    if app.env.doc2path(docname).suffix == ".md":
        source[0] = linked(source[0], ROOT / "docs")


def included(app: Any, path: Path, docname: str, source: list[str]) -> None:
    """Mend the links of a file that a page includes."""
    source[0] = linked(source[0], (ROOT / "docs" / path).parent)


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


def setup(app: Any) -> None:
    """Connect the functions above."""
    app.add_lexer("csv", TextLexer)
    app.connect("autodoc-process-docstring", plain, priority=400)  # before napoleon
    app.connect("autodoc-process-signature", keys)
    app.connect("doctree-read", short)
    app.connect("source-read", read)
    app.connect("include-read", included)
