"""An arm that hangs in a steady current, and MoorDyn's line."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.hanging_in_current import SPEEDS, scenario
from crinoid.validation.slender import MESHES, tip_of
from crinoid.view.figures.style import BLUE, VERMILLION, key

_SPEEDS = SPEEDS[:2]
_EDGES, _TIME_STEP, _INTERVAL, _DURATION = 20, 1e-3, 0.1, 30.0


def _run() -> Evidence:
    from crinoid.validation.moordyn import HangingLine, moordyn_tips

    checks, scenarios, ends, paths = [], {}, [], []
    for speed in _SPEEDS:
        scenarios[f"{speed:g}"] = arm = scenario(MESHES[-1], speed)
        rod, water = arm.arm, arm.water
        assert isinstance(rod.radius, float)
        area = np.pi * rod.radius**2
        line = HangingLine(
            length=rod.length,
            edges=_EDGES,
            diameter=2 * rod.radius,
            mass=rod.density * area,
            EA=rod.youngs_modulus * area,
            EI=rod.youngs_modulus * area * rod.radius**2 / 4,
            drag=water.drag_normal,
            density=water.density,
            gravity=water.gravity,
        )
        tips = moordyn_tips(
            line, speed, time_step=_TIME_STEP, interval=_INTERVAL, duration=_DURATION
        )
        theirs = tips[-1, [0, 2]]
        ours = tip_of(equilibrium(arm)) - [0.0, -10.0]
        ends.append(ours)
        paths.append(tips)
        text = f"{speed:g} m/s"
        checks += [
            Check(f"x of the tip, {text}", theirs[0], ours[0], 0.005, "m", True),
            Check(f"z of the tip, {text}", theirs[1], ours[1], 0.005, "m", True),
            Check(f"MoorDyn still moves, {text}", 0.0, np.ptp(tips[-20:, 0]), 1e-5, "m"),
        ]

    def draw(axes: Axes) -> None:
        time = _INTERVAL * np.arange(1, len(paths[0]) + 1)
        for tips, end in zip(paths, ends, strict=True):
            axes.plot(time, tips[:, 0], color=VERMILLION, label="MoorDyn, from rest")
            axes.axhline(end[0], color=BLUE, linestyle="--", label="crinoid, equilibrium")
        axes.set(xlabel="time (s)", ylabel="x of the tip (m)", xlim=(0.0, 10.0))
        key(axes)

    remarks = (
        f"At {SPEEDS[-1]:g} m/s the drag presses a part of the arm together, by up to 0.26 N. "
        "MoorDyn's lines do not resist compression, and its line does not come to rest.",
    )
    return Evidence(checks, None, scenarios, draw, remarks)


CASE = Case(
    name="moordyn-line",
    title="An arm that hangs in a steady current comes to rest where MoorDyn's line does.",
    source="MoorDyn 2.7.2, run in the case from the straight line until it is at rest.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; MoorDyn with {_EDGES} segments, steps of "
    f"{_TIME_STEP:g} s by RK4 and {_DURATION:g} s.",
    reason="Lumped masses have an error of order 2 in the length of a segment, L/20: 1/400, and "
    "twice that with the clamp.",
    kind="peer",
    run=_run,
    needs=("moordyn",),
)
