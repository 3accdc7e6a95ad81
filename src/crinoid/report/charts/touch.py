"""When obstacles touch the arm, how hard they press, and how near they come."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.report.charts.chart import Chart, Level, Panel, Row, Trace
from crinoid.report.run import Run
from crinoid.report.solids import name_of
from crinoid.report.units import largest, length_unit, si_unit

_VARIABLES = (
    *("obstacle_position", "contact_force", "contact_impulse"),
    *("contact_time", "contact_gap", "contact_closest"),
)

_FEW = 50  # saved forces of which none is unusual


def has_contact(run: Run) -> bool:
    """Whether the result says what obstacles did."""
    return all(name in run.result for name in _VARIABLES)


def contact_chart(run: Run) -> Chart:
    """Return when each obstacle touched the arm, its force on it, and its distance from it."""
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
            name = "without control" if _without(label) else name_of(index, data)
            lasted = f"{total[-1]:.3g} s" if total[-1] else "never"
            if time.size == 1:  # an equilibrium lasts no time
                lasted = "yes" if np.any(data["contact_force"].values[0, index]) else "no"
            rows.append(
                Row(
                    f"{name}: {lasted}",
                    _joined(np.stack([time[:-1][held], time[1:][held]], axis=1)),
                    f"series {index}",
                    behind=_without(label),
                )
            )
    tall = 0.55 + 0.17 * len(rows)
    return Panel("contact_when", "in contact", rows=tuple(rows), tall=tall)


def _joined(spans: Float[np.ndarray, "span 2"]) -> Float[np.ndarray, "_ 2"]:
    """Make one of spans that follow each other."""
    if not len(spans):
        return spans
    apart = np.flatnonzero(spans[1:, 0] > spans[:-1, 1])
    return np.stack([spans[np.append(0, apart + 1), 0], spans[np.append(apart, -1), 1]], axis=1)


def _force(members: list[tuple[str, xr.Dataset]]) -> Panel:
    pressing = [np.linalg.norm(data["contact_force"].values, axis=2) for _, data in members]
    means = [_mean_force(data) for _, data in members]
    top = largest(*pressing, *means)
    unit, traces, filled = si_unit(top, "N"), [], False
    for (label, data), values, mean in zip(members, pressing, means, strict=True):
        time, behind = data["time"].values, _without(label)
        for index in range(values.shape[1]):
            if not largest(values[:, index], mean[:, index]):
                continue
            role, name = f"series {index}", _short(index, label)
            if len(mean):
                steps = np.append(mean[:, index], mean[-1, index])
                words = f"{name}, mean between records"
                traces.append(Trace(words, time, steps, role, "filled", behind, quiet=True))
                filled = True
            told = f"\u2264 {unit.text(largest(values[:, index]))}"
            traces.append(Trace(name, time, values[:, index], role, behind=behind, told=told))
    limit = spike_limit(pressing)
    return Panel(
        "contact_force",
        "contact\nforce",
        unit,
        tuple(traces),
        low=0.0,
        high=limit if top else 1.0,
        tall=2.2,
        columns=3,
        nothing="" if top else "no obstacle presses",
        left_out="" if limit is None else f"peaks of up to {unit.text(top)} are cut off",
        also=(("mean between records", "filled"),) if filled else (),
    )


def spike_limit(pressing: list[Float[np.ndarray, "time obstacle"]]) -> float | None:
    """Return a limit of forces (N) that few and short peaks exceed by far, if there are such."""
    together = np.concatenate([values.ravel() for values in pressing])
    held = together[together > 0.0]
    if held.size < _FEW:
        return None
    usual = 1.5 * float(np.quantile(held, 0.98))
    return usual if float(held.max()) > 2 * usual else None


def _mean_force(data: xr.Dataset) -> Float[np.ndarray, "interval obstacle"]:
    """Magnitude of the mean force between records (N), for which no hit is too short."""
    impulse = data["contact_impulse"].values
    step = np.diff(data["time"].values)[:, None]
    return np.asarray(np.linalg.norm(np.diff(impulse, axis=0), axis=2) / step)


def _gap(members: list[tuple[str, xr.Dataset]]) -> Panel:
    traces = []
    for label, data in members:
        for index, values in enumerate(data["contact_gap"].values.T):
            closest = float(data["contact_closest"].values[-1, index])
            told = f"\u2265 {length_unit(abs(closest)).text(closest)}"
            name, role, behind = _short(index, label), f"series {index}", _without(label)
            traces.append(Trace(name, data["time"].values, values, role, behind=behind, told=told))
    return Panel(
        "contact_gap",
        "distance from\nthe arm",
        length_unit(largest(*(data["contact_gap"].values for _, data in members))),
        tuple(traces),
        (Level(0.0, "faint"),),
        tall=2.0,
        columns=3,
    )


def _short(index: int, label: str) -> str:
    return f"{index} without" if _without(label) else f"{index}"
