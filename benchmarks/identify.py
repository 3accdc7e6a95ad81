"""How often `crinoid identify` finds the numbers of an arm within its own error bars.

    python benchmarks/identify.py [DRAWS]

Runs the built-in `bend-test`, whose sensor is noisy, with one seed for each draw, and looks for
five of its numbers from others, up to 1.6 times too large or too small. Prints how far what was
found is off, in standard errors; a draw counts if all five lie within 95 % intervals that hold all
five at once (each 99 %, Bonferroni), and single numbers within their own 95 % intervals.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.inverse.identification import Identification
from crinoid.inverse.record import read_record
from crinoid.inverse.unknowns import Unknowns

NAME = "bend-test"
KEYS = (
    "arm.youngs_modulus",
    "arm.damping_time",
    "water.drag_normal",
    "water.added_mass_normal",
    "chamber.0.area",
)
OFF = 0.5
"""Largest logarithm by which the search begins beside the truth."""
ONE, ALL = 1.959964, 2.575829
"""Half of an interval that holds 95 %, and 99 %, over the standard deviation."""


def main(draws: int) -> None:
    """Print a row for each draw, and how many count."""
    scenario = crinoid.load(NAME)
    inputs = Prepared(scenario).system.inputs
    apart = []
    print(f"{'seed':>4} {'trials':>6} {'s':>5}  off, in standard errors")
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        with tempfile.TemporaryDirectory() as folder:
            crinoid.simulate(scenario.with_values({"seed": seed})).save(Path(folder))
            record = read_record(Path(folder), scenario, inputs)
        truth, began = Unknowns(scenario, KEYS).given, time.perf_counter()
        wrong = truth * np.exp(rng.uniform(-OFF, OFF, len(KEYS)))
        begun = scenario.with_values(dict(zip(KEYS, map(float, wrong), strict=True)))
        found = Identification(begun, KEYS, [record])
        assert found.run(lambda *_: None, lambda: False)
        data = found.dataset("ok")
        z = (np.log(data["found"].values / truth)) / np.sqrt(np.diag(found.covariance()))
        apart.append(z)
        taken = time.perf_counter() - began
        row = "".join(f"{each:7.2f}" for each in z)
        print(f"{seed:4} {found.trials:6} {taken:5.1f} {row}", flush=True)
    size = np.abs(apart)
    print(
        f"all five within their joint 95 % intervals: {(size < ALL).all(axis=1).sum()} of {draws}"
    )
    print(f"single numbers within their 95 % intervals: {(size < ONE).mean():.0%}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10)
