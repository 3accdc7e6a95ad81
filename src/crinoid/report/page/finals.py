"""The arm at the end of each case of a study, as a drawing whose lines the page colours."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from crinoid.report.charts.space import evenly
from crinoid.report.page.still import Drawing
from crinoid.report.run import ReportError, open_result
from crinoid.report.table import Case
from crinoid.report.view import OBLIQUE, SIDE, in_space, is_spatial

MOST = 150
"""Shapes that one can tell apart, and whose results are read in seconds."""
_NODES = 60
_MARGIN = 0.08


class Finals(NamedTuple):
    """A drawing (SVG), empty where there is nothing to draw, and what was left out in words."""

    drawing: str
    left_out: list[str]


def finals_of(cases: Sequence[Case]) -> Finals:
    """Draw the arms of cases at their ends, one line each, with the number of its case."""
    there = [(index, case.result) for index, case in enumerate(cases) if case.result is not None]
    some = [there[index] for index in evenly(len(there), MOST)] if there else []
    left_out = []
    if len(some) < len(there):
        left_out.append(f"The arms of {len(some)} of {len(there)} cases are drawn.")
    found: list[tuple[int, Float[np.ndarray, "node axis"]]] = []
    spatial = False
    for index, path in some:
        try:
            data = open_result(path, lazily=True).isel(time=[-1])
        except ReportError:
            left_out.append(f"The arm of {cases[index].name} cannot be drawn.")
            continue
        position = in_space(data, "position")[-1]
        found.append((index, position[evenly(len(position), _NODES)]))
        spatial = spatial or is_spatial(data)
    if not found:
        return Finals("", left_out)
    view = OBLIQUE if spatial else SIDE
    shapes = [(index, view.paper(position)) for index, position in found]
    points = np.concatenate([shape for _, shape in shapes])
    drawing = Drawing.around(points, _MARGIN, 0.0)
    lines = [
        f'<polyline class="arm" data-case="{index}" points="{drawing.placed(shape)}"/>'
        for index, shape in shapes
    ]
    return Finals(drawing.text("The arm at the end of each case", lines), left_out)
