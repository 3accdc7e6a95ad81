"""Chart of a floating submarine: its motion, and the forces and moments of its thrusters."""

from crinoid.foundation.axes import ANGLES
from crinoid.results.result import Result
from crinoid.results.units import DEGREES, largest, length_unit, si_unit
from crinoid.view.figures.charts.chart import ZERO, Chart, Level, Panel, Trace
from crinoid.view.figures.charts.drive import ABOUT, vector_traces

_NEAR = 0.5  # share of a limit from which it is drawn


def vehicle_chart(run: Result) -> Chart | None:
    """Return the motion and the thrusters of a submarine; None where no submarine floats."""
    if "vehicle_pose" not in run.dataset:
        return None
    vehicle = run.known_scenario.vehicle
    channels = [str(channel) for channel in run.dataset["channel"].values]
    shifts = [channel for channel in channels if channel not in ANGLES]
    panels = [_motion(run, shifts), _motion(run, [c for c in channels if c in ANGLES])]
    if vehicle is not None and vehicle.hold == "thrusters":
        panels.append(_thrust(run, "thruster_force", "N", vehicle.max_force))
        panels.append(_thrust(run, "thruster_moment", "N m", vehicle.max_moment))
    return Chart("vehicle", "Submarine", tuple(panels))


def _motion(run: Result, channels: list[str]) -> Panel:
    data, turns = run.dataset, channels[0] in ANGLES
    parts = {name: data["vehicle_pose"].sel(channel=name).values for name in channels}
    unit = DEGREES if turns else length_unit(largest(*parts.values()))
    traces = tuple(
        Trace(name, data["time"].values, values, ABOUT[name]) for name, values in parts.items()
    )
    name, word = ("vehicle_turn", "turn") if turns else ("vehicle_shift", "shift")
    return Panel(name, f"{word} of the\nsubmarine", unit, traces, ZERO)


def _thrust(run: Result, name: str, unit: str, limit: float | None) -> Panel:
    most, levels = largest(run.dataset[name].values), list(ZERO)
    if limit is not None and most >= _NEAR * limit:
        levels += [Level(limit, "ink"), Level(-limit, "ink")]
    label = f"thrusters'\n{name.removeprefix('thruster_')}"
    traces = vector_traces(run.dataset, name)
    return Panel(name, label, si_unit(most, unit), traces, tuple(levels))
