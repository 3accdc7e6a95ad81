"""Cost of chambers in a time step: one, three round the section, and one on each edge.

Bare steps of an arm of 21 nodes in a uniform current, in the plane and in space, the pressures
going up; the arm without chambers in the same run.
"""

import argparse
import json
import time
from itertools import pairwise
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.compilation import OFTEN

RESULTS = Path(__file__).parent / "results"
NODES, STEPS = 21, 400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    parser.add_argument("--axes", type=int, nargs="+", default=[2, 3])
    options = parser.parse_args()
    table = Table(title="CPU time of a time step of 10 ms", title_justify="left")
    for column in ("arm", "chambers", "median us", "least us", "over none, least"):
        table.add_column(column, justify="right")
    kept = {}
    for axes in options.axes:
        runs = {name: steps(axes, chambers) for name, chambers in arms(axes).items()}
        took = {name: [] for name in runs}
        for _ in range(options.repeats):
            for name, run in runs.items():
                took[name].append(run())
        for name, each in took.items():
            row = (np.median(each), min(each), min(each) / min(took["none"]))
            numbers = (f"{row[0]:.1f}", f"{row[1]:.1f}", f"{row[2]:.2f}")
            table.add_row("plane" if axes == 2 else "space", name, *numbers)
        kept[axes] = took
    Console(highlight=False).print(table)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "chambers.json").write_text(json.dumps(kept, indent=2), "utf-8")


def arms(axes):
    """Return the chambers of each arm."""
    one = {"offset": 0.008, "area": 1e-4, "max_pressure": 1e4, "angle_deg": 90.0 * (axes == 3)}
    ends = np.linspace(0.0, 1.0, NODES).tolist()
    found = {"none": [], "one": [one]}
    if axes == 3:
        found["three"] = [one | {"angle_deg": angle} for angle in (0.0, 120.0, 240.0)]
    return found | {"one an edge": [one | {"span": span} for span in pairwise(ends)]}


def steps(axes, chambers):
    """Return a function that gives the time of a step (us)."""
    current = {"kind": "uniform", "velocity": [0.2] + [0.0] * (axes - 1)}
    arm = {"dimension": axes, "nodes": NODES}
    system = crinoid.system(crinoid.Scenario(arm=arm, flow=[current], chamber=chambers))
    channels = len(system.inputs) - len(chambers)
    command, state = jnp.zeros(len(system.inputs)).at[channels:].set(0.3), system.rest()

    @eqx.filter_jit(compiler_options=OFTEN)
    def march(system, state):
        return jax.lax.scan(lambda s, _: (system.step(s, command)[0], None), state, length=STEPS)

    def run():
        begun = time.process_time()
        jax.block_until_ready(march(system, state)[0].position)
        return 1e6 * (time.process_time() - begun) / STEPS

    run()
    return run


if __name__ == "__main__":
    main()
