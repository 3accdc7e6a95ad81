"""Charts drawn with matplotlib: panels below each other."""

from dataclasses import replace
from typing import Any

import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from crinoid.view.figures import style
from crinoid.view.figures.charts.chart import Chart, Panel, Role, Trace

_COLOURS = {"run": style.BLUE, "free": style.VERMILLION, "ink": style.INK, "faint": style.GREY}
_COLOURS |= style.AXIS_COLOURS
_DASHED = (0, (4, 2))


def draw_chart(chart: Chart, data: xr.Dataset, title: str) -> Figure:
    """Draw the panels of a chart below each other; without a title of the data the given one."""
    panels = chart.filled
    heights = [panel.tall for panel in panels]
    figure = style.new_figure(0.5 + sum(heights))
    drawn = list(
        figure.subplots(len(heights), 1, sharex=True, height_ratios=heights, squeeze=False).flat
    )
    for axes, panel in zip(drawn, panels, strict=True):
        draw_panel(axes, panel)
    if panels[-1].over:
        drawn[-1].set_xlabel("frequency (Hz)")
    elif panels[-1].along:
        drawn[-1].set_xlabel("distance from the root (m)")
    else:
        style.share_time(drawn, data["time"].values)
    figure.align_ylabels([axes for axes in drawn if axes.get_ylabel()])
    style.head_of(figure, data, title)
    if chart.remark:
        drawn[0].set_title(chart.remark, loc="right", fontsize=style.small())
    return figure


def colour(role: Role) -> str:
    """Return the colour of a role."""
    kind, _, which = role.partition(" ")
    if kind == "series":
        return style.SERIES[int(which) % len(style.SERIES)]
    if kind == "part":
        return to_hex(style.time_map()(float(which)))
    return _COLOURS[role]


def draw_panel(axes: Axes, panel: Panel) -> None:
    """Draw a panel of a chart."""
    if panel.rows:
        _draw_rows(axes, panel)
        return
    axes.set_ylabel(panel.axis)
    if panel.over:
        axes.set(xscale="log", yscale="log")
        # plain numbers, wide enough apart over one decade and over four
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=20))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlim(panel.over)
    if panel.along:
        axes.set_xlim(0.0, panel.along)
    for level in panel.levels:
        limit = level.role != "faint" and level.line == "solid"
        drawn = axes.axhline(level.value * panel.factor, color=colour(level.role))
        drawn.set(linestyle=_DASHED if level.line == "dashed" else "-", alpha=0.6 if limit else 1.0)
        drawn.set_linewidth(0.7 if level.role == "faint" else 0.6 if limit else 1.0)
    for trace in panel.traces:
        _draw_trace(axes, panel, trace)
    if panel.aside is not None:
        shade: Any = {"color": style.PALE, "alpha": 0.6, "linewidth": 0, "zorder": 0}
        axes.axvspan(0.0, panel.aside, **shade, label="does not count")
    for words, look in panel.also:
        if look == "filled":
            axes.fill([], [], color=style.GREY, alpha=0.4, linewidth=0, label=words)
        elif look == "dashed":
            axes.plot([], [], color=style.INK, **_look("dashed", False), label=words)
        else:
            axes.plot([], [], linestyle="none", label=words)
    if panel.nothing:
        style.note(axes, panel.nothing)
    if panel.low is not None:
        axes.set_ylim(bottom=panel.low * panel.factor)
    if panel.high is not None:
        axes.set_ylim(top=panel.high * panel.factor)
    if panel.left_out:
        axes.set_title(panel.left_out, loc="right", fontsize=style.small(), color=style.GREY)
    style.key(axes, columns=panel.columns)


def _draw_trace(axes: Axes, panel: Panel, trace: Trace) -> None:
    values, ink = trace.values * panel.factor, colour(trace.role)
    if trace.line == "filled":
        alpha = 0.15 if trace.behind else 0.3
        axes.stairs(values[:-1], trace.at, fill=True, color=ink, alpha=alpha, linewidth=0)
        return
    if style.narrow():  # a caption has the others
        trace = replace(trace, summary=trace.summary.partition(",")[0])
    label = trace.words if trace.words and not trace.quiet else None
    if trace.line == "points":
        axes.plot(trace.at, values, ".", color=ink, label=label, markersize=2.0)
        return
    axes.plot(
        trace.at,
        values,
        color=ink,
        label=label,
        **_look(trace.line, trace.behind and trace.role not in ("free", "run")),
        zorder=2 if trace.behind else 3,
        marker="o" if trace.at.size <= 12 else "none",
        markersize=3.5,
    )


def _look(line: str, behind: bool) -> dict[str, Any]:
    if line == "dashed":
        return {"linestyle": _DASHED, "linewidth": 1.0, "alpha": 0.8}
    if line == "dotted":
        return {"linestyle": (0, (1, 1.5))}
    if behind:
        return {"linestyle": (0, (3, 1.2)), "linewidth": 1.0, "alpha": 0.5}
    return {"linestyle": "-"}


def _draw_rows(axes: Axes, panel: Panel) -> None:
    for place, row in enumerate(panel.rows):
        spans = [(begin, end - begin) for begin, end in row.spans]
        alpha = 0.45 if row.behind else 1.0
        axes.broken_barh(spans, (place - 0.36, 0.72), facecolors=colour(row.role), alpha=alpha)
    axes.set_yticks(range(len(panel.rows)), [row.name for row in panel.rows])
    axes.set_ylim(len(panel.rows) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0, labelsize=style.small())
    axes.grid(visible=False, axis="y")
    axes.set_title(panel.label, loc="left")
