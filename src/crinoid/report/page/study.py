"""Writing the page of a study: its cases in a table, in a chart over what varied, and as arms."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

import numpy as np

from crinoid.cases import MEASURES
from crinoid.report.charts.effects import effects_of
from crinoid.report.charts.space import evenly
from crinoid.report.charts.study import MOST_KEYS, Measure, Study, study_of
from crinoid.report.page.file import PAGE, is_page, save_page
from crinoid.report.page.finals import finals_of
from crinoid.report.page.parts import (
    bokeh_credit,
    bokeh_script,
    framed,
    json_of,
    list_of,
    own_script,
    part,
)
from crinoid.report.page.sweeps import views_of
from crinoid.report.table import Case, short_keys
from crinoid.result import attributes
from crinoid.scenario import ScenarioError
from crinoid.status import Status
from crinoid.sweep.indices import Index, indices_of
from crinoid.sweep.plan import Plan
from crinoid.sweep.store import SweepStore
from crinoid.version import __version__

MOST_CASES = 4000
"""Cases that a page holds."""


def write_study(cases: Sequence[Case], source: Path, folder: Path) -> Path:
    """Write the page of the study in ``source`` into the folder that holds those of its cases."""
    pages = [
        f"./{quote(case.directory)}/{PAGE}" if is_page(folder / case.directory / PAGE) else None
        for case in cases
    ]
    first = next((case.result for case in cases if case.result is not None), None)
    plan, name = _plan_of(source, len(cases)), source.resolve().name
    title = str(attributes(first).get("title", name)) if first else name
    title = plan.scenario.title if plan is not None else title
    return save_page(study_page_of(cases, title, pages, plan), folder / PAGE)


def _plan_of(folder: Path, runs: int) -> Plan | None:
    """Return the plan of a sweep, where the cases are those of one of this version."""
    try:
        plan = SweepStore(folder).read_plan()
    except (OSError, ScenarioError):
        return None
    return plan if plan.runs == runs else None


def study_page_of(
    cases: Sequence[Case], title: str, pages: Sequence[str | None], plan: Plan | None = None
) -> str:
    """Return the page of a study as HTML.

    ``pages`` are the addresses of those of its cases; ``plan`` is that of a sweep.
    """
    failed = sum(Status.of(case.status) is not Status.OK for case in cases)
    told = f"{failed} of {len(cases)} cases did not reach their end as they should"
    some = evenly(len(cases), MOST_CASES)
    indices, left_out = _indices(cases, plan)
    if len(some) < len(cases):
        left_out.append(f"The page holds {len(some)} of {len(cases)} cases, evenly chosen.")
        cases, pages = [cases[index] for index in some], [pages[index] for index in some]
    study, finals = study_of(cases), finals_of(cases)
    left_out += finals.left_out
    if len(study.varied) > MOST_KEYS:
        left_out.append(f"Charts are over the first {MOST_KEYS} of {len(study.varied)} keys.")
    body = Template(part("study.html")).substitute(
        title=escape(title),
        subtitle=escape(_subtitle(study)),
        status=f'<p class="status">{told}</p>' if failed else "",
        finals=finals.drawing,
        layout="" if finals.drawing else "alone",
        left_out=list_of("What was left out", left_out),
        footer=bokeh_credit(),
        table=json_of(_table(study, pages, indices)),
    )
    scripts = [bokeh_script(), own_script("tools", "study")]
    return framed(body, scripts, title=title, version=__version__)


def _subtitle(study: Study) -> str:
    varied = ", ".join(f"{key.name} ({len(key.levels)} values)" for key in study.varied)
    count = len(study.names)
    words = f"study of {count} case{'s' if count != 1 else ''}"
    return f"{words} · {varied}" if varied else words


def _indices(cases: Sequence[Case], plan: Plan | None) -> tuple[dict[str, list[Index]], list[str]]:
    """Return Sobol's indices of each measure, and a line where SALib is lacking."""
    if plan is None or plan.sampling != "saltelli":
        return {}, []
    found = {}
    for name in MEASURES:
        try:
            found[name] = indices_of(plan, np.array([case.measures[name] for case in cases]))
        except ImportError:
            return {}, ['Sobol\'s total indices need SALib: pip install "crinoid[sweep]".']
    return found, []


def _shares(study: Study, measure: Measure, indices: Sequence[Index]) -> list[dict[str, Any]]:
    """Return the share of the variance that each key explains, as the page reads it."""
    if not indices:
        return [
            {
                "key": study.keys.index(effect.key),
                "share": round(effect.share, 4),
                "low": round(effect.low, 4),
                "high": round(effect.high, 4),
            }
            for effect in effects_of(study, measure)
        ]
    names = [key.name for key in study.keys]
    return [
        {
            "key": names.index(index.key),
            "share": round(index.first, 4),
            "low": round(index.first - index.first_within, 4),
            "high": round(index.first + index.first_within, 4),
            "total": round(index.total, 4),
            "within": round(index.total_within, 4),
        }
        for index in sorted(indices, key=lambda index: -index.total)
    ]


def _table(
    study: Study, pages: Sequence[str | None], indices: Mapping[str, list[Index]]
) -> dict[str, Any]:
    short = short_keys([key.name for key in study.keys])
    return {
        "names": study.names,
        "status": study.status,
        "pages": list(pages),
        "keys": [
            {
                "name": key.name,
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
                "effects": _shares(study, measure, indices.get(measure.name, [])),
            }
            for measure in study.measures
        ],
        "views": views_of(study),
    }
