"""Writing the page: everything that it shows and that shows it, in one file."""

import re
from html import escape
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from crinoid.report.charts.chart import Chart
from crinoid.report.charts.drive import drive_chart
from crinoid.report.charts.effort import effort_chart
from crinoid.report.charts.energy import energy_chart
from crinoid.report.charts.spectrum import spectrum_chart
from crinoid.report.charts.summary import summary
from crinoid.report.charts.tip import tip_chart
from crinoid.report.charts.touch import contact_chart, has_contact
from crinoid.report.page.file import save_page
from crinoid.report.page.parts import (
    bokeh_credit,
    bokeh_script,
    framed,
    json_of,
    list_of,
    part,
    run_script,
    table_of,
)
from crinoid.report.page.plots import plots_of
from crinoid.report.page.scene import scene_of, shown
from crinoid.report.page.still import still_of
from crinoid.report.run import Run
from crinoid.result import Result
from crinoid.scenario import ScenarioError
from crinoid.status import Status

_LONGEST = 200_000
"""Characters of a scenario, over which the page does not show it whole."""


def write_run(run: Run, path: Path) -> Path:
    """Write the page of a run."""
    return save_page(page_of(run), path)


def page_of(run: Run) -> str:
    """Return the page of a run as HTML.

    What a user wrote is text in it: it is escaped, and scripts run by their digests only.
    """
    space = shown(run.members)
    table, numbers, left_out = scene_of(space)
    time = np.asarray(run.result["time"].values, float)
    span = [float(time[0]), float(time[-1])]
    plots = plots_of(charts_of(run), *span)
    table = {
        "span": span,
        "times": table["members"][0]["time"],
        "scene": table,
        "charts": plots.charts,
    }
    attributes = run.result.attrs
    scenario = str(attributes.get("scenario", ""))
    if len(scenario) > _LONGEST:
        left_out.append(f"The scenario is cut off after {_LONGEST} characters.")
    failed = Status.of(run.status) is not Status.OK
    body = Template(part("run.html")).substitute(
        title=escape(run.title),
        subtitle=escape(_subtitle(run)),
        status=f'<p class="status">{escape(run.status)}</p>' if failed else "",
        stage=Template(part("stage.html")).substitute(still=still_of(space)),
        metrics=_metrics(run),
        notes=_notes(run),
        scenario=escape(scenario[:_LONGEST]),
        facts=_facts(run),
        left_out=list_of("What was left out", [*run.left_out, *left_out, *plots.left_out]),
        footer=bokeh_credit(),
        table=json_of(table),
        document=json_of(plots.document),
        numbers=numbers,
    )
    version = attributes.get("crinoid_version", "")
    return framed(body, [bokeh_script(), run_script()], title=run.title, version=version)


def charts_of(run: Run) -> list[Chart]:
    """Return the charts of a run in the order of the page."""
    contact = [contact_chart(run)] if has_contact(run) else []
    first = [tip_chart(run), spectrum_chart(run), drive_chart(run)]
    return [*first, *contact, energy_chart(run), effort_chart(run)]


def _subtitle(run: Run) -> str:
    data = run.result
    kind = "arm in space" if data.sizes["axis"] == 3 else "planar arm"
    span = float(data["time"].values[-1] - data["time"].values[0])
    parts = [kind, f"{data.sizes['node']} nodes", f"{span:g} s"]
    if run.uncontrolled is not None:
        parts.append("with and without control")
    return " · ".join(parts)


def _metrics(run: Run) -> str:
    try:
        found = summary(_result(run))
    except (LookupError, ValueError, ScenarioError):
        return "<h2>Numbers</h2><p>The result holds too little to sum it up.</p>"
    return f'<h2>Numbers</h2><div class="scroll numbers">{table_of(found)}</div>'


def _result(run: Run) -> Result:
    other = None if run.uncontrolled is None else Result(run.uncontrolled)
    return Result(run.result, uncontrolled=other)


def _notes(run: Run) -> str:
    return list_of("Notes", _result(run).notes)


def _facts(run: Run) -> str:
    attributes, name = run.result.attrs, _file_name(run.title)
    spent = attributes.get("wall_time")
    facts: dict[str, Any] = {
        "crinoid": attributes.get("crinoid_version", "unknown"),
        "seed": attributes.get("seed", "unknown"),
        "status": run.status,
        "computing time": f"{spent:.3g} s" if isinstance(spent, float) else "unknown",
        "saved instants": run.result.sizes["time"],
    }
    rows = "".join(f"<tr><td>{k}</td><td>{escape(str(v))}</td></tr>" for k, v in facts.items())
    command = f"crinoid run {name}.toml --out results/{name}"
    return (
        f"{rows}<tr><td>to repeat it</td><td>save the scenario above as {name}.toml, then "
        f"<code>{command}</code></td></tr>"
    )


def _file_name(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")[:40].strip("-") or "scenario"
