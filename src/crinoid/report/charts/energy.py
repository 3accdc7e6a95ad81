"""Where the energy goes, and how well the books balance."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.report.charts.chart import Chart, Level, Panel, Trace, power_of_ten
from crinoid.report.run import Run
from crinoid.report.units import Unit, largest, si_unit

_STORED = ("kinetic", "elastic", "potential")

Kinds = dict[str, Float[np.ndarray, " time"]]


def energy_chart(run: Run) -> Chart:
    """Return the change of the stored energies, the running works, and what they fail to balance.

    The defect is (stored energy - its initial value - sum of works), relative to the largest
    magnitude that any change or work reaches.
    """
    time, kinds = run.result["time"].values, _kinds(run.result)
    changes = {kind: values - values[0] for kind, values in kinds.items() if kind in _STORED}
    done = {kind: values for kind, values in kinds.items() if kind not in _STORED}
    return Chart(
        "energy",
        "Energy",
        (
            _lines("energy_stored", time, changes, "change of\nstored energy"),
            _lines("energy_works", time, done, "work done on\nthe arm so far"),
            _balance(time, changes, done),
        ),
    )


def _kinds(data: xr.Dataset) -> Kinds:
    if "energy" not in data or "kind" not in data.coords:
        return {}
    energy = data["energy"].transpose("time", "kind").values
    return {str(kind): energy[:, i] for i, kind in enumerate(data["kind"].values)}


def _lines(name: str, time: Float[np.ndarray, " time"], lines: Kinds, label: str) -> Panel:
    traces = [
        Trace(kind.replace("_", " "), time, values, f"series {index}")
        for index, (kind, values) in enumerate(lines.items())
        if largest(values) > 0.0
    ]
    zero = [kind.replace("_", " ") for kind, values in lines.items() if largest(values) == 0.0]
    return Panel(
        name,
        label,
        si_unit(largest(*lines.values()), "J"),
        tuple(traces),
        (Level(0.0, "faint"),),
        tall=2.4,
        columns=6,
        nothing="" if lines else "no energy recorded",
        also=((f"zero: {', '.join(zero)}", "none"),) if zero else (),
    )


def _balance(time: Float[np.ndarray, " time"], changes: Kinds, done: Kinds) -> Panel:
    scale = largest(*changes.values(), *done.values())
    if not changes or scale == 0.0:
        words = "no energy changes hands" if changes else "no energy recorded"
        return Panel("energy_balance", "balance defect", tall=1.6, nothing=words)
    defect = sum(changes.values(), np.zeros(time.shape)) - sum(done.values(), np.zeros(time.shape))
    relative = defect / scale
    worst = largest(relative)
    power = math.floor(math.log10(worst)) if worst > 0.0 else 0
    told = (
        f"change \N{MINUS SIGN} works, at most {worst:.1e} of the largest change or work, "
        f"{si_unit(scale, 'J').text(scale)}"
    )
    return Panel(
        "energy_balance",
        "balance defect\n" if power else "balance defect",
        Unit(10.0**-power, f"{power_of_ten(power)} of scale") if power else None,
        (Trace("", time, relative, "ink", told=told),),
        (Level(0.0, "faint"),),
        tall=1.6,
    )
