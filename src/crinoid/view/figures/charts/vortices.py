"""Chart of shed vortices: their frequency against the arm's own, and their force."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.results.result import Result
from crinoid.results.units import Unit, largest, si_unit
from crinoid.view.figures.charts.chart import MEMBER_ROLES, Chart, Level, Panel, Trace, rms

_HERTZ = Unit(1.0, "Hz")
_SMOOTHED = 1.0  # time over which a frequency is averaged (s)


def vortex_chart(run: Result) -> Chart | None:
    """Return the frequency of shedding and the force near the tip; None without vortices."""
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
    forces = [each.dataset["vortex_force"].values[:, -1] for _, each in run.members]
    widest = int(np.argmax(forces[0].std(axis=0)))
    axis, forces = run.dataset["axis"].values[widest], [each[:, widest] for each in forces]
    unit, traces = si_unit(largest(*forces), "N/m"), []
    for (label, each), force, role in zip(run.members, forces, MEMBER_ROLES, strict=False):
        time, summary = each.dataset["time"].values, f"{unit.text(rms(force))} RMS"
        traces.append(Trace(label or f"along {axis}", time, force, role, summary=summary))
    return Panel("vortex_force", f"vortex force\nat the tip, {axis}", unit, tuple(traces))
