"""Charts of a live session: where the tip is from its target, and the inputs, lately."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from crinoid.actuation import Input
from crinoid.foundation.axes import ANGLES, AXES, CHANNELS
from crinoid.results.drives import drive_unit
from crinoid.results.units import DEGREES, Unit
from crinoid.scenario import Scenario
from crinoid.view.figures.charts.chart import Chart, Panel, Trace
from crinoid.view.figures.charts.drive import ABOUT
from crinoid.view.live.session_log import Snapshot

SPAN = 20.0  # simulated time in the charts (s)
_MILLIMETRES = Unit(1e3, "mm")


class LiveCharts:
    """Charts without values, and the values of their traces at an instant."""

    def __init__(self, scenario: Scenario, inputs: Sequence[Input]) -> None:
        self._axes = [AXES[3].index(axis) for axis in AXES[scenario.arm.dimension]]
        channels, present = CHANNELS[scenario.arm.dimension], scenario.base.channels.present
        self._servos = [i for i, name in enumerate(channels) if name in present]
        lines = [("tip error", _MILLIMETRES, "", "run")]
        lines += [("tip from target", _MILLIMETRES, AXES[3][i], AXES[3][i]) for i in self._axes]
        for name in (channels[index] for index in self._servos):
            label, unit = ("turn", DEGREES) if name in ANGLES else ("shift", _MILLIMETRES)
            lines.append((f"{label} of the base", unit, name, ABOUT[name]))
        drives = inputs[len(channels) :]
        for index, drive in enumerate(drives):
            ends = [abs(float(end)) for end in (drive.lower, drive.upper)]
            unit = drive_unit(drive.unit, max(filter(math.isfinite, ends), default=1.0))
            role = f"part {index / max(1, len(drives) - 1):g}"
            lines.append(("actuators", unit, drive.name, role))
        panels: dict[tuple[str, Unit], list[int]] = {}
        for index, line in enumerate(lines):
            panels.setdefault(line[:2], []).append(index)
        self._order = [index for some in panels.values() for index in some]
        self._factors = np.array([lines[index][1].factor for index in self._order])
        empty = [Trace(name, np.zeros(2), np.zeros(2), role) for _, _, name, role in lines]
        drawn = [
            Panel(label, label, unit, tuple(empty[index] for index in some))
            for (label, unit), some in panels.items()
        ]
        parts = ("tip", "Tip", drawn[:2]), ("inputs", "Base and actuators", drawn[2:])
        self.charts = [Chart(name, title, tuple(some)) for name, title, some in parts if some]

    def numbers(self, frame: Snapshot) -> Float[np.ndarray, " trace"]:
        """Return the values of all traces, each in the unit of its panel."""
        apart = (frame.nodes[-1] - frame.target)[self._axes]
        values = np.concatenate([[frame.error], apart, frame.servo[self._servos], frame.drive])
        return values[self._order] * self._factors
