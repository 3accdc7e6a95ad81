"""Print the coverage table of `docs/how-to/estimate.md`: 20 seeds, estimates next to the truth.

python docs/make_coverage.py [SCENARIO ...]
"""

from __future__ import annotations

import sys

import numpy as np
import xarray as xr

import crinoid

SETTINGS = [
    "control.kind=lqg",
    "control.compare=false",
    "sensor.noise_position=0.001",
    "sensor.noise_angle_deg=0.1",
    "arm.nodes=9",
    "simulation.duration=12",
]
SETTLED = 4.0
"""Time from which instants count (s)."""
NORMAL = 1.96
"""Half of the 95 % interval of a normal law, over its standard deviation."""


def coverage(name: str, seeds: int = 20) -> dict[str, float]:
    """Return the share of instants at which the truth lies within 1.96 standard deviations."""
    runs = crinoid.simulate_batch(crinoid.load(name, SETTINGS), seeds=seeds, records=True)
    return covered(runs)


def covered(runs: xr.Dataset) -> dict[str, float]:
    """Return the coverage of tip, middle node and mean current by axis, over all runs."""
    flow = runs["flow_velocity"]
    ends = flow.isel(node=slice(1, None)).values + flow.isel(node=slice(-1)).values
    middle = runs.sizes["node"] // 2
    true = {
        "tip_position": runs["tip_position"].values,
        "position": runs["position"].isel(node=middle).values,
        "flow_velocity": np.mean(ends / 2, axis=2),
    }
    time, at = runs["time"].values, runs["estimate_time"].values
    found = {}
    for quantity, values in true.items():
        estimate, std = (runs[f"estimated_{quantity}{end}"] for end in ("", "_std"))
        if quantity == "position":
            estimate, std = (each.isel(node=middle) for each in (estimate, std))
        for index, axis in enumerate(map(str, runs["axis"].values)):
            shares = []
            for run in range(runs.sizes["run"]):
                # an estimate is of its command, a little before the instant that has it
                then = np.interp(at[run], time, values[run, :, index])
                error = np.abs(estimate.values[run, :, index] - then)
                late = at[run] > SETTLED
                shares.append(np.mean(error[late] < NORMAL * std.values[run, late, index]))
            found[f"{quantity} {axis}"] = float(np.mean(shares))
    return found


if __name__ == "__main__":
    for name in sys.argv[1:] or ("station-keeping", "tidal-channel", "wave-zone"):
        shares = coverage(name)
        cells = " | ".join(f"{100 * share:.0f}" for share in shares.values())
        print("| scenario |", " | ".join(shares), "|")
        print(f"| `{name}` | {cells} |", flush=True)
