"""Time many arms, together under `vmap` and in turn under `lax.map`, on one core and on all.

Each arm of a batch has its own commands. Beside it stands one arm alone, and what XLA makes of the
batch without the options of crinoid's own programs.
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.compilation import OFTEN
from spread import CORES, over_cores
from step import IN_SPACE, PLANAR, RESULTS, SOFT, STEADY, STEADY_IN_SPACE

STEPS = 100
CASES = {
    "plane, uniform current": (PLANAR, [STEADY]),
    "plane, turbulence of 64 modes": (PLANAR, ["flow.0.modes=64"]),
    "plane, turbulence of 256 modes": (PLANAR, []),
    "space, uniform current": (IN_SPACE, [STEADY_IN_SPACE]),
}


def main() -> None:
    """Time all cases and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, default=21)
    parser.add_argument("--arms", type=int, default=64)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    options = parser.parse_args()
    jax.config.update("jax_enable_compilation_cache", False)
    console = Console(highlight=False, markup=False, width=110)
    rows = []
    for case in options.cases:
        with console.status(case):
            rows += measure(case, options.nodes, options.arms, options.repeats)
    table = Table(title=f"{options.arms} arms of {options.nodes} nodes", title_justify="left")
    for name in ("", "arms", "compile (s)", "us per arm-step", "arm-steps/s", "largest difference"):
        table.add_column(name, justify="left" if not name else "right")
    for row in rows:
        table.add_row(
            row["name"],
            str(row["arms"]),
            f"{row['compile']:.1f}",
            f"{row['each']:.1f}",
            f"{1e6 / row['each']:,.0f}",
            f"{row['difference']:.1e}",
        )
    console.print(table)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "vmap.json").write_text(json.dumps(rows, indent=2), "utf-8")


def measure(case: str, nodes: int, arms: int, repeats: int) -> list[dict[str, Any]]:
    """Time one arm alone, and batches, in turn."""
    file, extra = CASES[case]
    system = crinoid.system(crinoid.load(file, [f"arm.nodes={nodes}", *SOFT, *extra]))
    state = system.rest()
    commands = jnp.linspace(-0.03, 0.03, arms)[:, None] * jnp.ones(len(system.inputs))

    def roll(system: Any, state: Any, command: jax.Array) -> Any:
        def step(state: Any, _: None) -> tuple[Any, jax.Array]:
            state, outcome = system.step(state, command)
            return state, outcome.converged

        end, converged = jax.lax.scan(step, state, length=STEPS)
        return jnp.where(converged.all(), end.position[-1], jnp.nan)

    def together(system: Any, state: Any, commands: jax.Array) -> Any:
        return jax.vmap(partial(roll, system, state))(commands)

    def in_turn(system: Any, state: Any, commands: jax.Array) -> Any:
        return jax.lax.map(partial(roll, system, state), commands)

    def split(how: Callable[..., Any], system: Any, state: Any, commands: jax.Array) -> Any:
        return over_cores(how, (system, state), commands)

    contestants: list[tuple[str, int, Callable[..., Any], dict[str, Any], Any]] = [
        ("one alone", 1, roll, OFTEN, commands[-1]),
        ("XLA's defaults", arms, together, {}, commands),
        ("together", arms, together, OFTEN, commands),
        (f"together, over {CORES} cores", arms, partial(split, together), OFTEN, commands),
        ("in turn", arms, in_turn, OFTEN, commands),
        (f"in turn, over {CORES} cores", arms, partial(split, in_turn), OFTEN, commands),
    ]
    rows, runs = [], []
    for name, count, function, options, command in contestants:
        compiled = eqx.filter_jit(function, **({"compiler_options": options} if options else {}))
        run = partial(compiled, system, state, command)
        begun = time.perf_counter()
        tips = np.atleast_2d(np.asarray(run()))
        rows.append(
            {
                "name": f"{case}: {name}",
                "arms": count,
                "compile": time.perf_counter() - begun,
                "tips": tips,
            }
        )
        runs.append(run)
    alone = rows[0]["tips"][0]
    times: list[list[float]] = [[] for _ in runs]
    for _ in range(repeats):  # in turn, so that a busy machine slows all of them alike
        for run, taken in zip(runs, times, strict=True):
            begun = time.perf_counter()
            jax.block_until_ready(run())
            taken.append(time.perf_counter() - begun)
    for row, taken in zip(rows, times, strict=True):
        row["each"] = 1e6 * float(np.median(taken)) / STEPS / row["arms"]
        row["difference"] = float(np.abs(row.pop("tips")[-1] - alone).max())
    return rows


if __name__ == "__main__":
    main()
