"""Controllers: the time of a command, and tip errors in water with and without vortices."""

import numpy as np

from benchmarks.measurement import Rows, Scope, over_seeds, row
from benchmarks.step import ARMS
from crinoid.assembly.prepared import Prepared
from crinoid.results.result import Result
from crinoid.scenario import load
from crinoid.simulation.loop import controller_cpu_time
from crinoid.simulation.setup import set_up

_SPEEDS = (0.08, 0.12, 0.2)
"""Speeds of the current across the arm (m/s)."""
_SETTLED, _DURATION = 5.0, 25.0
"""Time from which errors count, and that of a run (s)."""


def benchmark(scope: Scope) -> Rows:
    """Yield times of a command, then RMS errors of `station-keeping-3d` over seeds.

    They are errors of the tip, and those across arm and current alone, where the lift acts.
    """
    for name in list(ARMS.values())[: scope.most]:
        for kind in ("pid", "lqg", "mpc", "neural"):
            setup = set_up(Prepared(load(name).with_values({"control.kind": kind})))
            times = [controller_cpu_time(setup.loop, setup.state) for _ in range(scope.repeats)]
            yield row(f"{name}, {kind}", "CPU time of a command", "s", times)
    for speed in _SPEEDS[: scope.most]:
        flow = {"kind": "turbulence", "mean": [0.0, speed, 0.0], "intensity": 0.1}
        flow |= {"length_scale": 1.0, "ramp_time": 3.0}
        duration = _DURATION if scope.duration is None else _SETTLED + scope.duration
        water = {"flow": [flow], "simulation.duration": duration, "control.compare": False}
        for kind in ("none", "pid", "lqg", "mpc")[: scope.most]:
            for words, vortices in (("", None), (", vortices", {"model": "synchronisation"})):
                values = water | {"control.kind": kind, "water.vortices": vortices}
                scenario = load(ARMS["space"]).with_values(values)
                errors = np.array(over_seeds(scenario, scope.seeds, _errors)).T
                name = f"{speed:g} m/s, {kind}{words}"
                for quantity, each in zip(("tip error", "tip error across"), errors, strict=True):
                    yield row(name, f"{quantity}, RMS", "m", each, seeds=scope.seeds)
                yield row(name, "tip error, RMS, mean over seeds", "m", [errors[0].mean()])


def _errors(result: Result) -> tuple[float, float]:
    late = result.dataset.sel(time=slice(_SETTLED, None))
    squares = ((late["tip_position"] - late["tip_target"]) ** 2).mean("time")
    return float(np.sqrt(squares.sum())), float(np.sqrt(squares.sel(axis="z")))
