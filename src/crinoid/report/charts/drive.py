"""The base and what else is driven: commands, motion, and the load of the arm on the submarine."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.report.charts.chart import Chart, Level, Panel, Trace, power_of_ten
from crinoid.report.run import Run
from crinoid.report.units import DEGREES, Unit, largest, length_unit, si_unit
from crinoid.report.view import is_spatial
from crinoid.space import ANGLES, CHANNEL_TABLE

_ABOUT = {channel.name: channel.axis for channel in CHANNEL_TABLE}
"""The axis that a channel moves along or turns about, which it has the colour of."""
_FEW = 5
"""Actuators of a panel up to which each has its name in the key."""
THROUGH = "... "
"""Before the name of the last of many actuators, where those between have none in the key."""
_DRIVES = ("actuator_state", "actuator_command")
_SMALL = 1e-3
"""Share below which it is told in a power of ten."""
_STILL = 1e-9  # m or rad: less is no motion that anyone ordered
_COMMANDS: tuple[tuple[str, Literal["dashed"]], ...] = (("commands", "dashed"),)
_NEAR = 0.1
"""How far beyond what is drawn the end of a travel is still drawn, of the panel's height."""


def drive_chart(run: Run) -> Chart:
    """Return what is driven, channels of the base and actuators, and the load on the submarine.

    In space there are too many for a panel each: shifts share one, and so do turns.
    """
    channels = moving_channels(run.result)
    groups, tall = [[channel] for channel in channels], 1.55
    if is_spatial(run.result):
        shifts = [channel for channel in channels if channel not in ANGLES]
        turns = [channel for channel in channels if channel in ANGLES]
        groups, tall = [group for group in (shifts, turns) if group], 1.9
    units = _actuator_units(run.result)
    panels = [
        *(_group(run.result, group, tall) for group in groups),
        *(_actuators(run.result, unit, tall) for unit in units),
        _load(run.result, "base_force", "force", "N", tall),
        _load(run.result, "base_moment", "moment", "N m", tall),
    ]
    still = "" if groups or units else "the base is held still: no channel moves"
    return Chart("commands", "Base and actuators", tuple(panels), still)


def _actuator_units(data: xr.Dataset) -> list[str]:
    if "actuator_state" not in data:
        return []
    return list(dict.fromkeys(map(str, data["input_unit"].values)))


def _actuators(data: xr.Dataset, unit: str, tall: float) -> Panel:
    """Return actuators of one unit: what they drive the arm with as lines, commands dashed."""
    names = [str(name) for name in data["input"].values[data["input_unit"].values == unit]]
    time, few = data["time"].values, len(names) <= _FEW
    drawn = drawn_in(unit, largest(*(data[each].sel(input=names).values for each in _DRIVES)))
    traces, commanded = [], False
    for index, name in enumerate(names):
        role = f"part {index / max(1, len(names) - 1):g}"
        state, command = (data[each].sel(input=name).values for each in _DRIVES)
        quiet = not few and 0 < index < len(names) - 1
        shown = name if few or not index else f"{THROUGH}{name}" if not quiet else name
        traces.append(Trace(shown, time, state, role, quiet=quiet))
        if largest(command) > _STILL:
            words = f"{name}, command"
            traces.append(Trace(words, time, command, role, "dashed", quiet=True))
            commanded = True
    name = f"actuators_{_actuator_units(data).index(unit)}"
    return Panel(
        name, "actuators", drawn, tuple(traces), tall=tall, also=_COMMANDS if commanded else ()
    )


def drawn_in(unit: str, most: float) -> Unit:
    """Return what to draw drives of a unit in; of shares the power of ten stands in the label."""
    if unit != "1":
        return si_unit(most, unit)
    power = math.floor(math.log10(most)) if 0.0 < most < _SMALL else 0
    return Unit(10.0**-power, f"{power_of_ten(power)} of share" if power else "share")


def moving_channels(data: xr.Dataset) -> list[str]:
    """Return the channels of the base that are moved, or are told to."""
    if "channel" not in data.coords or not {"base_command", "base_pose"} <= set(data):
        return []
    found = []
    for channel in map(str, data["channel"].values):
        if _moves(data["base_pose"], channel) or _moves(data["base_command"], channel):
            found.append(channel)
    return found


def _moves(part: xr.DataArray, channel: str) -> bool:
    return largest(part.sel(channel=channel).values) > _STILL


def _group(data: xr.Dataset, channels: list[str], tall: float) -> Panel:
    """Return channels of one unit: servos as lines, their commands dashed, whole poses dotted.

    The pose is drawn where a motion is prescribed, which would look like a servo that fails.
    """
    time, command, pose = data["time"].values, data["base_command"], data["base_pose"]
    servo = data.get("base_servo", pose)  # there has not always been one
    turns = channels[0] in ANGLES
    most = largest(*(part.sel(channel=channels).values for part in (command, servo, pose)))
    unit = DEGREES if turns else length_unit(most)
    traces, commanded = [], False
    for channel in channels:
        role = _ABOUT[channel]
        ordered, reached, whole = (
            part.sel(channel=channel).values for part in (command, servo, pose)
        )
        driven = _moves(servo, channel)
        if driven or _moves(command, channel):
            traces.append(Trace(channel, time, reached, role))
            words = f"{channel}, command"
            traces.append(Trace(words, time, ordered, role, "dashed", quiet=True))
            commanded = True
        if _moves(pose - servo, channel):
            words = f"{channel} as prescribed{' and driven' if driven else ''}"
            traces.append(Trace(words, time, whole, role, "dotted", behind=True))
    label = f"{'turn' if turns else 'shift'} of\nthe base"
    return Panel(
        "base_" + "_".join(channels),
        label,
        unit,
        tuple(traces),
        tuple(_limits(data, channels, [trace.values for trace in traces])),
        tall=tall,
        also=_COMMANDS if commanded else (),
    )


def _limits(data: xr.Dataset, channels: list[str], drawn: list[np.ndarray]) -> list[Level]:
    """Return the ends of the travel of channels, where what is drawn comes near them."""
    if "channel_lower" not in data or not drawn:  # of an earlier version
        return []
    low, high = min(map(np.nanmin, drawn)), max(map(np.nanmax, drawn))
    room = 2 * _NEAR * (high - low)
    levels = []
    for channel in channels:
        ends = [
            float(data[name].sel(channel=channel)) for name in ("channel_lower", "channel_upper")
        ]
        for end in ends:
            if ends[0] < ends[1] and low - room <= end <= high + room:
                levels.append(Level(end, _ABOUT[channel], of=f"end of the travel of {channel}"))
    return levels


def _load(data: xr.Dataset, name: str, word: str, unit: str, tall: float) -> Panel:
    label = f"{word} on\nsubmarine"
    if name not in data:
        return Panel(name, label, si_unit(0.0, unit), tall=tall, nothing=f"no {word} recorded")
    load = data[name]
    parts: Mapping[str, Float[np.ndarray, " time"]]
    if load.ndim == 1:  # a planar moment: about the one axis there is, positive as tilt
        parts = {"": load.values}
    else:
        parts = {str(axis): load.sel(axis=axis).values for axis in data["axis"].values}
    way = "along" if word == "force" else "about"
    traces = [
        Trace(f"{word} {way} {axis}" if axis else "", data["time"].values, values, axis or "ink")
        for axis, values in parts.items()
    ]
    return Panel(name, label, si_unit(largest(load.values), unit), tuple(traces), tall=tall)
