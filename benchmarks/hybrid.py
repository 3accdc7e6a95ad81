"""From when on the arm of the built-in scenario `swing-up` stays upright, over ten starts.

python benchmarks/hybrid.py
"""

from __future__ import annotations

import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation.batch import run_batch

STARTS = 10
MEDIA = {"in water": 1025.0, "in air": 0.0}


def start(seed: int, density: float) -> Scenario:
    """Return the scenario with a force at its start that is drawn at random."""
    random = np.random.default_rng(seed)
    return crinoid.load("swing-up").with_values(
        {
            "seed": seed,
            "water.density": density,
            "load.0.force": [float(random.uniform(-0.3, 0.3)), float(random.uniform(-0.3, 0.0))],
            "load.0.stop": float(random.uniform(0.2, 1.0)),
            "control.compare": False,
        }
    )


def upright_from(result: Result, within: float = 3.0) -> float:
    """Return from when on tip and chord stay within some degrees of upright (s)."""
    data = result.dataset
    reach = (data["tip_position"] - data["position"].isel(node=0)).values
    chord = np.rad2deg(np.arctan2(reach[:, 0], reach[:, 1]))
    tip = np.mod(np.rad2deg(data["tip_angle"].values) + 90.0, 360.0) - 180.0
    outside = np.flatnonzero(np.maximum(np.abs(chord), np.abs(tip)) > within)
    return float(data["time"][outside[-1]]) if outside.size else 0.0


def main() -> None:
    """Run all starts and print the times."""
    table = Table(caption="upright within 3 degrees from then on (s)")
    table.add_column("start", justify="right")
    found = {}
    for medium, density in MEDIA.items():
        table.add_column(medium, justify="right")
        arms = run_batch([start(seed, density) for seed in range(STARTS)], upright_from)
        found[medium] = [arm.status if arm.taken is None else f"{arm.taken:.1f}" for arm in arms]
    for seed, times in enumerate(zip(*found.values(), strict=True)):
        table.add_row(str(seed), *times)
    Console().print(table)


if __name__ == "__main__":
    main()
