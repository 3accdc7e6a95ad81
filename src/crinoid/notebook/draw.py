"""Drawing panels into axes: those of the caller, or those of a new figure."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

from crinoid.report.bending import ROWS, draw_lines
from crinoid.report.charts.chart import Panel
from crinoid.report.paper import draw_panel
from crinoid.report.run import Run
from crinoid.report.single import draw_in
from crinoid.report.style import STYLE, WIDTH, key_within, time_map, time_norm
from crinoid.report.view import View


def draw_panels(panels: Sequence[Panel], run: Run, given: Sequence[Axes] | None) -> list[Axes]:
    """Draw panels below each other, or into as many axes."""
    with _axes([panel.tall for panel in panels], given) as drawn:
        time = run.result["time"].values
        for axes, panel in zip(drawn, panels, strict=True):
            draw_panel(axes, panel)
            if given is not None:
                room = key_within(axes)
                scale = axes.yaxis.get_transform()  # for no data to lie under the legend
                low, high = scale.transform(np.array(axes.get_ylim()))
                top = low + (high - low) / (1.0 - room)
                axes.set_ylim(top=float(scale.inverted().transform(np.array([top]))[0]))
                axes.set_autoscaley_on(True)  # axes of one scale also show what others hold
            if not panel.over and time[-1] > time[0]:
                axes.set_xlim(float(time[0]), float(time[-1]))
        drawn[-1].set_xlabel("frequency (Hz)" if panels[-1].over else "time (s)")
        return drawn


def draw_shape(
    data: xr.Dataset,
    view: View,
    given: Axes | None,
    times: Iterable[float] | None,
    legend: bool,
    bar: bool,
) -> Axes:
    """Draw the arm over time in a view."""
    chosen = None
    if times is not None:
        time, wanted = data["time"].values, np.asarray(list(times), float)
        if not wanted.size or not np.all((wanted >= time[0]) & (wanted <= time[-1])):
            must = f"one or more from {time[0]:g} to {time[-1]:g} (s)"
            raise ValueError(f"times: got {wanted.tolist()}; must be {must}")
        at = np.unique([np.abs(time - each).argmin() for each in wanted])
        data, chosen = data.isel(time=slice(at[0], at[-1] + 1)), at - at[0]
    with _axes([5.0], None if given is None else [given]) as (axes,):
        if bar:  # first, as it narrows the axes
            _tell_time(axes, data)
        draw_in(axes, data, view, chosen, legend)
        return axes


def draw_along(data: xr.Dataset, name: str, given: Axes | None) -> Axes:
    """Draw a quantity along the arm over time."""
    with _axes([2.4], None if given is None else [given]) as (axes,):
        draw_lines(axes, data, name)
        axes.set(xlabel="distance from the root (m)", ylabel=ROWS[name].replace("\n", " "))
        _tell_time(axes, data)
        return axes


@contextmanager
def _axes(heights: list[float], given: Sequence[Axes] | None) -> Iterator[list[Axes]]:
    """Give axes, new ones of some heights (inches) if none are given, in the style of reports."""
    if given is not None and len(given) != len(heights):
        raise ValueError(f"ax: takes {len(heights)} axes, one for each panel, got {len(given)}")
    with mpl.rc_context(STYLE):
        if given is not None:
            yield list(given)
            return
        _, drawn = plt.subplots(
            len(heights),
            figsize=(WIDTH, 0.5 + sum(heights)),
            sharex=True,
            height_ratios=heights,
            squeeze=False,
            layout="constrained",
        )
        yield list(drawn.flat)


def _tell_time(axes: Axes, data: xr.Dataset) -> None:
    """Say which colour is which time, if there is more than one."""
    time = data["time"].values
    if time[-1] > time[0]:
        mapped = ScalarMappable(time_norm(data), time_map())
        bar = axes.figure.colorbar(mapped, ax=axes, fraction=0.2)
        bar.ax.set_title("t (s)", fontsize=8.5)
        bar.ax.grid(visible=False)
