"""Chart of contact: times, forces and distances of obstacles."""

from dataclasses import replace

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.view.figures.charts.chart import ZERO, Chart, IntervalRow, Panel, Trace
from crinoid.view.figures.run import Run
from crinoid.view.figures.style import largest, length_unit, si_unit
from crinoid.view.scene.data import find_obstacles

_VARIABLES = (
    *("obstacle_position", "contact_force", "contact_impulse"),
    *("contact_time", "contact_gap", "contact_closest"),
)

_FORCE = Panel("contact_force", "contact\nforce", low=0.0, tall=2.2, columns=3)
_GAP = Panel("contact_gap", "distance from\nthe arm", levels=ZERO, tall=2.0, columns=3)
_FEW = 50  # saved forces below which peaks are not cut off


def has_contact(run: Run) -> bool:
    """Whether the result contains contacts."""
    return all(name in run.result for name in _VARIABLES)


def contact_chart(run: Run) -> Chart:
    """Return the times of contact, forces and distances of each obstacle."""
    members = [(label, data) for label, data in run.members if "contact_force" in data]
    return Chart("contact", "Contact", (_when(members), _force(members), _gap(members)))


def _without(label: str) -> bool:
    return label == "without control"


def _when(members: list[tuple[str, xr.Dataset]]) -> Panel:
    rows = []
    for index in range(members[0][1].sizes["obstacle"]):
        for label, data in members:
            time, total = data["time"].values, data["contact_time"].values[:, index]
            held = np.diff(total) > 0.0
            name = "without control" if _without(label) else find_obstacles(data)[index].label
            lasted = f"{total[-1]:.3g} s" if total[-1] else "never"
            if time.size == 1:  # an equilibrium lasts no time
                lasted = "yes" if np.any(data["contact_force"].values[0, index]) else "no"
            spans = np.stack([time[:-1][held], time[1:][held]], axis=1)
            if len(spans):  # intervals that follow each other are joined
                apart = np.flatnonzero(spans[1:, 0] > spans[:-1, 1])
                begins, ends = spans[np.append(0, apart + 1), 0], spans[np.append(apart, -1), 1]
                spans = np.stack([begins, ends], axis=1)
            row = IntervalRow(f"{name}: {lasted}", spans, f"series {index}", _without(label))
            rows.append(row)
    tall = 0.55 + 0.17 * len(rows)
    return Panel("contact_when", "in contact", rows=tuple(rows), tall=tall)


def _force(members: list[tuple[str, xr.Dataset]]) -> Panel:
    pressing = [np.linalg.norm(data["contact_force"].values, axis=2) for _, data in members]
    # of the mean force between records no hit is too short
    pushes = [np.diff(data["contact_impulse"].values, axis=0) for _, data in members]
    steps = [np.diff(data["time"].values)[:, None] for _, data in members]
    means = [np.linalg.norm(p, axis=2) / step for p, step in zip(pushes, steps, strict=True)]
    top = largest(*pressing, *means)
    unit, traces, filled = si_unit(top, "N"), [], False
    for (label, data), values, mean in zip(members, pressing, means, strict=True):
        time, behind = data["time"].values, _without(label)
        for index in range(values.shape[1]):
            if not largest(values[:, index], mean[:, index]):
                continue
            role, name = f"series {index}", _short(index, label)
            if len(mean):
                level = np.append(mean[:, index], mean[-1, index])
                words = f"{name}, mean between records"
                traces.append(Trace(words, time, level, role, "filled", behind, quiet=True))
                filled = True
            summary = f"\u2264 {unit.text(largest(values[:, index]))}"
            traces.append(Trace(name, time, values[:, index], role, behind=behind, summary=summary))
    limit = spike_limit(pressing)
    panel = replace(_FORCE, unit=unit, traces=tuple(traces), high=limit if top else 1.0)
    left_out = "" if limit is None else f"peaks of up to {unit.text(top)} are cut off"
    panel = replace(panel, nothing="" if top else "no obstacle presses", left_out=left_out)
    return replace(panel, also=(("mean between records", "filled"),) if filled else ())


def spike_limit(pressing: list[Float[np.ndarray, "time obstacle"]]) -> float | None:
    """Return a limit of forces (N) that few and short peaks exceed by far, if there are such."""
    together = np.concatenate([values.ravel() for values in pressing])
    held = together[together > 0.0]
    if held.size < _FEW:
        return None
    usual = 1.5 * float(np.quantile(held, 0.98))
    return usual if float(held.max()) > 2 * usual else None


def _gap(members: list[tuple[str, xr.Dataset]]) -> Panel:
    traces = []
    for label, data in members:
        for index, values in enumerate(data["contact_gap"].values.T):
            closest = float(data["contact_closest"].values[-1, index])
            time, summary = data["time"].values, f"\u2265 {length_unit(abs(closest)).text(closest)}"
            name, role, behind = _short(index, label), f"series {index}", _without(label)
            traces.append(Trace(name, time, values, role, behind=behind, summary=summary))
    unit = length_unit(largest(*(data["contact_gap"].values for _, data in members)))
    return replace(_GAP, unit=unit, traces=tuple(traces))


def _short(index: int, label: str) -> str:
    return f"{index} without" if _without(label) else f"{index}"
