"""The base: its commands, its motion, and the load of the arm on the submarine."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from crinoid.report.run import Run
from crinoid.report.style import (
    AXIS_COLOURS,
    INK,
    WIDTH,
    head,
    key,
    line_style,
    note,
    share_time,
    time_map,
)
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.report.view import is_spatial
from crinoid.space import ANGLES, CHANNEL_TABLE

_ABOUT = {channel.name: channel.axis for channel in CHANNEL_TABLE}
"""The axis that a channel moves along or turns about, which it has the colour of."""
_FEW = 5
"""Actuators of a panel up to which each has its name in the key."""
_DRIVES = ("actuator_state", "actuator_command")
_SMALL = 1e-3
"""Share below which matplotlib would put a power of ten where the key is."""
_STILL = 1e-9  # m or rad: less is no motion that anyone ordered
_DASHED: Any = {"linestyle": (0, (4, 2)), "linewidth": 1.0, "alpha": 0.8}


def draw_commands(run: Run) -> Figure:
    """Draw what is driven, channels of the base and actuators, and the load on the submarine.

    In space there are too many for a panel each: shifts share one, and so do turns.
    """
    channels = _moving_channels(run)
    groups, tall = [[channel] for channel in channels], 1.55
    if is_spatial(run.result):
        shifts = [channel for channel in channels if channel not in ANGLES]
        turns = [channel for channel in channels if channel in ANGLES]
        groups, tall = [group for group in (shifts, turns) if group], 1.9
    units = _actuator_units(run)
    count = len(groups) + len(units) + 2
    figure = Figure(
        figsize=(WIDTH, 1.0 + tall * count + (0 if groups else 0.3)), layout="constrained"
    )
    panels = list(figure.subplots(count, 1, sharex=True))
    for axes, group in zip(panels, groups, strict=False):
        _group(axes, run, group)
    for axes, unit in zip(panels[len(groups) :], units, strict=False):
        _actuators(axes, run, unit)
    _force(panels[-2], run)
    _moment(panels[-1], run)
    share_time(panels, run.result["time"].values)
    figure.align_ylabels(panels)
    head(figure, run.title, run.status)
    if not groups and not units:
        panels[0].set_title("the base is held still: no channel moves", loc="right", fontsize=8.5)
    return figure


def _actuator_units(run: Run) -> list[str]:
    if "actuator_state" not in run.result:
        return []
    return list(dict.fromkeys(map(str, run.result["input_unit"].values)))


def _actuators(axes: Axes, run: Run, unit: str) -> None:
    """Draw actuators of one unit: what they drive the arm with as lines, commands dashed."""
    data = run.result
    names = [str(name) for name in data["input"].values[data["input_unit"].values == unit]]
    time, style = data["time"].values, line_style(data.sizes["time"])
    shades = time_map()(np.linspace(0.0, 1.0, len(names)))
    few = len(names) <= _FEW
    drawn = _drawn_in(unit, largest(*(data[each].sel(input=names).values for each in _DRIVES)))
    commanded = False
    for name, shade in zip(names, shades, strict=True):
        state, command = (drawn.factor * data[each].sel(input=name).values for each in _DRIVES)
        axes.plot(time, state, color=shade, label=name if few else None, **style)
        if largest(command) > drawn.factor * _STILL:
            axes.plot(time, command, color=shade, **_DASHED, **style)
            commanded = True
    if not few:
        axes.plot([], [], color=shades[0], label=names[0])
        axes.plot([], [], color=shades[-1], label=f"... {names[-1]}")
    if commanded:
        axes.plot([], [], color=INK, **_DASHED, label="commands")
    axes.set_ylabel(f"actuators\n({drawn.name})")
    key(axes)


def _drawn_in(unit: str, most: float) -> Unit:
    """Return what to draw drives of a unit in; of shares the power of ten stands in the label."""
    if unit != "1":
        return si_unit(most, unit)
    power = math.floor(math.log10(most)) if 0.0 < most < _SMALL else 0
    return Unit(10.0**-power, f"$10^{{{power}}}$ of share" if power else "share")


def _moving_channels(run: Run) -> list[str]:
    if "channel" not in run.result.coords or not {"base_command", "base_pose"} <= set(run.result):
        return []
    found = []
    for channel in map(str, run.result["channel"].values):
        if _moves(run.result["base_pose"], channel) or _moves(run.result["base_command"], channel):
            found.append(channel)
    return found


def _moves(part: xr.DataArray, channel: str) -> bool:
    return largest(part.sel(channel=channel).values) > _STILL


def _group(axes: Axes, run: Run, channels: list[str]) -> None:
    """Draw channels of one unit: servos as lines, their commands dashed, whole poses dotted.

    The pose is drawn where a motion is prescribed, which would look like a servo that fails.
    """
    data = run.result
    time, command, pose = data["time"].values, data["base_command"], data["base_pose"]
    servo = data.get("base_servo", pose)  # there has not always been one
    turns, style = channels[0] in ANGLES, line_style(time.size)
    tall = largest(*(part.sel(channel=channels).values for part in (command, servo, pose)))
    unit = DEGREES if turns else length_unit(tall)
    commanded = False
    for channel in channels:
        colour = AXIS_COLOURS[_ABOUT[channel]]
        ordered, reached, whole = (
            part.sel(channel=channel).values * unit.factor for part in (command, servo, pose)
        )
        if _moves(servo, channel) or _moves(command, channel):
            axes.plot(time, reached, color=colour, label=channel, **style)
            axes.plot(time, ordered, color=colour, **_DASHED, **style)
            commanded = True
        if _moves(pose - servo, channel):
            words = f"{channel} as prescribed{' and driven' if _moves(servo, channel) else ''}"
            axes.plot(
                time, whole, color=colour, linestyle=(0, (1, 1.5)), label=words, zorder=1.5, **style
            )
    if commanded:
        axes.plot([], [], color=INK, **_DASHED, label="commands")
    _limits(axes, run, channels, unit)
    axes.set_ylabel(f"{'turn' if turns else 'shift'} of\nthe base ({unit.name})")
    key(axes)


def _limits(axes: Axes, run: Run, channels: list[str], unit: Unit) -> None:
    """Draw the ends of the travel of channels, where what is drawn comes near them."""
    if "channel_lower" not in run.result:  # of an earlier version
        return
    low, high = axes.get_ylim()
    room = 0.1 * (high - low)
    for channel in channels:
        ends = [
            float(run.result[name].sel(channel=channel)) * unit.factor
            for name in ("channel_lower", "channel_upper")
        ]
        for end in ends:
            if ends[0] < ends[1] and low - room <= end <= high + room:
                axes.axhline(end, color=AXIS_COLOURS[_ABOUT[channel]], linewidth=0.6, alpha=0.6)


def _force(axes: Axes, run: Run) -> None:
    if "base_force" not in run.result:
        note(axes, "no force recorded")
        return
    force = run.result["base_force"].transpose("time", "axis")
    unit = si_unit(largest(force.values), "N")
    for axis in run.result["axis"].values:
        axes.plot(
            run.result["time"].values,
            force.sel(axis=axis).values * unit.factor,
            color=AXIS_COLOURS[str(axis)],
            label=f"force along {axis}",
            **line_style(force.sizes["time"]),
        )
    axes.set_ylabel(f"force on\nsubmarine ({unit.name})")
    key(axes)


def _moment(axes: Axes, run: Run) -> None:
    if "base_moment" not in run.result:
        note(axes, "no moment recorded")
        return
    moment = run.result["base_moment"]
    unit = si_unit(largest(moment.values), "N m")
    time = run.result["time"].values
    if moment.ndim == 1:  # planar: about the one axis there is, positive as tilt
        parts = {"": moment.values}
    else:
        parts = {str(axis): moment.sel(axis=axis).values for axis in run.result["axis"].values}
    for axis, values in parts.items():
        axes.plot(
            time,
            values * unit.factor,
            color=AXIS_COLOURS.get(axis, INK),
            label=f"moment about {axis}" if axis else None,
            **line_style(time.size),
        )
    axes.set_ylabel(f"moment on\nsubmarine ({unit.name})")
    key(axes)
