"""Chart of shed vortices: their frequency against the arm's own, and their force."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.results.result import Result
from crinoid.results.units import Unit, largest, si_unit
from crinoid.view.figures.charts.chart import Chart, Level, Panel, Trace, rms

_HERTZ = Unit(1.0, "Hz")
_SMOOTHED = 1.0
"""Time over which a frequency is averaged (s)."""


def vortex_chart(run: Result) -> Chart | None:
    """Return the frequency of shedding along the arm, and the force near the tip.

    None where the water sheds no vortices.
    """
    needed = {"vortex_force", "vortex_phase"}
    if not all(needed <= set(each.dataset) for _, each in run.members):
        return None
    return Chart("vortices", "Shed vortices", (_frequency(run), _force(run)))


def shedding_frequency(data: xr.Dataset, edge: int) -> Float[np.ndarray, " time"]:
    """Return the frequency with which an edge sheds vortices (Hz), averaged over a second."""
    time, phase = data["time"].values, data["vortex_phase"].values[:, edge]
    if time.size < 2:
        return np.full(time.size, np.nan)
    if np.abs(phase).max() <= np.pi:  # between the ends of a turn
        phase = np.unwrap(phase)
    ends = [np.clip(time + half, time[0], time[-1]) for half in (-_SMOOTHED / 2, _SMOOTHED / 2)]
    turned = np.interp(ends[1], time, phase) - np.interp(ends[0], time, phase)
    return np.asarray(turned / (ends[1] - ends[0]) / (2 * np.pi))


def _frequency(run: Result) -> Panel:
    data = run.dataset
    time, edges = data["time"].values, data.sizes["edge"]
    traces = tuple(
        Trace(name, time, shedding_frequency(data, edge), f"part {edge / max(1, edges - 1):g}")
        for name, edge in (("at the tip", edges - 1), ("middle", edges // 2), ("root", 0))
    )
    top = largest(*(trace.values for trace in traces))
    own = data["natural_frequency"].values if "natural_frequency" in data else np.zeros(0)
    shown = [frequency for frequency in own if 0 < frequency <= 1.5 * top]
    return Panel(
        "shedding_frequency",
        "shedding",
        _HERTZ,
        traces,
        tuple(Level(float(each), "ink", "dashed") for each in shown),
        low=0.0,
        also=(("natural frequencies", "dashed"),) if shown else (),
    )


def _force(run: Result) -> Panel:
    parts = [
        (label, each.dataset, each.dataset["vortex_force"].values[:, -1])
        for label, each in run.members
    ]
    _, first, force = parts[0]
    axis = int(np.argmax(force.std(axis=0)))
    unit = si_unit(largest(*(values[:, axis] for *_, values in parts)), "N/m")
    traces = tuple(
        Trace(
            label or f"along {first['axis'].values[axis]}",
            data["time"].values,
            values[:, axis],
            role,
            behind=role == "free",
            summary=f"{unit.text(rms(values[:, axis]))} RMS",
        )
        for (label, data, values), role in zip(parts, ("run", "free"), strict=False)
    )
    name = f"vortex force\nat the tip, {first['axis'].values[axis]}"
    return Panel("vortex_force", name, unit, traces)
