"""Chart of the loads in the sections: envelopes of bending moment and shear force along the arm."""

from collections.abc import Iterator

import numpy as np

from crinoid.results.loads import envelope, stations_of
from crinoid.results.result import Result
from crinoid.results.units import largest, si_unit
from crinoid.view.figures.charts.chart import MEMBER_ROLES, ZERO, Chart, Panel, Trace

_LOADS = {"bending_moment": "N m", "shear_force": "N"}


def section_load_chart(run: Result) -> Chart | None:
    """Return the least and greatest values over time; None without these variables."""
    if not set(_LOADS) <= set(run.dataset):
        return None
    panels = tuple(panel for name in _LOADS for panel in _panels(run, name))
    return Chart("section_loads", "Bending moment and shear force along the arm", panels)


def _panels(run: Result, name: str) -> Iterator[Panel]:
    """Yield a panel of a load; in space one for each director."""
    known = [(who, each.dataset) for who, each in run.members if name in each.dataset]
    ends = [np.atleast_3d(envelope(data, name)) for _, data in known]
    ways, words = ends[0].shape[2], name.replace("_", " ")
    for way in range(ways):
        traces = []
        for (who, data), values, role in zip(known, ends, MEMBER_ROLES, strict=False):
            at, label = stations_of(data, name), who or "least and greatest"
            traces += [
                Trace(text, at, end, role, quiet=not text)
                for text, end in zip((label, ""), values[..., way], strict=True)
            ]
        unit = si_unit(largest(*(trace.values for trace in traces)), _LOADS[name])
        side = f", $m_{way + 1}$" if ways > 1 else ""
        along = float(run.dataset["arc_length"].values[-1])
        label = f"{words.replace(' ', chr(10))}{side}"
        yield Panel(f"{name}_{way}", label, unit, tuple(traces), ZERO, tall=2.0, along=along)
