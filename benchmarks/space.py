"""A spatial arm with crinoid, with MuJoCo's flex rod and with PyElastica's Cosserat rod.

The arm of `accuracy.py` in air and without damping, of which the three have no kind in common. It
is curved at rest like a piece of a coil, leaves its clamp level and is let go under a tenth of
gravity, so that it bends both ways and twists. In one run: the time of a step, the largest step
with which two seconds go well, and the time to reach an error.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.table import Table

import accuracy
import crinoid
from accuracy import distance, in_turn, measured, reference
from beam import beam_tip
from coil import INTERVAL, MISSING, SAMPLES, case, coil, off, runs, straight, tip_at_rest

RESULTS = Path(__file__).parent / "results"
NODES = (11, 21, 51, 101)
"""Whose steps to time."""
SWEPT = (11, 21, 31, 51, 71, 101)
"""Whose errors and largest steps to measure."""
USUAL = {"crinoid": 0.01, "MuJoCo": 0.005}
"""The step to time (s); that of PyElastica is the largest with which it goes well."""
TIME_STEPS = {
    "crinoid": (0.05, 0.02, 0.01, 0.005, 0.0025),
    "MuJoCo": (0.01, 0.005, 0.002, 0.001, 0.0005, 0.00025, 0.000125),
}
"""Whose errors to measure (s); of PyElastica the largest and half of it."""
FINEST = {"crinoid": 0.001, "MuJoCo": 0.0000625, "PyElastica": 0.00005}
ORDER_IN_TIME = {"crinoid": 2, "MuJoCo": 1, "PyElastica": 2}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=3, help="of the runs for accuracy")
    parser.add_argument("--step-repeats", type=int, default=7, help="of those for time steps")
    options = parser.parse_args()
    console = Console(highlight=False, markup=False, width=100)

    engines = list(runs())
    with console.status("converged solutions"):
        converged = {name: extrapolated(name, coil) for name in engines}
        small = {name: extrapolated(name, straight) for name in engines}
    with console.status("largest steps"):
        limits = [limit(name, nodes, converged[name]) for name in engines for nodes in SWEPT]
    largest = {(row["engine"], row["nodes"]): row["time_step"] for row in limits}
    with console.status("time of a step"):
        steps = steps_in_turn(engines, largest, options.step_repeats)
    with console.status("accuracy"):
        cases = [
            case(name, coil(nodes, time_step))
            for name in engines
            for nodes in SWEPT
            for time_step in TIME_STEPS.get(name, [largest[name, nodes] / n for n in (1, 2)])
        ]
        accurate = measured(cases, converged, tip_at_rest(), options.repeats)
    agreement = [
        {
            "engine": name,
            "finest": off(case(name, coil(max(SWEPT), FINEST[name])).run(), converged[name]),
            "from_crinoid": off(converged[name], converged["crinoid"]),
            "from_beam": beside_beam(small[name], shears=name == "PyElastica"),
        }
        for name in engines
    ]

    console.print(step_table(steps))
    console.print(limit_table(limits))
    console.print(accuracy.grid_table(accurate))
    console.print(accuracy.reach_table(accurate))
    console.print(agreement_table(agreement))
    for line in MISSING:
        console.print(line)
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "space.json"
    kept = {"steps": steps, "limits": limits, "accuracy": accurate, "agreement": agreement}
    path.write_text(json.dumps(kept, indent=2), "utf-8")
    console.print(f"wrote {path}")


def extrapolated(engine: str, arm: Callable[[int, float], crinoid.Scenario]) -> np.ndarray:
    """Return the converged solution of an engine."""
    return reference(
        lambda nodes, time_step: case(engine, arm(nodes, time_step)),
        max(SWEPT),
        FINEST[engine],
        ORDER_IN_TIME[engine],
    )


def beside_beam(tips: np.ndarray, *, shears: bool) -> float:
    """Return how far the straight arm's tip is from the theory of beams, which is about z."""
    times = INTERVAL * np.arange(1, SAMPLES + 1)
    theory = beam_tip(straight(max(SWEPT), INTERVAL), times, shears=shears)
    return distance(tips[:, 2:], theory[:, None], np.zeros(1))


def limit(engine: str, nodes: int, truth: np.ndarray) -> dict[str, Any]:
    """Find the largest step, of those that divide a sample interval, with which all goes well.

    Well is a run in which no step fails, is halved or warned about and no tip is farther away
    than the arm is long, give or take a tenth. Found to within a tenth.
    """
    length = coil(nodes, INTERVAL).arm.length

    def error(steps: int) -> float | None:
        tips = case(engine, coil(nodes, INTERVAL / steps)).run()
        well = np.isfinite(tips).all() and np.linalg.norm(tips, axis=1).max() < 1.1 * length
        return off(tips, truth) if well else None

    fails, steps = 0, 1
    while (found := error(steps)) is None:
        fails, steps = steps, 2 * steps
        if steps > 10_000:
            raise RuntimeError(f"{engine} with {nodes} nodes finds no step that goes well")
    while steps - fails > max(1, fails // 10):
        between = (fails + steps) // 2
        tried = error(between)
        if tried is None:
            fails = between
        else:
            steps, found = between, tried
    return {"engine": engine, "nodes": nodes, "time_step": INTERVAL / steps, "error": found}


def steps_in_turn(
    engines: list[str], largest: dict[tuple[str, int], float], repeats: int
) -> list[dict[str, Any]]:
    """Return times of a step of each engine, and of a planar arm."""
    names, cases = [], []
    for nodes in NODES:
        for engine, axes in [("crinoid", 2), *((name, 3) for name in engines)]:
            names.append("crinoid, planar" if axes == 2 else engine)
            time_step = USUAL.get(engine, largest.get((engine, nodes)))
            cases.append(case(engine, coil(nodes, time_step, axes)))
    _, times = in_turn(cases, repeats)
    return [
        {
            "engine": name,
            "nodes": each.nodes,
            "time_step": each.time_step,
            "seconds_per_step": (seconds * each.time_step / accuracy.DURATION).tolist(),
        }
        for name, each, seconds in zip(names, cases, times.T, strict=True)
    ]


def step_table(rows: list[dict[str, Any]]) -> Table:
    """Show what a step costs."""
    table = Table(title="One time step", title_justify="left")
    table.add_column("nodes", justify="right")
    table.add_column("", no_wrap=True)
    for name in ("time step", "median us", "least us", "x real time"):
        table.add_column(name, justify="right")
    before = None
    for row in rows:
        if before not in (None, row["nodes"]):
            table.add_section()
        typical = float(np.median(row["seconds_per_step"]))
        table.add_row(
            "" if before == row["nodes"] else str(row["nodes"]),
            row["engine"],
            f"{1e3 * row['time_step']:.3g} ms",
            f"{1e6 * typical:.1f}",
            f"{1e6 * min(row['seconds_per_step']):.1f}",
            f"{row['time_step'] / typical:.0f}",
        )
        before = row["nodes"]
    return table


def limit_table(rows: list[dict[str, Any]]) -> Table:
    """Show the largest steps, and how wrong the tip is with them."""
    title = f"Largest step that goes well, up to {1e3 * INTERVAL:g} ms, and tip error with it"
    table = Table(title=title, title_justify="left")
    table.add_column("nodes", justify="right")
    for engine in dict.fromkeys(row["engine"] for row in rows):
        table.add_column(engine, justify="right")
    for nodes in SWEPT:
        cells = [
            f"{1e3 * row['time_step']:.3g} ms ({row['error']:.2%})"
            for row in rows
            if row["nodes"] == nodes
        ]
        table.add_row(str(nodes), *cells)
    return table


def agreement_table(rows: list[dict[str, Any]]) -> Table:
    """Show how far the converged solutions are from what they should be near to."""
    table = Table(title="Distance of converged solutions", title_justify="left")
    table.add_column("")
    headings = ("from the finest run", "from crinoid's", "small, straight: from theory")
    for heading in headings:
        table.add_column(heading, justify="right")
    for row in rows:
        cells = (row["finest"], row["from_crinoid"], row["from_beam"])
        table.add_row(row["engine"], *(f"{each:.3%}" for each in cells))
    return table


if __name__ == "__main__":
    jax.config.update("jax_enable_compilation_cache", False)
    main()
