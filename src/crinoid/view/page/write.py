"""Page of a run: one file with its animation, charts and tables."""

from html import escape
from pathlib import Path
from typing import Any

from crinoid.foundation.status import Status
from crinoid.results.report_error import ReportError
from crinoid.results.result import Result
from crinoid.results.scene.scene import Scene, build_scene
from crinoid.scenario import ScenarioError
from crinoid.view.figures.charts.of_run import charts_of
from crinoid.view.page import parts
from crinoid.view.page.plots import PlotDocument, plots_of
from crinoid.view.page.repeat import SAVED, repeat_command
from crinoid.view.page.scene import animation_texts, page_scene

LARGEST = 800_000  # most characters
_NODES = 61
_KEYS = "Space plays; the arrow keys step through the saved instants."
_FRAMES = (301, 151, 76, 31)  # most instants, in the order of trials until the page is small enough


def small_page_of(run: Result) -> tuple[str, list[str]]:
    """Return the animation of a run as a page, and notes on omissions."""
    version = run.dataset.attrs.get("crinoid_version", "")
    options = {"title": run.title, "version": version, "kind": "small"}
    nothing = PlotDocument({}, [], [])
    for frames in _FRAMES:
        texts, left_out = _animation(run, build_scene(run, frames, _NODES), nothing)
        body = parts.filled("scene.html", **texts)
        page = parts.html_page(body, [parts.run_script()], **options)
        if len(page) <= LARGEST:
            return page, [*run.left_out, *left_out]
    raise ReportError("there are too many obstacles for a small animation")


def _animation(run: Result, scene: Scene, plots: PlotDocument) -> tuple[dict[str, str], list[str]]:
    bar = parts.read_part("playback.html")
    return animation_texts(scene, plots, bar, _KEYS, {"span": _span(run)})


def _span(run: Result) -> list[float]:
    """First and last time (s)."""
    return [float(run.dataset["time"].values[end]) for end in (0, -1)]


_LONGEST = 200_000  # most characters of a scenario on the page


def write_run(run: Result, path: Path) -> Path:
    """Write the page of a run."""
    return parts.save_page(page_of(run), path)


def page_of(run: Result) -> str:
    """Return the page of a run as HTML, in which texts of the user are escaped."""
    still = run.dataset.sizes["time"] == 1
    charts = [] if still else charts_of(run)
    begin, end = _span(run)
    plots = plots_of(charts, begin, end)
    texts, left_out = _animation(run, page_scene(run), plots)
    attributes = run.dataset.attrs
    scenario = str(attributes.get("scenario", ""))
    if len(scenario) > _LONGEST:
        left_out.append(f"The scenario is cut off after {_LONGEST} characters.")
    failed = run.ended is not Status.OK
    kind = "arm in space" if run.dataset.sizes["axis"] == 3 else "planar arm"
    lasts = "one instant" if still else f"{end - begin:g} s"
    words = [kind, f"{run.dataset.sizes['node']} nodes", lasts]
    words += [] if run.uncontrolled is None else ["with and without control"]
    body = parts.filled(
        "run.html",
        title=escape(run.title),
        subtitle=escape(" · ".join(words)),
        status=f'<p class="status">{escape(run.status)}</p>' if failed else "",
        metrics=_numbers(run),
        notes=parts.list_of("Notes", list(dict.fromkeys(run.notes))),
        scenario=escape(scenario[:_LONGEST]),
        facts=_facts(run),
        left_out=parts.list_of("What was left out", [*run.left_out, *left_out, *plots.left_out]),
        **texts,
    )
    version = attributes.get("crinoid_version", "")
    scripts = [parts.bokeh_script(), parts.run_script()]
    return parts.html_page(body, scripts, title=run.title, version=version)


def _numbers(run: Result) -> str:
    try:
        return f'<h2>Numbers</h2><div class="scroll numbers">{parts.numbers_of(run)}</div>'
    except (LookupError, ValueError, ScenarioError):
        return "<h2>Numbers</h2><p>The result lacks variables of the summary.</p>"


def _facts(run: Result) -> str:
    attributes = run.dataset.attrs
    spent = attributes.get("wall_time")
    command = repeat_command(run)
    facts: dict[str, Any] = {
        "crinoid": attributes.get("crinoid_version", "unknown"),
        "seed": attributes.get("seed", "unknown"),
        "status": run.status,
        "computing time": f"{spent:.3g} s" if isinstance(spent, float) else "unknown",
        "saved instants": run.dataset.sizes["time"],
    }
    rows = "".join(f"<tr><td>{k}</td><td>{escape(str(v))}</td></tr>" for k, v in facts.items())
    before = f"save the scenario above as {SAVED}, then " if command.endswith(SAVED) else ""
    return f"{rows}<tr><td>to repeat it</td><td>{before}<code>{escape(command)}</code></td></tr>"
