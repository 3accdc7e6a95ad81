"""Charts of the tip's error, and its spectrum."""

from dataclasses import replace
from typing import Literal

import numpy as np
import xarray as xr

from crinoid.foundation.axes import AXES
from crinoid.results.errors import error_word, judged_or_all, off_direction
from crinoid.results.result import Result
from crinoid.results.scene.scene import CALM
from crinoid.results.units import DEGREES, Unit, largest, length_unit, si_unit, without_round_off
from crinoid.view.figures.charts.chart import MEMBER_ROLES, ZERO, Chart, Level, Panel, Trace, rms
from crinoid.view.figures.charts.spectra import miss

_ROOM = 1.08  # of an axis, above the largest value
_ERROR = Panel("tip_error", "tip error", low=0.0, tall=2.25, columns=1)
_MISS = Panel("tip_miss", "tip \N{MINUS SIGN} target", levels=ZERO, tall=2.25)
_DIRECTION = Panel("tip_direction", "tip direction", levels=ZERO, low=-_ROOM, high=_ROOM, tall=2.0)
_OFF = Panel("tip_off_direction", "tip off\ndirection", DEGREES, low=0.0, tall=1.8, columns=1)
_WATER = Panel("tip_water", "water speed\nat tip", Unit(1.0, "m/s"), tall=1.45)


def tip_chart(run: Result) -> Chart:
    """Return errors of the tip's position and direction, and the water's speed at the tip."""
    spatial = "tip_direction" in run.dataset
    panels = [_error(run), _components(run)]
    panels += [_direction(run)] if spatial else []
    return Chart("tip_error", "Tip", (*panels, _off_direction(run), _speed(run.dataset)))


def _error(run: Result) -> Panel:
    errors = [
        without_round_off(each.dataset["tip_error"].values, run.known_scenario.arm.length)
        for _, each in run.members
    ]
    unit = length_unit(largest(*errors))
    scenario = run.known_scenario
    tolerance = scenario.target.tolerance
    traces = []
    levels = [] if tolerance is None else [Level(tolerance, "ink")]
    # the run without control is drawn behind, as the reference
    for (label, each), values, role in zip(run.members, errors, MEMBER_ROLES, strict=False):
        data = each.dataset
        judged = values[judged_or_all(each)]
        mean = rms(judged)
        summary = f"RMS {unit.text(mean)} (dashed), maximum {unit.text(largest(judged))}"
        if tolerance is not None:
            near, share = length_unit(tolerance).text(tolerance), np.mean(judged <= tolerance)
            summary += f", {100 * share:.3g} % within {near}"
        traces.append(Trace(label, data["time"].values, values, role, summary=summary))
        levels.append(Level(mean, role, "dashed"))
    high = None if largest(*errors) > 0 else 1.0 / unit.factor
    panel = replace(_ERROR, label=error_word(scenario), unit=unit, high=high)
    aside = scenario.judged_from or None
    return replace(panel, traces=tuple(traces), levels=tuple(levels), aside=aside)


def _components(run: Result) -> Panel:
    misses = [(label, each.dataset, miss(run, each.dataset)) for label, each in run.members]
    unit = length_unit(largest(*(away for _, _, away in misses)))
    traces = []
    for label, data, away in misses:
        free = label == "without control"
        for axis in map(str, data["axis"].values):
            name, part = f"{axis}, {label}" if label else axis, away[:, AXES[3].index(axis)]
            traces.append(Trace(name, data["time"].values, part, axis, reference=free))
    columns = 2 if len(misses) > 1 else len(AXES[3])
    label = _MISS.label if run.known_scenario.aims else "tip \N{MINUS SIGN} start"
    panel = replace(_MISS, label=label, unit=unit, traces=tuple(traces), columns=columns)
    still = largest(*(away for _, _, away in misses)) == 0.0
    return replace(panel, low=-1.0 / unit.factor, high=1.0 / unit.factor) if still else panel


def _direction(run: Result) -> Panel:
    data, word = run.dataset, "target" if run.known_scenario.aims else "start"
    aimed, traces = "tip_direction_target" in data, []
    for axis in AXES[3]:
        part = data["tip_direction"].sel(axis=axis).values
        traces.append(Trace(axis, data["time"].values, part, axis))
        if aimed:
            wanted = data["tip_direction_target"].sel(axis=axis).values
            words = f"{axis} of the {word}"
            traces.append(Trace(words, data["time"].values, wanted, axis, "dashed", quiet=True))
    also: tuple[tuple[str, Literal["dashed"]], ...] = ((word, "dashed"),)
    return replace(_DIRECTION, traces=tuple(traces), also=also if aimed else ())


def _off_direction(run: Result) -> Panel:
    traces = []
    for (label, each), role in zip(run.members, MEMBER_ROLES, strict=False):
        data, off = each.dataset, off_direction(each.dataset)
        if off is not None:
            off = without_round_off(off, 1.0)
            judged = off[judged_or_all(each)]
            most = DEGREES.text(largest(judged))
            summary = f"RMS {DEGREES.text(rms(judged))}, maximum {most}"
            traces.append(Trace(label, data["time"].values, off, role, summary=summary))
    high = _ROOM * largest(*(trace.values for trace in traces)) or 1.0 / DEGREES.factor
    nothing = "" if traces else "no direction recorded"
    label = _OFF.label if run.known_scenario.aims else "turn of\nthe tip"
    return replace(_OFF, label=label, traces=tuple(traces), high=high, nothing=nothing)


def _speed(data: xr.Dataset) -> Panel:
    if "flow_velocity" not in data:
        return replace(_WATER, nothing="no flow recorded")
    speed = np.linalg.norm(data["flow_velocity"].isel(node=-1).values, axis=-1)
    top = largest(speed)
    summary = f"mean {si_unit(1.0, 'm/s').text(float(np.nanmean(speed)))}"
    traces = (Trace("", data["time"].values, speed, "ink", summary=summary),)
    high, nothing = _ROOM * top or 1.0, "" if top > CALM else "still water"
    return replace(_WATER, traces=traces, low=0.0, high=high, nothing=nothing)
