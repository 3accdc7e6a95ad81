"""A scenario under another controller, with what that takes where it has none of its own."""

import math
from typing import Any

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.scenario.hybrid import inclinations
from crinoid.scenario.sensor import InclinationSensor
from crinoid.simulation.margin import factor_for
from crinoid.simulation.setup import Setup, set_up

__all__ = ["controlled_by"]

_CROSSOVER = 1.0
"""Frequency (Hz) at which the loop crosses over where the margin allows it."""
_MODULUS = 0.4
"""Modulus margin that shipped gains leave at least."""
_KP, _KD = 0.25, 0.5
"""Proportional gain over ``ki / w`` and derivative gain over ``ki / w^2``, ``w`` the first natural
frequency (rad/s): in four built-in scenarios they let ``ki`` be 1.4 to 2 times as large."""
_PID = "control.pid."
_STATIONS = tuple(station / 10 for station in range(11))
"""Where a hybrid controller sees the inclination of an arm whose scenario does not say."""


def controlled_by(scenario: Scenario, kind: str) -> Scenario:
    """Return a scenario under a kind of controller, and without the run for comparison.

    A PID that the scenario has no gains for drives every input that moves what is controlled, all
    with the same gains. Through the static Jacobian each of them sees a plant of gain one, so
    ``ki`` is where the loop crosses over (rad/s): 1 Hz, or as much less as leaves a modulus margin
    of 0.4 in the linear loop (`crinoid.simulation.margin`). Beside it ``kp = ki / 4 w``,
    ``kd = ki / 2 w^2`` and a filter of the derivative at ``w``, the arm's first natural frequency.

    A hybrid controller sees by inclinations along the arm: at eleven stations, without noise, where
    the scenario has no such sensor.
    """
    values: dict[str, Any] = {"control.kind": kind, "control.compare": False}
    if kind == "none" and scenario.target.feed_forward:
        values["target.feed_forward"] = False
    if kind == "hybrid" and inclinations(scenario) is None:
        sensor = InclinationSensor(kind="inclination", stations=_STATIONS)
        values["sensors"] = [*scenario.sensors, sensor]
    if kind != "pid" or scenario.control.pid.present:
        return scenario.with_values(values)
    start = 2 * math.pi * _CROSSOVER
    names, setup = _driven(scenario, values)
    if setup is not None and setup.open_loop is not None and setup.modes is not None:
        first = float(f"{setup.modes.frequency[0]:.2g}")
        trial = scenario.with_values(values | {"control.pid": _gains(names, start, first)})
        loop = set_up(Prepared(trial)).open_loop
        factor = 0.0 if loop is None else factor_for(loop, _MODULUS)
        if factor:
            gains = _gains(names, _rounded_down(factor * start), first)
            return scenario.with_values(values | {"control.pid": gains})
    text = "missing, and none were found that leave a margin; kind pid takes gains"
    raise ScenarioError([Mistake("control.pid", text)])


def _driven(scenario: Scenario, values: dict[str, Any]) -> tuple[list[str], Setup | None]:
    """Return the inputs that move what is controlled, and the loop that drives them."""
    names = [*scenario.base.channels.present, *scenario.thread_names]
    while names:
        try:
            gains = {"control.pid": _gains(names, 1.0, 1.0)}
            return names, set_up(Prepared(scenario.with_values(values | gains)))
        except ScenarioError as error:
            idle = {mistake.key.removeprefix(_PID) for mistake in error.mistakes}
            if not idle <= set(names):
                raise
            names = [name for name in names if name not in idle]
    return names, None


def _gains(names: list[str], ki: float, first: float) -> dict[str, dict[str, float]]:
    """Return the same gains for all inputs, for a first natural frequency (Hz)."""
    slow = 1 / (2 * math.pi * first)
    kp, kd = (float(f"{gain:.2g}") for gain in (_KP * ki * slow, _KD * ki * slow**2))
    return {name: {"kp": kp, "ki": ki, "kd": kd, "derivative_filter_hz": first} for name in names}


def _rounded_down(number: float) -> float:
    """Return a number with two digits."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.floor(number / unit + 1e-9) * unit:.6g}")
