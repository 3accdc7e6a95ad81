"""A rigid cylinder that sinks or rises broadside from rest."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import BLUE, INK, VERMILLION
from validation.case import Check, Evidence, case
from validation.slender import order_of

_DIAMETER, _DRAG, _GRAVITY, _DENSITY, _ADDED = 0.01, 1.1, 9.81, 1000.0, 1.0
_AREA = np.pi / 4 * _DIAMETER**2
_RELATIVE = (1.2, 0.4)
"""Density over that of the water."""
_STEPS = (0.02, 0.01)
_DURATION, _EARLY = 2.0, 0.2


def _scenario(relative: float, step: float) -> Scenario:
    section = {"EI": 1e3, "EA": 1e5, "diameter": _DIAMETER, "displaced_area": _AREA}
    section |= {"mass_per_length": relative * _DENSITY * _AREA}
    return Scenario(
        arm={"nodes": 5, "length": 0.2, "damping_time": 0.0, "section": section},
        water={"density": _DENSITY, "gravity": _GRAVITY, "drag_normal": _DRAG}
        | {"added_mass_normal": _ADDED},
        vehicle={"mass": 1e-9, "inertia": 1e-9},
        simulation={"duration": _DURATION, "time_step": step, "start": "rest"},
        output={"interval": step},
    )


@case(
    kind="exact",
    title="A cylinder let go broadside in still water sinks or rises toward its terminal speed.",
    source="Balance of weight, buoyancy, drag and added mass: v = v_t tanh(a t/v_t), first "
    "acceleration a = (1 - s) g/(s + Ca), v_t^2 = pi d g |s - 1|/(2 Cd), for a density of s times "
    "that of the water.",
    method="Run of 2 s of a stiff arm of 0.2 m, d = 10 mm, Cd = 1.1, Ca = 1, with 5 nodes, on a "
    f"vehicle of 1e-9 kg, in steps of {_STEPS[-1]:g} s; the order is from {_STEPS[0]:g} and "
    f"{_STEPS[-1]:g} s.",
    reason="The vehicle adds 1e-6 of an edge to the mass. The trapezoid rule errs by (time step "
    "a/v_t)^2/12. Newton's tolerance of 1e-8 leaves at most 1e-7 of the terminal speed.",
)
def falling_cylinder() -> Evidence:
    checks, scenarios, curves, orders = [], {}, [], []
    for relative in _RELATIVE:
        acceleration = (1.0 - relative) * _GRAVITY / (relative + _ADDED)
        terminal = np.sqrt(np.pi * _DIAMETER * _GRAVITY * abs(relative - 1.0) / (2.0 * _DRAG))
        settling = terminal / abs(acceleration)
        errors = []
        for step in _STEPS:
            scenario = _scenario(relative, step)
            data = simulate(scenario).dataset
            time, speed = data["time"].values, data["velocity"].values[:, -1, 1]
            exact = np.copysign(terminal * np.tanh(time / settling), acceleration)
            errors.append(float(np.abs(speed - exact).max()))
        early = int(np.argmin(np.abs(time - _EARLY)))
        first = float(data["acceleration"].values[0, -1, 1])
        text, within = f"density {relative:g}", terminal * (_STEPS[-1] / settling) ** 2 / 12
        checks += [
            Check(f"first acceleration, {text}", acceleration, first, 2e-6, "m/s2", True),
            Check(f"speed at {_EARLY:g} s, {text}", exact[early], speed[early], within, "m/s"),
            Check(f"terminal speed, {text}", terminal, abs(speed[-1]), 1e-7, "m/s", True),
        ]
        scenarios[f"{relative:g}"] = scenario
        curves.append((relative, time, speed, exact))
        orders.append(order_of(errors))
    checks += [
        Check(f"order in the time step, density {relative:g}", 2.0, order, 0.1)
        for relative, order in zip(_RELATIVE, orders, strict=True)
    ]

    def draw(axes: Axes) -> None:
        for (relative, time, speed, exact), colour in zip(curves, (BLUE, VERMILLION), strict=True):
            shown = time <= 1.0
            name = f"crinoid, {relative:g} of water"
            axes.plot(time[shown], speed[shown], color=colour, label=name)
            axes.plot(time[shown][::5], exact[shown][::5], "o", mfc="none", color=INK, ms=4)
        axes.lines[-1].set_label("exact")
        axes.set(xlabel="time (s)", ylabel="speed upward (m/s)")

    return Evidence(checks, min(orders), scenarios, draw)
