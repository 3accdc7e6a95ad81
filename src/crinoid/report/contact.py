"""When obstacles touch the arm, how hard they press, and how near they come."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.run import Run
from crinoid.report.solids import name_of
from crinoid.report.style import GREY, SERIES, WIDTH, head, key, line_style, share_time
from crinoid.report.units import largest, length_unit, si_unit

_VARIABLES = (
    *("obstacle_position", "contact_force", "contact_impulse"),
    *("contact_time", "contact_gap", "contact_closest"),
)

_FEW = 50  # saved forces of which none is unusual


def has_contact(run: Run) -> bool:
    """Whether the result says what obstacles did."""
    return all(name in run.result for name in _VARIABLES)


def draw_contact(run: Run) -> Figure:
    """Draw when each obstacle touched the arm, its force on it, and its distance from it."""
    count = run.result.sizes["obstacle"]
    members = [(label, data) for label, data in run.members if "contact_force" in data]
    rows = count * len(members)
    legends = 0.19 * (2 + 2 * (rows // 3))
    figure = Figure(figsize=(WIDTH, 5.0 + 0.17 * rows + legends), layout="constrained")
    when, force, gap = figure.subplots(
        3, 1, sharex=True, height_ratios=[0.2 + 0.17 * rows, 2.2, 2.0]
    )
    _when(when, members)
    _force(force, members)
    _gap(gap, members)
    share_time([when, force, gap], run.result["time"].values)
    figure.align_ylabels([force, gap])
    head(figure, run.title, run.status)
    return figure


def _colour(index: int) -> str:
    return SERIES[index % len(SERIES)]


def _without(label: str) -> bool:
    return label == "without control"


def _line(label: str) -> dict[str, Any]:
    """Lines of the run without control are fainter, and broken."""
    if _without(label):
        return {"linestyle": (0, (3, 1.2)), "linewidth": 1.0, "alpha": 0.6, "zorder": 2}
    return {"linewidth": 1.1, "zorder": 3}


def _when(axes: Axes, members: list[tuple[str, xr.Dataset]]) -> None:
    names: list[str] = []
    for index in range(members[0][1].sizes["obstacle"]):
        for label, data in members:
            time, total = data["time"].values, data["contact_time"].values[:, index]
            held = np.diff(total) > 0.0
            spans = [(a, b - a) for a, b in zip(time[:-1][held], time[1:][held], strict=True)]
            axes.broken_barh(
                spans,
                (len(names) - 0.36, 0.72),
                facecolors=_colour(index),
                alpha=0.45 if _without(label) else 1.0,
            )
            name = "without control" if _without(label) else name_of(index, data)
            lasted = f"{total[-1]:.3g} s" if total[-1] else "never"
            if time.size == 1:  # an equilibrium lasts no time
                lasted = "yes" if np.any(data["contact_force"].values[0, index]) else "no"
            names.append(f"{name}: {lasted}")
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0, labelsize=7.5)
    axes.grid(visible=False, axis="y")
    axes.set_title("in contact", loc="left", fontsize=9.0)


def _force(axes: Axes, members: list[tuple[str, xr.Dataset]]) -> None:
    pressing = [np.linalg.norm(data["contact_force"].values, axis=2) for _, data in members]
    means = [_mean_force(data) for _, data in members]
    top = largest(*pressing, *means)
    unit = si_unit(top, "N")
    axes.set_ylabel(f"contact\nforce ({unit.name})")
    for (label, data), values, mean in zip(members, pressing, means, strict=True):
        time = data["time"].values
        for index in range(values.shape[1]):
            if not largest(values[:, index], mean[:, index]):
                continue
            axes.stairs(
                mean[:, index] * unit.factor,
                time,
                fill=True,
                color=_colour(index),
                alpha=0.15 if _without(label) else 0.3,
                linewidth=0,
            )
            axes.plot(
                time,
                values[:, index] * unit.factor,
                color=_colour(index),
                label=f"{_short(index, label)}: \u2264 {unit.text(largest(values[:, index]))}",
                **_line(label),
                **line_style(time.size),
            )
    if any(mean.size for mean in means):
        axes.fill([], [], color=GREY, alpha=0.4, linewidth=0, label="mean between records")
    axes.set_ylim(bottom=0.0, top=None if top else 1.0)
    limit = spike_limit(pressing)
    if limit is not None:
        axes.set_ylim(top=limit * unit.factor)
        axes.set_title(
            f"peaks of up to {unit.text(top)} are cut off", loc="right", fontsize=8.5, color=GREY
        )
    key(axes, columns=3)


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


def _gap(axes: Axes, members: list[tuple[str, xr.Dataset]]) -> None:
    unit = length_unit(largest(*(data["contact_gap"].values for _, data in members)))
    axes.set_ylabel(f"distance from\nthe arm ({unit.name})")
    axes.axhline(0.0, color=GREY, linewidth=0.7)
    for label, data in members:
        for index, values in enumerate(data["contact_gap"].values.T):
            closest = float(data["contact_closest"].values[-1, index])
            text = length_unit(abs(closest)).text(closest)
            axes.plot(
                data["time"].values,
                values * unit.factor,
                color=_colour(index),
                label=f"{_short(index, label)}: \u2265 {text}",
                **_line(label),
                **line_style(values.size),
            )
    key(axes, columns=3)


def _short(index: int, label: str) -> str:
    return f"{index} without" if _without(label) else f"{index}"
