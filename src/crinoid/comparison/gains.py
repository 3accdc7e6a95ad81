"""A scenario under another controller, with gains where it has none of its own."""

from __future__ import annotations

import math
from typing import Any

from crinoid.assembly.prepared import Prepared
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation.margin import factor_for
from crinoid.simulation.setup import set_up

_CROSSOVER = 1.0
"""Frequency (Hz) at which an input that the tip follows at once would be let to act in full."""
_MODULUS = 0.4
"""Modulus margin that shipped gains leave at least."""
_PID = "control.pid."


def controlled_by(scenario: Scenario, kind: str) -> Scenario:
    """Return a scenario under a kind of controller, and without the run for comparison.

    A PID that the scenario has no gains for acts by integration alone, on every input that moves
    what is controlled. Through the static Jacobian each of them sees a plant of gain one, so the
    gain is where the loop crosses over: 1 Hz, or as much less for all alike as leaves a modulus
    margin of 0.4 in the linear loop (`crinoid.simulation.margin`).

    Raises
    ------
    ScenarioError
        If the scenario does not go with that kind, or no such gains are found.
    """
    values: dict[str, Any] = {"control.kind": kind, "control.compare": False}
    if kind == "none" and scenario.target.feed_forward:
        values["target.feed_forward"] = False
    if kind != "pid" or scenario.control.pid.present:
        return scenario.with_values(values)
    start = 2 * math.pi * _CROSSOVER
    names = [*scenario.base.channels.present, *scenario.thread_names]
    while names:
        trial = scenario.with_values(values | {"control.pid": _alike(names, start)})
        try:
            loop = set_up(Prepared(trial)).open_loop
        except ScenarioError as error:
            idle = {mistake.key.removeprefix(_PID) for mistake in error.mistakes}
            if not idle <= set(names):
                raise
            names = [name for name in names if name not in idle]  # which move nothing
            continue
        factor = 0.0 if loop is None else factor_for(loop, _MODULUS)
        if not factor:
            break
        gain = _rounded_down(factor * start)
        return scenario.with_values(values | {"control.pid": _alike(names, gain)})
    text = "missing, and no integral gains were found that leave a margin; kind pid takes gains"
    raise ScenarioError([Mistake("control.pid", text)])


def _alike(names: list[str], gain: float) -> dict[str, dict[str, float]]:
    return {name: {"ki": gain} for name in names}


def _rounded_down(number: float) -> float:
    """Return a number with two digits."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 1)
    return float(f"{math.floor(number / unit + 1e-9) * unit:.6g}")
