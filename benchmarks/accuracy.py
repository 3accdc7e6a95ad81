"""Time to reach a stated error: an arm let go from the horizontal, with crinoid and with MuJoCo.

Still conditions: no drag, no added mass, gravity less buoyancy, Kelvin-Voigt damping. The error is
the largest distance of the tip, over two seconds, from the engine's own converged solution,
relative to the largest displacement of the tip. Times are those of the simulation alone: neither
compiling nor loading is in them.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.simulation.chunk import fast_chunk
from crinoid.simulation.setup import set_up

try:
    import mujoco

    import mujoco_rod
except ImportError as error:
    mujoco_rod, WHY_NOT = None, f"without MuJoCo ({error}): pip install '.[bench]'"

RESULTS = Path(__file__).parent / "results"
DURATION, INTERVAL = 2.0, 0.2
SAMPLES = round(DURATION / INTERVAL)
TARGETS = (0.01, 0.001)
START = np.array([0.5, 0.0])
"""The tip at rest (m)."""

NODES = {"crinoid": (11, 21, 51), "MuJoCo": (11, 21, 41)}
TIME_STEPS = {
    "crinoid": (0.04, 0.02, 0.01, 0.005),
    "MuJoCo": (0.01, 0.005, 0.002, 0.001, 0.0005, 0.00025),
}
FINEST = {"crinoid": 0.001, "MuJoCo": 0.0005}
ORDER_IN_TIME = {"crinoid": 2, "MuJoCo": 1}


class Case(NamedTuple):
    """One mesh and time step of an engine."""

    engine: str
    nodes: int
    time_step: float
    run: Callable[[], np.ndarray]
    """Returns the tip at each sample, `(samples, axes)` in m; no number from where it fails."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    console = Console(highlight=False, markup=False, width=100)

    engines = {"crinoid": crinoid_case}
    if mujoco_rod is not None:
        engines["MuJoCo"] = mujoco_case
    cases, converged = [], {}
    with console.status("converged solutions"):
        for engine, make in engines.items():
            converged[engine] = reference(make, 81, FINEST[engine], ORDER_IN_TIME[engine])
            cases += [make(n, h) for n in NODES[engine] for h in TIME_STEPS[engine]]
    with console.status("timing"):
        rows = measured(cases, converged, START, options.repeats)
    console.print(grid_table(rows))
    console.print(reach_table(rows))
    if mujoco_rod is None:
        console.print(WHY_NOT)
    else:
        apart = distance(converged["MuJoCo"], converged["crinoid"], START)
        console.print(f"the two converged solutions are {apart:.2%} apart")
        console.print(default_table())
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "accuracy.json"
    path.write_text(json.dumps(rows, indent=2), "utf-8")
    console.print(f"wrote {path}")


def scenario(nodes: int, time_step: float) -> crinoid.Scenario:
    """Return `planar.toml` with an arm of silicone, horizontal, without control or current."""
    settings = {
        "arm.nodes": nodes,
        "arm.radius": 0.02,
        "arm.youngs_modulus": 5e5,
        "arm.damping_time": 0.02,
        "base.tilt_deg": 0.0,
        "flow": [],
        "sensor": {},
        "control": {"kind": "none"},
        "water.drag_normal": 0.0,
        "water.drag_tangential": 0.0,
        "water.added_mass_normal": 0.0,
        "simulation.start": "rest",
        "simulation.time_step": time_step,
        "simulation.duration": DURATION,
    }
    return crinoid.load(str(Path(__file__).with_name("planar.toml"))).with_values(settings)


def crinoid_case(nodes: int, time_step: float) -> Case:
    """Return a run of crinoid, compiled."""
    run = crinoid_tips(scenario(nodes, time_step), INTERVAL)
    return Case("crinoid", nodes, time_step, run)


def crinoid_tips(scenario: crinoid.Scenario, interval: float) -> Callable[[], np.ndarray]:
    """Return a run of crinoid from rest; a step that it would have to halve counts as failed."""
    setup = set_up(Prepared(scenario))
    carry = setup.loop.start(setup.state)
    steps = round(interval / scenario.simulation.time_step)
    samples = scenario.simulation.steps // steps
    end, stride = jnp.asarray(samples * steps), jnp.asarray(steps)
    origin = np.asarray(setup.loop.system.forces.origin)

    def run() -> np.ndarray:
        _, kept, _, _ = fast_chunk(setup.loop, carry, end, stride, samples)
        tips = np.asarray(kept.tip)[:samples, : origin.size] - origin
        tips[np.logical_or.accumulate(np.asarray(kept.steps)[:samples] != steps)] = np.nan
        return tips

    return run


def mujoco_case(nodes: int, time_step: float, **kind: bool) -> Case:
    """Return a run of MuJoCo's rod at its best: planar, hard edges, clamp in its right place."""
    kind = {"planar": nodes < 50, "centred": True} | kind
    model = mujoco_rod.rod(scenario(nodes, 0.01), time_step, **kind)
    data = mujoco.MjData(model)
    plane = [0, 1 if kind["planar"] else 2]
    steps = round(INTERVAL / time_step)

    def run() -> np.ndarray:
        return mujoco_rod.tips(model, data, SAMPLES, steps)[:, plane]

    return Case("MuJoCo", nodes, time_step, run)


def reference(
    make: Callable[[int, float], Case], nodes: int, time_step: float, order_in_time: int
) -> np.ndarray:
    """Extrapolate a fine solution to no time step and no edge length, by the engine's orders.

    Raises
    ------
    RuntimeError
        If the engine fails.
    """
    finest = make(nodes, time_step).run()
    slower = make(nodes, 2 * time_step).run()
    coarser = make((nodes + 1) // 2, time_step).run()
    extrapolated = (
        finest + (finest - slower) / (2**order_in_time - 1) + (finest - coarser) / (2**2 - 1)
    )
    if not np.isfinite(extrapolated).all():
        raise RuntimeError(f"{make(nodes, time_step).engine} fails at {time_step} s")
    return extrapolated


def distance(tips: np.ndarray, truth: np.ndarray, start: np.ndarray) -> float:
    """Return the largest distance over the samples, relative to the largest displacement."""
    return float(
        np.max(np.linalg.norm(tips - truth, axis=1)) / np.max(np.linalg.norm(truth - start, axis=1))
    )


def measured(
    cases: list[Case], converged: dict[str, np.ndarray], start: np.ndarray, repeats: int
) -> list[dict[str, Any]]:
    """Return error and median time of each case."""
    all_tips, times = in_turn(cases, repeats)
    return [
        {
            "engine": case.engine,
            "nodes": case.nodes,
            "time_step": case.time_step,
            "error": distance(tips, converged[case.engine], start),
            "seconds": float(np.median(seconds)),
        }
        for case, tips, seconds in zip(cases, all_tips, times.T, strict=True)
    ]


def in_turn(cases: list[Case], repeats: int) -> tuple[list[np.ndarray], np.ndarray]:
    """Return the tips of a first run of each, and the `(repeats, cases)` times of more (s).

    Run in turn so that all meet the same machine.
    """
    tips = [case.run() for case in cases]
    times = np.empty((repeats, len(cases)))
    for row in times:
        for i, case in enumerate(cases):
            start = time.perf_counter()
            case.run()
            row[i] = time.perf_counter() - start
    return tips, times


def grid_table(rows: list[dict[str, Any]]) -> Table:
    """Show error and time of every case."""
    table = Table(title="Two seconds of swinging", title_justify="left")
    table.add_column("")
    for name in ("nodes", "time step", "tip error", "wall time"):
        table.add_column(name, justify="right")
    before = None
    for row in rows:
        if before not in (None, (row["engine"], row["nodes"])):
            table.add_section()
        before = (row["engine"], row["nodes"])
        table.add_row(
            row["engine"],
            str(row["nodes"]),
            f"{1e3 * row['time_step']:.3g} ms",
            f"{row['error']:.3%}" if np.isfinite(row["error"]) else "fails",
            f"{1e3 * row['seconds']:.2f} ms",
        )
    return table


def reach_table(rows: list[dict[str, Any]]) -> Table:
    """Show the fastest case of each engine within each error."""
    table = Table(title="Fastest within an error", title_justify="left")
    table.add_column("")
    for target in TARGETS:
        table.add_column(f"{target:.1%}", justify="right")
    for engine in dict.fromkeys(row["engine"] for row in rows):
        cells = []
        for target in TARGETS:
            within = [row for row in rows if row["engine"] == engine and row["error"] <= target]
            best = min(within, key=lambda row: row["seconds"], default=None)
            cells.append(
                "none"
                if best is None
                else f"{1e3 * best['seconds']:.2f} ms ({best['nodes']} nodes, "
                f"{1e3 * best['time_step']:.3g} ms)"
            )
        table.add_row(engine, *cells)
    return table


def default_table() -> Table:
    """Show where the tip of a rod ends up as one would declare it first: it does not converge."""
    table = Table(title="Tip after 2 s with MuJoCo's default edges", title_justify="left")
    for name in ("vertices", "x", "z"):
        table.add_column(name, justify="right")
    for nodes in (11, 21, 41, 81):
        x, z = mujoco_case(nodes, 0.002, planar=False, stiff=False, centred=False).run()[-1]
        table.add_row(str(nodes), f"{1e3 * x:.2f} mm", f"{1e3 * z:.2f} mm")
    return table


if __name__ == "__main__":
    jax.config.update("jax_enable_compilation_cache", False)
    main()
