"""Parts of pages: the files that they are made of, data in scripts, and tables of numbers."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterable
from html import escape
from importlib.resources import files
from typing import Any

import numpy as np

from crinoid.report.charts.summary import Summary

_SCRIPTS = ("unpack", "space", "camera", "paint", "scene", "charts", "main")


def policy_of(scripts: Iterable[str]) -> str:
    """Return what a page may load: its own scripts by their digests, and nothing else."""
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


def own_script() -> str:
    """Return the script of the pages."""
    parts = "\n".join(part(f"{name}.js") for name in _SCRIPTS)
    return f'"use strict";\n(() => {{\n{parts}\n}})();'


def _digest(text: str) -> str:
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")


def part(name: str) -> str:
    """Return the text of a file of the pages."""
    return (files("crinoid.report.page") / name).read_text(encoding="utf-8")
