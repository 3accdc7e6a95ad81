"""Writing the page of a study: its cases in a table, in a chart over what varied, and as arms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from crinoid.report.charts.effects import effects_of
from crinoid.report.charts.space import evenly
from crinoid.report.charts.study import MOST_KEYS, Study, study_of
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
from crinoid.status import Status
from crinoid.version import __version__

MOST_CASES = 4000
"""Cases that a page holds."""


def write_study(cases: Sequence[Case], name: str, folder: Path) -> Path:
    """Write the page of a study of some name into the folder that holds those of its cases.

    Raises
    ------
    ReportError
        If it cannot be written, or would replace what crinoid did not write.
    """
    pages = [
        f"./{quote(case.directory)}/{PAGE}" if is_page(folder / case.directory / PAGE) else None
        for case in cases
    ]
    first = next((case.result for case in cases if case.result is not None), None)
    title = str(attributes(first).get("title", name)) if first else name
    return save_page(study_page_of(cases, title, pages), folder / PAGE)


def study_page_of(cases: Sequence[Case], title: str, pages: Sequence[str | None]) -> str:
    """Return the page of a study as HTML; ``pages`` are the addresses of those of its cases."""
    failed = sum(Status.of(case.status) is not Status.OK for case in cases)
    told = f"{failed} of {len(cases)} cases did not reach their end as they should"
    some = evenly(len(cases), MOST_CASES)
    left_out = []
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
        table=json_of(_table(study, pages)),
    )
    scripts = [bokeh_script(), own_script("tools", "study")]
    return framed(body, scripts, title=title, version=__version__)


def _subtitle(study: Study) -> str:
    varied = ", ".join(f"{key.name} ({len(key.levels)} values)" for key in study.varied)
    count = len(study.names)
    words = f"study of {count} case{'s' if count != 1 else ''}"
    return f"{words} · {varied}" if varied else words


def _table(study: Study, pages: Sequence[str | None]) -> dict[str, Any]:
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
                "effects": [
                    {
                        "key": study.keys.index(effect.key),
                        "share": round(effect.share, 4),
                        "low": round(effect.low, 4),
                        "high": round(effect.high, 4),
                    }
                    for effect in effects_of(study, measure)
                ],
            }
            for measure in study.measures
        ],
        "views": views_of(study),
    }
