"""PID, LQG and predictive control in water that sheds vortices and in water that does not.

    python benchmarks/vortices.py [SEEDS] [MODEL]

The built-in `station-keeping-3d` in a steady current across the arm of three speeds with a little
turbulence, instead of its swell. Prints the RMS error of the tip, its mean over the seeds and the
worst of them, without and with vortices; and the RMS error across arm and current alone, where
the lift acts.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import xarray as xr

import crinoid
from crinoid.results.result import Result
from crinoid.simulation.batch import run_batch

SPEEDS = (0.08, 0.12, 0.2)
CONTROLLERS = ("none", "pid", "lqg", "mpc")


def errors_of(result: Result) -> tuple[float, float]:
    """Return the RMS errors of a run after 5 s: of the tip, and across arm and current (m)."""
    late = result.dataset.sel(time=slice(5.0, None))
    off: xr.DataArray = late["tip_position"] - late["tip_target"]
    squares = (off**2).mean("time")
    return float(np.sqrt(squares.sum())), float(np.sqrt(squares.sel(axis="z")))


def measured(scenario: crinoid.Scenario, values: dict[str, Any], seeds: int) -> np.ndarray:
    """Return mean and worst error, and the mean across arm and current, over the seeds (mm)."""
    cases = [scenario.with_values({**values, "seed": seed}) for seed in range(seeds)]
    runs = [run.taken for run in run_batch(cases, errors_of)]
    assert all(run is not None for run in runs), f"a run with {values} failed"
    tip, across = np.array(runs).T
    return 1e3 * np.array([tip.mean(), tip.max(), across.mean()])


def main(seeds: int, model: str) -> None:
    """Print a row for each speed and controller."""
    print(f"{seeds} seeds, {model}; errors of the tip in mm: mean, worst, mean across the current")
    print(f"{'m/s':>5} {'':6}{'without vortices':>26}{'with vortices':>26}")
    for speed in SPEEDS:
        scenario = crinoid.load("station-keeping-3d").with_values(
            {
                "flow": [
                    {"kind": "turbulence", "mean": [0.0, speed, 0.0], "intensity": 0.1,
                     "length_scale": 1.0, "ramp_time": 3.0},
                ],
                "control.compare": False,
                "simulation.duration": 25.0,
            }
        )  # fmt: skip
        for kind in CONTROLLERS:
            cells = ""
            for vortices in (None, {"model": model}):
                values = {"control.kind": kind, "water.vortices": vortices}
                mean, worst, across = measured(scenario, values, seeds)
                cells += f"{mean:10.2f}{worst:8.2f}{across:8.2f}"
            print(f"{speed:5g} {kind:6}{cells}", flush=True)


if __name__ == "__main__":
    words = [word for word in sys.argv[1:] if not word.isdecimal()]
    numbers = [int(word) for word in sys.argv[1:] if word.isdecimal()]
    main(*(numbers or [10]), *(words or ["synchronisation"]))
