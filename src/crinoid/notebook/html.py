"""A result as HTML: the table that closes its run, and a small animation."""

from html import escape

from crinoid.notebook.runs import run_of
from crinoid.report.charts.summary import equilibrium_summary, summary
from crinoid.report.page.parts import list_of, table_of
from crinoid.report.page.small import small_page_of
from crinoid.result import Result

_HIGH = 440
"""Height of the animation (pixels)."""


def html_of(result: Result) -> str:
    """Return a result as HTML; what cannot be shown leaves a line that says why.

    Texts of the scenario are text in it. The animation is a page of its own within a frame, which
    may run its script and nothing else.
    """
    attributes = result.dataset.attrs
    title, status = (str(attributes.get(name, "")) for name in ("title", "status"))
    failed = f"<p>{escape(status)}</p>" if status and status != "ok" else ""
    return f"<h3>{escape(title)}</h3>{failed}{_numbers(result)}{_animation(result)}"


def _numbers(result: Result) -> str:
    try:
        still = result.dataset.sizes["time"] == 1
        return table_of(equilibrium_summary(result) if still else summary(result))
    except Exception as error:  # a notebook shows a traceback in place of all there is
        return _trouble("no numbers", error)


def _animation(result: Result) -> str:
    try:
        page, left_out = small_page_of(run_of(result))
    except Exception as error:
        return _trouble("no animation", error)
    content = page.replace("&", "&amp;").replace("'", "&#39;")
    return (
        f"<iframe srcdoc='{content}' sandbox='allow-scripts' title='The arm over time' "
        f"style='width:100%;height:{_HIGH}px;border:0'></iframe>{list_of('Left out', left_out)}"
    )


def _trouble(what: str, error: Exception) -> str:
    reason = " ".join(str(error).split())
    return f"<p>{what}: {escape(f'{type(error).__name__}: {reason}'[:300])}</p>"
