"""Charts of servos, of the load on the base, and of energies."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.foundation.axes import ANGLES, CHANNEL_TABLE
from crinoid.results.drives import ActuatorDrive, actuator_drives, drive_unit
from crinoid.results.result import Result
from crinoid.results.scene.data import base_word, is_spatial
from crinoid.results.units import DEGREES, Unit, largest, length_unit, power_of_ten, si_unit
from crinoid.view.figures.charts.chart import MEMBER_ROLES, ZERO, Chart, Level, Panel, Trace

_STORED = ("kinetic", "elastic", "potential")
_BALANCE = Panel("energy_balance", "balance defect")
_ITERATIONS = Panel("newton_iterations", "Newton iterations\na step", low=0.0)

Kinds = dict[str, Float[np.ndarray, " time"]]


def energy_chart(run: Result) -> Chart:
    """Return the changes of the stored energies, the works, and the error of their balance.

    The defect is (stored energy - its initial value - sum of works), relative to the largest
    magnitude that any change or work reaches.
    """
    data, kinds = run.dataset, {}
    time = data["time"].values
    if "energy" in data and "kind" in data.coords:
        energy = data["energy"].transpose("time", "kind").values
        kinds = {str(kind): energy[:, i] for i, kind in enumerate(data["kind"].values)}
    changes = {kind: values - values[0] for kind, values in kinds.items() if kind in _STORED}
    done = {kind: values for kind, values in kinds.items() if kind not in _STORED}
    stored = _lines("energy_stored", time, changes, "change of\nstored energy")
    works = _lines("energy_works", time, done, "work done on\nthe arm so far")
    return Chart("energy", "Energy", (stored, works, _balance(time, changes, done)))


def _lines(name: str, time: Float[np.ndarray, " time"], lines: Kinds, label: str) -> Panel:
    traces = [
        Trace(kind.replace("_", " "), time, values, f"series {index}")
        for index, (kind, values) in enumerate(lines.items())
        if largest(values) > 0.0
    ]
    zero = [kind.replace("_", " ") for kind, values in lines.items() if largest(values) == 0.0]
    unit, nothing = si_unit(largest(*lines.values()), "J"), "" if lines else "no energy recorded"
    panel = Panel(name, label, unit, tuple(traces), ZERO, tall=2.4, columns=6, nothing=nothing)
    return replace(panel, also=((f"zero: {', '.join(zero)}", "none"),) if zero else ())


def _balance(time: Float[np.ndarray, " time"], changes: Kinds, done: Kinds) -> Panel:
    scale = largest(*changes.values(), *done.values())
    if not changes or scale == 0.0:
        words = "no energy changes hands" if changes else "no energy recorded"
        return replace(_BALANCE, nothing=words)
    defect = sum(changes.values(), np.zeros(time.shape)) - sum(done.values(), np.zeros(time.shape))
    relative = defect / scale
    worst = largest(relative)
    power = math.floor(math.log10(worst)) if worst > 0.0 else 0
    summary = (
        f"change \N{MINUS SIGN} works, at most {worst:.1e} of the largest change or work, "
        f"{si_unit(scale, 'J').text(scale)}"
    )
    traces = (Trace("", time, relative, "ink", summary=summary),)
    panel = replace(_BALANCE, traces=traces, levels=ZERO)
    if not power:
        return panel
    unit = Unit(10.0**-power, f"{power_of_ten(power)} of scale")
    return replace(panel, label=f"{panel.label}\n", unit=unit)


def effort_chart(run: Result) -> Chart:
    """Return Newton iterations a step, with and without control."""
    traces = []
    for (label, member), role in zip(run.members, MEMBER_ROLES, strict=False):
        data = member.dataset
        if {"newton_iterations", "steps"} <= set(data):
            steps = np.asarray(data["steps"].values, float)
            spent = np.asarray(data["newton_iterations"].values, float)
            # of a step since the previous instant; 0 at the first
            found = np.divide(spent, steps, out=np.zeros_like(spent), where=steps > 0)
            traces.append(Trace(label, data["time"].values, found, role))
    high = 1.08 * largest(*(trace.values for trace in traces)) or 1.0
    nothing = "" if traces else "no iterations recorded"
    panel = replace(_ITERATIONS, traces=tuple(traces), high=high, nothing=nothing)
    return Chart("effort", "Solver", (panel,))


ABOUT = {channel.name: channel.axis for channel in CHANNEL_TABLE}
"""The axis that a channel moves along or turns about, which it has the colour of."""
_FEW = 5  # actuators of a panel up to which each has its name in the key
THROUGH = "... "  # before the name of the last of many actuators, only two of which are in the key
_LABELS = {
    "Pa": "pressure of\nchambers",
    "m3": "volume into\nchambers",
    "N": "tension of\ntendons",
    "m": "tendons\npulled in",
}
_STILL = 1e-9  # m or rad: less is no motion that anyone ordered
_COMMANDS: tuple[tuple[str, Literal["dashed"]], ...] = (("commands", "dashed"),)
_NEAR = 0.1  # distance up to which the end of a travel is drawn, of the height of the panel


def drive_chart(run: Result) -> Chart:
    """Return the chart of channels of the base, actuators, and the load on the base."""
    channels = moving_channels(run.dataset)
    groups, tall = [[channel] for channel in channels], 1.55
    if is_spatial(run.dataset):  # too many for a panel each
        shifts = [channel for channel in channels if channel not in ANGLES]
        turns = [channel for channel in channels if channel in ANGLES]
        groups, tall = [group for group in (shifts, turns) if group], 1.9
    drives: dict[tuple[type, str], list[ActuatorDrive]] = {}
    for each in actuator_drives(run):
        drives.setdefault((type(each.thread), each.unit), []).append(each)
    panels = [
        *(_group(run.dataset, group, tall) for group in groups),
        *(
            _actuators(f"actuators_{index}", each, run.dataset, tall)
            for index, each in enumerate(drives.values())
        ),
        _load(run, "base_force", "force", "N", tall),
        _load(run, "base_moment", "moment", "N m", tall),
    ]
    still = "" if groups or drives else "the base is held still: no channel moves"
    return Chart("commands", "Base and actuators", tuple(panels), still)


def _actuators(name: str, drives: Sequence[ActuatorDrive], data: xr.Dataset, tall: float) -> Panel:
    """Return the panel of actuators of one kind and unit: states as lines, commands dashed."""
    time, few = data["time"].values, len(drives) <= _FEW
    most = largest(*(part for each in drives for part in (each.state, each.command)))
    traces, commanded = [], False
    for index, each in enumerate(drives):
        role = f"part {index / max(1, len(drives) - 1):g}"
        quiet = not few and 0 < index < len(drives) - 1
        shown = each.name if few or not index or quiet else f"{THROUGH}{each.name}"
        traces.append(Trace(shown, time, each.state, role, quiet=quiet))
        if largest(each.command) > _STILL:
            words = f"{each.name}, command"
            traces.append(Trace(words, time, each.command, role, "dashed", quiet=True))
            commanded = True
    label, unit = _LABELS.get(drives[0].unit, "actuators"), drive_unit(drives[0].unit, most)
    label = "actuators" if drives[0].thread is None else label
    also = _COMMANDS if commanded else ()
    return Panel(name, label, unit, tuple(traces), tall=tall, also=also)


def moving_channels(data: xr.Dataset) -> list[str]:
    """Return the channels of the base that move or have commands."""
    if "channel" not in data.coords or not {"base_command", "base_pose"} <= set(data):
        return []
    parts = [data["base_pose"], data["base_command"]]
    channels = map(str, data["channel"].values)
    return [name for name in channels if any(_moves(part, name) for part in parts)]


def _moves(part: xr.DataArray, channel: str) -> bool:
    return largest(part.sel(channel=channel).values) > _STILL


def _group(data: xr.Dataset, channels: list[str], tall: float) -> Panel:
    """Return channels of one unit: servos as lines, commands dashed, prescribed poses dotted."""
    time, command, pose = data["time"].values, data["base_command"], data["base_pose"]
    servo = data["base_servo"]
    turns = channels[0] in ANGLES
    most = largest(*(part.sel(channel=channels).values for part in (command, servo, pose)))
    unit = DEGREES if turns else length_unit(most)
    traces, commanded = [], False
    for channel in channels:
        role = ABOUT[channel]
        ordered, reached, whole = (p.sel(channel=channel).values for p in (command, servo, pose))
        driven = _moves(servo, channel)
        if driven or _moves(command, channel):
            traces.append(Trace(channel, time, reached, role))
            words = f"{channel}, command"
            traces.append(Trace(words, time, ordered, role, "dashed", quiet=True))
            commanded = True
        if _moves(pose - servo, channel):
            words = f"{channel} as prescribed{' and driven' if driven else ''}"
            traces.append(Trace(words, time, whole, role, "dotted", reference=True))
    name, label = f"base_{'_'.join(channels)}", f"{'turn' if turns else 'shift'} of\nthe base"
    levels = tuple(_limits(data, channels, [trace.values for trace in traces]))
    also = _COMMANDS if commanded else ()
    return Panel(name, label, unit, tuple(traces), levels, tall=tall, also=also)


def _limits(data: xr.Dataset, channels: list[str], drawn: list[np.ndarray]) -> list[Level]:
    """Return the ends of the travel of channels that the traces come near."""
    if not drawn:
        return []
    low, high = min(map(np.nanmin, drawn)), max(map(np.nanmax, drawn))
    room = 2 * _NEAR * (high - low)
    levels = []
    for channel in channels:
        ends = [float(data[f"channel_{end}"].sel(channel=channel)) for end in ("lower", "upper")]
        for end in ends:
            if ends[0] < ends[1] and low - room <= end <= high + room:
                levels.append(Level(end, ABOUT[channel]))
    return levels


def _load(run: Result, name: str, word: str, unit: str, tall: float) -> Panel:
    data, label = run.dataset, f"{word} on\n{base_word(run.known_scenario)}"
    if name not in data:
        return Panel(name, label, si_unit(0.0, unit), tall=tall, nothing=f"no {word} recorded")
    traces = vector_traces(data, name, f"{word} ")
    return Panel(name, label, si_unit(largest(data[name].values), unit), traces, tall=tall)


def vector_traces(data: xr.Dataset, name: str, word: str = "") -> tuple[Trace, ...]:
    """Return a trace for each axis of a force or a moment, whose names begin with a word."""
    time, load = data["time"].values, data[name]
    if load.ndim == 1:  # a planar moment: about the one axis, positive as tilt
        return (Trace("", time, load.values, "ink"),)
    way = "along" if name.endswith("force") else "about"
    axes = map(str, data["axis"].values)
    return tuple(Trace(f"{word}{way} {a}", time, load.sel(axis=a).values, a) for a in axes)
