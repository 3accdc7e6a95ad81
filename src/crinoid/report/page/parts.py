"""Parts of pages: the files that they are made of, data in scripts, and tables of numbers."""

import base64
import hashlib
import json
from collections.abc import Iterable
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from crinoid.report.charts.summary import Summary


def framed(
    body: str, scripts: Iterable[str], *, title: str, version: object, kind: str = ""
) -> str:
    """Return a page of a body, in HTML, with its scripts, which run by their digests only.

    ``title`` and ``version`` are text and become HTML here; ``kind`` is the class of the body.
    """
    scripts = list(scripts)
    return Template(part("frame.html")).substitute(
        policy=_policy_of(scripts),
        version=escape(str(version)),
        title=escape(title),
        style=part("page.css"),
        kind=kind,
        body=body,
        scripts="\n".join(f"<script>{text}</script>" for text in scripts),
    )


def _policy_of(scripts: list[str]) -> str:
    digests = " ".join(f"'sha256-{_digest(text)}'" for text in scripts)
    return (
        f"default-src 'none'; script-src {digests}; style-src 'unsafe-inline'; "
        "img-src data: blob:; base-uri 'none'; form-action 'none'"
    )


def table_of(found: Summary) -> str:
    """Return a table of numbers as HTML."""
    heads = "".join(f'<th scope="col">{escape(head)}</th>' for head in found.heads)
    rows = "".join(f"<tr>{_cells(row, len(found.heads))}</tr>" for row in found.rows)
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


def _cells(row: list[str], count: int) -> str:
    return "".join(f"<td>{escape(cell)}</td>" for cell in [*row, *[""] * (count - len(row))])


def list_of(title: str, lines: list[str]) -> str:
    """Return lines as a list with a title in HTML; nothing where there are none."""
    if not lines:
        return ""
    entries = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<h2>{title}</h2><ul class="notes">{entries}</ul>'


def json_of(value: Any) -> str:
    """Write JSON that no HTML parser takes for markup."""
    text = json.dumps(value, separators=(",", ":"), default=_plain, allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no JSON")


def own_script(*names: str) -> str:
    """Return a script of a page, which is made of files of some names."""
    parts = "\n".join(part(f"{name}.js") for name in names)
    return f'"use strict";\n(() => {{\n{parts}\n}})();'


def run_script() -> str:
    """Return the script that shows a run."""
    return own_script("tools", "unpack", "space", "camera", "paint", "scene", "charts", "main")


def bokeh_script() -> str:
    """Return Bokeh's own script, from the package that is installed, licence and all."""
    import bokeh

    folder = Path(bokeh.__file__).parent / "server" / "static" / "js"
    text = (folder / "bokeh.min.js").read_text(encoding="utf-8")
    return text.replace("</script", "<\\/script")


def bokeh_credit() -> str:
    """Return the line that says who draws the charts, in HTML."""
    import bokeh

    return f"Charts by Bokeh {escape(bokeh.__version__)} (BSD 3-Clause, in this file)."


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")


def part(name: str) -> str:
    """Return the text of a file of the pages."""
    return (files("crinoid.report.page") / name).read_text(encoding="utf-8")
