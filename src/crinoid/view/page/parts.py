"""Parts of HTML pages: template files, data in scripts, and tables of numbers."""

import base64
import hashlib
import json
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from jaxtyping import Float

from crinoid.foundation.atomic_file import atomic_write
from crinoid.results.own_files import is_own
from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.scene.scene import NEAR, TRAVELS
from crinoid.results.table import RunSummary, equilibrium_summary, summary
from crinoid.view.film.settings import PRESETS, RAMPS, SPEEDS

PAGE = "report.html"


@contextmanager
def report_file(path: Path, kind: str) -> Iterator[Path]:
    """Yield a temporary file that becomes a ``kind`` of file of a report, in a new folder too."""
    if kind != "figure" and path.exists() and not is_own(path):
        raise ReportError(f"{path}: not written by crinoid. Move it away first.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            yield temporary
    except OSError as error:
        raise ReportError(f"{path}: cannot write the {kind} ({error.strerror})") from error


def save_page(text: str, path: Path) -> Path:
    """Write a page."""
    with report_file(path, "page") as temporary:
        temporary.write_text(text, encoding="utf-8")
    return path


_LEVEL = 6  # of compression


class Pack:
    """Arrays of a page, compressed in one text."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(
        self, values: Float[np.ndarray, "time ..."], step: float, low: float | None = None
    ) -> dict[str, Any]:
        """Add an array of finite numbers, and return the table by which the page unpacks it.

        Numbers are rounded to whole steps from ``low``, or from the lowest value.
        """
        least = float(values.min()) if low is None else low
        step = max(step, (float(values.max(initial=least)) - least) / 2**31)
        whole = np.rint((values - least) / step).reshape(len(values), -1)
        most = float(whole.max(initial=0.0))
        wide = next(size for size in (1, 2, 4) if most < 256**size)
        kind = np.dtype(f"<u{wide}")
        numbers = np.clip(whole, 0.0, 256.0**wide - 1).astype(kind)
        changes = np.diff(numbers, axis=0, prepend=np.zeros_like(numbers[:1]))
        planes = changes.ravel().view(np.uint8).reshape(-1, wide).T
        at, count = self._size, int(numbers.size)
        self._parts.append(planes.tobytes())
        self._size += planes.size
        sizes = {"at": at, "count": count, "row": int(numbers.shape[1]), "wide": wide}
        return sizes | {"low": least, "step": step}

    def text(self) -> str:
        """Return all arrays, compressed and in base 64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), _LEVEL)).decode("ascii")


def html_page(
    body: str, scripts: Iterable[str], *, title: str, version: object, kind: str = ""
) -> str:
    """Return a page of a body in HTML, whose scripts are allowed by their digests only.

    ``title`` and ``version`` are text and are escaped; ``kind`` is the class of the body. A live
    page may open a connection to the server that it is from.
    """
    scripts = list(scripts)
    digests = [base64.b64encode(hashlib.sha256(text.encode()).digest()) for text in scripts]
    origin = "'self'" if kind == "live" else "'none'"
    allowed = " ".join(f"'sha256-{digest.decode('ascii')}'" for digest in digests)
    return filled(
        "frame.html",
        policy=(
            f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; "
            f"connect-src {origin}; "
            "img-src data: blob:; base-uri 'none'; form-action 'none'"
        ),
        version=escape(str(version)),
        title=escape(title),
        style=read_part("page.css"),
        kind=kind,
        body=body,
        scripts="\n".join(f"<script>{text}</script>" for text in scripts),
    )


def table_of(found: RunSummary) -> str:
    """Return a table of numbers as HTML."""
    heads = "".join(f'<th scope="col">{escape(head)}</th>' for head in found.heads)
    rows = ""
    for row in found.rows:
        cells = [*row, *[""] * (len(found.heads) - len(row))]
        rows += f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"
    return f"<table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


def numbers_of(run: Result) -> str:
    """Return the main numbers of a run in HTML, and all of them folded away."""
    if run.dataset.sizes["time"] == 1:
        return table_of(equilibrium_summary(run))
    short, whole = (table_of(summary(run, full=full)) for full in (False, True))
    return f"{short}<details><summary>All numbers</summary>{whole}</details>"


def list_of(title: str, lines: list[str]) -> str:
    """Return lines as a list with a title in HTML; empty without lines."""
    if not lines:
        return ""
    entries = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<h2>{title}</h2><ul class="notes">{entries}</ul>'


def json_of(value: Any) -> str:
    """Return JSON in which an HTML parser finds no markup."""
    plain = np.generic.item  # of numbers of NumPy; refuses anything else
    text = json.dumps(value, separators=(",", ":"), default=plain, allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


_SHARED = {"PRESETS": PRESETS, "SPEEDS": SPEEDS, "RAMPS": RAMPS, "TRAVELS": TRAVELS, "ROOM": NEAR}


def join_scripts(*names: str) -> str:
    """Return a script that joins files of some names, after what pages share with films."""
    parts = "".join(f"const {name} = {json_of(value)};\n" for name, value in _SHARED.items())
    parts += "\n".join(read_part(f"{name}.js") for name in names)
    return f'"use strict";\n(() => {{\n{parts}\n}})();'


_RUN = ("tools", "unpack", "space", "camera", "paint", "scene", "charts", "main")


def run_script(*more: str) -> str:
    """Return the script that shows a run, with more files before its last."""
    return join_scripts(*_RUN, *more, "open")


def bokeh_script() -> str:
    """Return Bokeh's script from the installed package, with its licence."""
    import bokeh

    folder = Path(bokeh.__file__).parent / "server" / "static" / "js"
    text = (folder / "bokeh.min.js").read_text(encoding="utf-8")
    return text.replace("</script", "<\\/script")


def bokeh_credit() -> str:
    """Return the credit of Bokeh in HTML."""
    import bokeh

    return f"Charts by Bokeh {escape(bokeh.__version__)} (BSD 3-Clause, in this file)."


def filled(name: str, **texts: str) -> str:
    """Return a file of the pages, with texts in its places."""
    return Template(read_part(name)).substitute(texts)


def read_part(name: str) -> str:
    """Return the text of a file of the pages."""
    return (files("crinoid.view.page") / name).read_text(encoding="utf-8")
