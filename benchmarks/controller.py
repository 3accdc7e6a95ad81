"""Cost of a controller by how often it is due: it is evaluated then, and not at each time step.

A controller that computes for some hundred microseconds, as one with a model does, in the closed
loop of `planar.toml` at 100 and at 20 commands a second, and one that commands nothing.
"""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.control import Idle
from crinoid.numerics.small_matrices import product
from crinoid.simulation.chunk import fast_chunk
from crinoid.simulation.setup import set_up

HERE = Path(__file__).parent
STEPS = 1000
SIZE, SWEEPS = 24, 40


class Busy(crinoid.Controller):
    """Commands nothing, after as many products as a receding horizon may take."""

    def start(self, seen):
        return jnp.full(SIZE, 1.0 / SIZE)

    def command(self, memory, seen):
        matrix = jnp.eye(SIZE) + 1e-9 * seen.measured[0]
        swept = jax.lax.fori_loop(0, SWEEPS, lambda _, x: jnp.tanh(product(matrix, x)), memory)
        return 0.0 * seen.command + 0.0 * jnp.sum(swept), swept


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    cases = {
        "nothing": (Idle(), 100.0),
        "100 a second": (Busy(), 100.0),
        "20 a second": (Busy(), 20.0),
    }
    runs = {name: loop(*case) for name, case in cases.items()}
    took = {name: [] for name in runs}
    for _ in range(options.repeats):
        for name, run in runs.items():
            begun = time.process_time()
            run()
            took[name].append(1e6 * (time.process_time() - begun) / STEPS)
    table = Table(title="CPU time of a time step of 10 ms", title_justify="left")
    for column in ("controller", "median us", "least us", "controller alone, least"):
        table.add_column(column, justify="right")
    idle = min(took["nothing"])
    for name, each in took.items():
        row = (np.median(each), min(each), min(each) - idle)
        table.add_row(name, *(f"{value:.1f}" for value in row))
    console = Console(highlight=False)
    console.print(table)
    share = (min(took["20 a second"]) - idle) / (min(took["100 a second"]) - idle)
    console.print(f"20 a second cost {share:.2f} of 100 a second")
    results = HERE / "results"
    results.mkdir(exist_ok=True)
    (results / "controller.json").write_text(json.dumps(took, indent=2), "utf-8")


def loop(controller, rate):
    """Return a function that runs the closed loop on from its start."""
    scenario = crinoid.load(HERE / "planar.toml").with_values(
        {"control.kind": "custom", "control.rate_hz": rate}
    )
    setup = set_up(Prepared(scenario, Parts(controller=controller)))
    carry = setup.loop.start(setup.state)
    numbers = [jnp.asarray(number, int) for number in (STEPS, STEPS)]

    def run():
        jax.block_until_ready(fast_chunk(setup.loop, carry, *numbers, 1)[0].steps)

    run()
    return run


if __name__ == "__main__":
    main()
