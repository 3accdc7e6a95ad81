"""Page of a study: a table of its cases, a chart over the varied keys, and the arms."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from jaxtyping import Float

from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__
from crinoid.results.metrics import MEASURES, Measure, measures_of
from crinoid.results.own_files import is_own
from crinoid.results.reading import checked_result, with_shapes
from crinoid.results.report_error import ReportError
from crinoid.results.result_file import attributes
from crinoid.results.scene.data import even_indices, in_space, is_spatial
from crinoid.results.scene.projection import OBLIQUE, SIDE
from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.errors import counted
from crinoid.studies.sweep.plan import ROWS, SweepDesign, read_plan
from crinoid.studies.sweep.sampling import Index, indices_of
from crinoid.view.figures.study import (
    MOST_KEYS,
    Case,
    Study,
    StudyMeasure,
    effects_of,
    short_keys,
    study_of,
)
from crinoid.view.page import parts
from crinoid.view.page.scene import SvgDrawing
from crinoid.view.page.sweeps import view_of

MOST = 150  # most drawn arms: more are hard to distinguish and slow to read
_NODES = 60
_MARGIN = 0.08


def final_shapes(cases: Sequence[Case]) -> tuple[str, list[str]]:
    """Draw the arms of cases at their ends (SVG, empty without any), with notes on omissions."""
    there = [(index, case.result) for index, case in enumerate(cases) if case.result is not None]
    some = [there[index] for index in even_indices(len(there), MOST)] if there else []
    left_out = []
    if len(some) < len(there):
        left_out.append(f"The arms of {len(some)} of {len(there)} cases are drawn.")
    found: list[tuple[int, Float[np.ndarray, "node axis"]]] = []
    spatial = False
    for index, path in some:
        try:
            data = with_shapes(checked_result(path, lazily=True), str(path)).dataset.isel(time=[-1])
        except ReportError:
            left_out.append(f"The arm of {cases[index].name} cannot be drawn.")
            continue
        position = in_space(data, "position")[-1]
        found.append((index, position[even_indices(len(position), _NODES)]))
        spatial = spatial or is_spatial(data)
    if not found:
        return "", left_out
    view = OBLIQUE if spatial else SIDE
    shapes = [(index, view.paper(position)) for index, position in found]
    points = np.concatenate([shape for _, shape in shapes])
    drawing = SvgDrawing.around(points, _MARGIN, 0.0)
    lines = [
        f'<polyline class="arm" data-case="{index}" points="{drawing.svg_points(shape)}"/>'
        for index, shape in shapes
    ]
    return drawing.text("The arm at the end of each case", lines), left_out


MOST_CASES = 4000  # most cases on a page


def write_study(cases: Sequence[Case], source: Path, folder: Path) -> Path:
    """Write the page of the study in ``source`` into the folder with those of its cases."""
    there = [is_own(folder / case.directory / parts.PAGE) for case in cases]
    addresses = [f"./{quote(case.directory)}/{parts.PAGE}" for case in cases]
    pages = [each if own else None for each, own in zip(addresses, there, strict=True)]
    plan, title, registry = about_study(source, cases)
    page = study_page_of(cases, title, pages, plan, registry)
    return parts.save_page(page, folder / parts.PAGE)


def about_study(
    source: Path, cases: Sequence[Case]
) -> tuple[SweepDesign | None, str, dict[str, Measure]]:
    """Return the design, the title and the measures of the study in a folder.

    The design is that of a sweep with as many runs, if the folder has one. The title is that of
    the scenario, or the folder's name. Measures of packages that are missing are left out.
    """
    try:
        plan: SweepDesign | None = read_plan(source)
    except (OSError, ScenarioError):
        plan = None
    if plan is not None and plan.runs != len(cases):
        plan = None
    first = next((case.result for case in cases if case.result is not None), None)
    found = {} if first is None else attributes(first)
    title = plan.scenario.title if plan else str(found.get("title", source.resolve().name))
    text = found.get("scenario")
    try:
        scenario = plan.scenario if plan else text and Scenario.from_toml(str(text))
        return plan, title, measures_of(scenario) if scenario else MEASURES
    except ScenarioError:
        return plan, title, MEASURES


def study_page_of(
    cases: Sequence[Case],
    title: str,
    pages: Sequence[str | None],
    plan: SweepDesign | None = None,
    registry: Mapping[str, Measure] = MEASURES,
) -> str:
    """Return a study as HTML; ``pages`` are the addresses of the pages of its cases."""
    failed = sum(Status.of(case.status) is not Status.OK for case in cases)
    status = f"{failed} of {len(cases)} cases failed or did not reach their end"
    some = even_indices(len(cases), MOST_CASES)
    indices, left_out = _indices(cases, plan)
    if len(some) < len(cases):
        left_out.append(f"The page contains {len(some)} of {len(cases)} cases, evenly chosen.")
        cases, pages = [cases[index] for index in some], [pages[index] for index in some]
    study, (finals, omissions) = study_of(cases, registry), final_shapes(cases)
    left_out += omissions
    if len(study.varied) > MOST_KEYS:
        left_out.append(f"Charts are over the first {MOST_KEYS} of {len(study.varied)} keys.")
    varied = ", ".join(f"{key.name} ({len(key.levels)} values)" for key in study.varied)
    words = f"study of {counted(len(study.names), 'case')}"
    body = parts.filled(
        "study.html",
        title=escape(title),
        subtitle=escape(" · ".join(filter(None, (words, varied)))),
        status=f'<p class="status">{status}</p>' if failed else "",
        finals=finals,
        layout="" if finals else "alone",
        left_out=parts.list_of("What was left out", left_out),
        footer=parts.bokeh_credit(),
        table=parts.json_of(_table(study, pages, indices)),
    )
    scripts = [parts.bokeh_script(), parts.join_scripts("tools", "study")]
    return parts.html_page(body, scripts, title=title, version=__version__)


def _indices(
    cases: Sequence[Case], plan: SweepDesign | None
) -> tuple[dict[str, list[Index]] | None, list[str]]:
    """Return Sobol's indices of each measure, and a note where SALib is not installed.

    None of rows: their keys vary together, so that no share belongs to one of them.
    """
    if plan is not None and plan.sampling == ROWS:
        return None, []
    if plan is None or plan.sampling != "saltelli":
        return {}, []
    found = {}
    for name in cases[0].measures:
        try:
            values = plan.by_point(np.array([case.measures[name] for case in cases]))
            found[name] = indices_of(plan.sampled, values)
        except ImportError:
            return {}, ['Sobol\'s total indices need SALib: pip install "crinoid[sweep]".']
    return found, []


def _shares(study: Study, measure: StudyMeasure, indices: Sequence[Index]) -> list[dict[str, Any]]:
    found: dict[str, dict[str, float]] = {}
    for index in sorted(indices, key=lambda index: -index.total):
        low, high = index.first - index.first_within, index.first + index.first_within
        found[index.key] = {"share": index.first, "low": low, "high": high}
        found[index.key] |= {"total": index.total, "within": index.total_within}
    for effect in [] if indices else effects_of(study, measure):
        found[effect.key.name] = {"share": effect.share, "low": effect.low, "high": effect.high}
    names = [key.name for key in study.keys]
    return [
        {"key": names.index(key)} | {name: round(number, 4) for name, number in shares.items()}
        for key, shares in found.items()
    ]


def _table(
    study: Study, pages: Sequence[str | None], indices: Mapping[str, list[Index]] | None
) -> dict[str, Any]:
    short = short_keys([key.name for key in study.keys])
    return {
        "names": study.names,
        "status": study.status,
        "pages": list(pages),
        "keys": [
            {
                "name": key.name,
                "label": key.label,
                "short": short[key.name],
                "levels": key.levels,
                "level": key.level.tolist(),
                "numbers": None if key.numbers is None else key.numbers.tolist(),
            }
            for key in study.keys
        ],
        "measures": [
            {
                "name": measure.name,
                "label": measure.label,
                "unit": measure.unit.name,
                "values": [
                    float(f"{value:.8g}") if math.isfinite(value) else None
                    for value in (measure.values * measure.unit.factor).tolist()
                ],
                "effects": []
                if indices is None
                else _shares(study, measure, indices.get(measure.name, [])),
            }
            for measure in study.measures
        ],
        "views": [view_of(study, keys) for keys in study.views()],
    }
