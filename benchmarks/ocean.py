"""Cost of turbulence, waves, a measured current and obstacles, over a uniform current.

One time step of the closed loop of `planar.toml`, its current replaced, run by the same
compiled program as `crinoid run`; and how often Newton's method iterates.
"""

import argparse
import json
import math
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.simulation.chunk import fast_chunk
from crinoid.simulation.setup import set_up
from step import PLANAR, RESULTS, instants

PLAIN = "uniform current"
MEAN = [0.25, 0.0]
UNIFORM = {"kind": "uniform", "velocity": MEAN, "ramp_time": 3.0}
RECORD = Path(crinoid.__file__).parent / "scenario" / "library" / "tidal-channel.nc"
RADIUS = 0.015
"""Radius of a drifting body (m)."""


def turbulence(modes: int) -> dict[str, Any]:
    return {
        "kind": "turbulence",
        "mean": MEAN,
        "intensity": 0.2,
        "length_scale": 0.5,
        "modes": modes,
        "ramp_time": 3.0,
    }


def body(x: float, z: float) -> dict[str, Any]:
    """Describe a body that neither sinks nor rises."""
    mass = 1025.0 * 4 / 3 * math.pi * RADIUS**3
    place = {"position": [x, z], "radius": RADIUS, "mass": mass, "velocity": "flow"}
    return {"kind": "sphere", **place}


CASES: dict[str, dict[str, Any]] = {
    PLAIN: {"flow": [UNIFORM]},
    "turbulence, 8 modes": {"flow": [turbulence(8)]},
    "turbulence, 64 modes": {"flow": [turbulence(64)]},
    "turbulence, 256 modes": {"flow": [turbulence(256)]},
    "waves, 64 components": {
        "water.depth": 15.0,
        "flow": [UNIFORM, {"kind": "waves", "significant_height": 0.5, "peak_period": 5.0}],
    },
    "measured point record": {
        "flow": [
            {
                "kind": "measured",
                "file": str(RECORD),
                "velocity": ["-u", "w"],
                "velocity_scale": 0.27,
                "ramp_time": 3.0,
            }
        ]
    },
    "one fixed sphere, far": {
        "flow": [UNIFORM],
        "obstacle": [{"kind": "sphere", "position": [0.2, -12.0], "radius": 0.05}],
    },
    "four free bodies, far": {
        "flow": [UNIFORM],
        "obstacle": [body(-0.4 - 0.1 * i, -12.0) for i in range(4)],
    },
    "four free bodies, hitting": {
        "flow": [UNIFORM],
        "obstacle": [body(-0.4 - 1.2 * i, -10.1 - 0.06 * i) for i in range(4)],
    },
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=21)
    parser.add_argument("--repeats", type=int, default=15)
    options = parser.parse_args()
    jax.config.update("jax_enable_compilation_cache", False)
    console = Console(highlight=False, markup=False, width=100)

    runs, cases = {}, {}
    for name, values in CASES.items():
        with console.status(name):
            runs[name], cases[name] = prepare(options.nodes, values)
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(options.repeats):  # in turn, so that a busy machine slows all of them alike
        for name, run in runs.items():
            start = time.perf_counter()
            run()
            times[name].append((time.perf_counter() - start) / cases[name]["time_steps"])
    for name, case in cases.items():
        case["seconds_per_time_step"] = times[name]
        case["ratio"] = float(np.median(np.divide(times[name], times[PLAIN])))
    console.print(table(options.nodes, cases))
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "ocean.json"
    path.write_text(json.dumps({"nodes": options.nodes, "cases": cases}, indent=2), "utf-8")
    console.print(f"wrote {path}")


def prepare(nodes: int, values: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Compile a case; return what runs it and what its Newton iterations are."""
    base = crinoid.load(PLANAR, [f"arm.nodes={nodes}"])
    scenario = base.with_values({"control.compare": False, **values})
    setup = set_up(Prepared(scenario))
    carry = setup.loop.start(setup.state)
    stride, count = scenario.output_steps, instants(scenario)
    total = count * stride

    def run() -> Any:
        return jax.block_until_ready(
            fast_chunk(setup.loop, carry, jnp.asarray(total), jnp.asarray(stride), count)
        )

    _, kept, filled, outcome = run()
    if not outcome.converged or filled != count:
        raise RuntimeError("a run stopped early")
    iterations, steps = np.asarray(kept.iterations), np.asarray(kept.steps)
    return run, {
        "time_steps": total,
        "solved_steps": int(steps.sum()),
        "iterations_per_solved_step": float(iterations.sum() / steps.sum()),
        "most_iterations_per_time_step": float(iterations.max() / stride),
        "most_steps_per_time_step": float(steps.max() / stride),
    }


def table(nodes: int, cases: dict[str, dict[str, Any]]) -> Table:
    """Show what a time step costs in each case."""
    shown = Table(title=f"One time step, {nodes} nodes", title_justify="left")
    shown.add_column("", no_wrap=True)
    for name in ("median us", "least us", f"over {PLAIN.split()[0]}", "Newton", "halved steps"):
        shown.add_column(name, justify="right")
    for name, case in cases.items():
        times = case["seconds_per_time_step"]
        shown.add_row(
            name,
            f"{1e6 * np.median(times):.1f}",
            f"{1e6 * min(times):.1f}",
            f"{case['ratio']:.2f}",
            f"{case['iterations_per_solved_step']:.2f}",
            str(case["solved_steps"] - case["time_steps"]),
        )
    return shown


if __name__ == "__main__":
    main()
