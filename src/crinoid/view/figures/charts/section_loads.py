"""Chart of the loads in the sections: envelopes of bending moment and shear force along the arm."""

from collections.abc import Iterator

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.results.chunks import pieces
from crinoid.results.loads import stations_of
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
    found = [(who, stations_of(data, name), _envelope(data, name)) for who, data in known]
    ways = found[0][2].shape[2]
    words = name.replace("_", " ")
    for way in range(ways):
        traces = []
        for (who, at, ends), role in zip(found, MEMBER_ROLES, strict=False):
            label = who or "least and greatest"
            pairs = zip((label, ""), ends[..., way], strict=True)
            traces += [
                Trace(text, at, values, role, behind=role == "free", quiet=not text)
                for text, values in pairs
            ]
        unit = si_unit(largest(*(trace.values for trace in traces)), _LOADS[name])
        side = f", $m_{way + 1}$" if ways > 1 else ""
        along = float(run.dataset["arc_length"].values[-1])
        label = f"{words.replace(' ', chr(10))}{side}"
        yield Panel(f"{name}_{way}", label, unit, tuple(traces), ZERO, tall=2.0, along=along)


def _envelope(data: xr.Dataset, name: str) -> Float[np.ndarray, "end=2 place way"]:
    """Return the least and the greatest values over time."""
    ends = [
        (part[name].values.min(axis=0), part[name].values.max(axis=0))
        for part in pieces(data, [name])
    ]
    least, greatest = zip(*ends, strict=True)
    both = np.stack([np.min(least, axis=0), np.max(greatest, axis=0)])
    return both.reshape(*both.shape[:2], -1)
