"""PID, LQG and predictive control in water of 27 kinds, the same servos, sensor and delay.

    python benchmarks/controllers.py [plane | space] [SEEDS]

A swell of 0, 0.15 or 0.3 m/s, and turbulence that drifts past at 0.15 m/s, of 20, 50 or 80 % and
with a length scale of 0.2, 0.5 or 1 m, on the built-in `station-keeping` (`station-keeping-3d`)
with its gains. LQG is run without and with a sensor of the arm's shape, predictive control without
and with a meter of the current at the base. For each kind of water prints the RMS error of the tip
under the PID, and that of the others over it; then means, the worst ratios, and how much the inputs
moved.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from itertools import product
from typing import Any

import numpy as np

import crinoid
from crinoid.results.metrics import measured
from crinoid.simulation.batch import run_batch

SWELL = (0.0, 0.15, 0.3)
INTENSITY = (0.2, 0.5, 0.8)
LENGTH_SCALE = (0.2, 0.5, 1.0)
DRIFT = 0.15
SHAPE = {"kind": "shape", "stations": [0.25, 0.5, 0.75]}


def controllers(axes: int) -> dict[str, dict[str, Any]]:
    """Return the values of a scenario under each controller; the meter is at the base."""
    meter = {"kind": "current", "points": [[0.0] * axes]}
    return {
        "pid": {"control.kind": "pid"},
        "lqg": {"control.kind": "lqg"},
        "lqg, shape": {"control.kind": "lqg", "sensors": [SHAPE]},
        "mpc": {"control.kind": "mpc"},
        "mpc, meter": {
            "control.kind": "mpc",
            "control.mpc.current": "measured",
            "sensors": [meter],
        },
    }


def water(plane: bool, swell: float, intensity: float, scale: float) -> Mapping[str, Any]:
    """Return the values of a scenario in water of a kind."""
    if plane:
        values: dict[str, Any] = {
            "flow.0.amplitude": [swell, 0.0],
            "flow.1.mean": [DRIFT, 0.0],
        }
    else:
        values = {
            "flow.0.amplitude": [0.0, swell, 0.0],
            "flow.1.amplitude": [0.0, 0.0, 0.24 * swell],
            "flow.2.mean": [0.0, DRIFT, 0.0],
        }
    turbulence = f"flow.{1 if plane else 2}"
    own = {f"{turbulence}.intensity": intensity, f"{turbulence}.length_scale": scale}
    return values | own | {"control.compare": False}


def main(plane: bool, seeds: int) -> None:
    """Print a row for each kind of water, and a summary."""
    scenario = crinoid.load("station-keeping" if plane else "station-keeping-3d")
    settings = controllers(scenario.arm.dimension)
    heads = "".join(f"{name:>12}" for name in list(settings)[1:])
    print(f"swell intensity scale   pid (mm){heads}   over the PID")
    ratios, speeds = [], []
    for kind in product(SWELL, INTENSITY, LENGTH_SCALE):
        errors, moved = [], []
        for values in settings.values():
            case = scenario.with_values({**water(plane, *kind), **values})
            cases = [case.with_values({"seed": seed}) for seed in range(seeds)]
            arms = [arm.taken for arm in run_batch(cases, measured)]
            assert all(arm is not None for arm in arms), f"a run in {kind} failed"
            errors.append(np.mean([arm.numbers["rms_error"] for arm in arms if arm]))
            moved.append(np.mean([list(arm.speed.values()) for arm in arms if arm], axis=0))
        pid, *others = errors
        ratios.append(np.array(others) / pid)
        speeds.append(moved)
        row = "".join(f"{each:12.2f}" for each in ratios[-1])
        print(f"{kind[0]:5g} {kind[1]:9g} {kind[2]:5g} {1e3 * pid:10.2f}{row}", flush=True)
    for word, rows in (("mean", np.mean(ratios, axis=0)), ("worst", np.max(ratios, axis=0))):
        print(f"{word:32}" + "".join(f"{each:12.2f}" for each in rows))
    effort = np.mean(speeds, axis=0)
    effort = np.mean(effort[1:] / effort[0], axis=1)
    print(f"{'RMS speed of inputs, over PID':32}" + "".join(f"{each:12.2f}" for each in effort))


if __name__ == "__main__":
    main("space" not in sys.argv, int(sys.argv[-1]) if sys.argv[-1].isdecimal() else 10)
