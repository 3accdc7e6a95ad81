"""Time of one step of the closed loop, and of MuJoCo's flex rod measured in turn with it.

The closed loop is that of `planar.toml` and, in space, `spatial.toml`, the arm of silicone and the
current uniform, with all water terms, sensor, controller, energy ledger and
records, run by the same two compiled programs as `crinoid run`. What other currents cost,
`ocean.py` measures.
"""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import OFTEN
from crinoid.simulation.chunk import fast_chunk
from crinoid.simulation.loop import Loop
from crinoid.simulation.setup import Setup, set_up

try:
    import mujoco

    import mujoco_rod
except ImportError as error:
    mujoco_rod, WHY_NOT = None, f"without MuJoCo ({error}): pip install '.[bench]'"

RESULTS = Path(__file__).parent / "results"
PLANAR, IN_SPACE = (str(Path(__file__).with_name(f"{name}.toml")) for name in ("planar", "spatial"))
CONTROLLED, NOISY = "closed loop", "closed loop, noisy sensor"
UNCONTROLLED, BARE, LED = "control off", "steps only", "steps only, same motion"
SPATIAL, SPATIAL_BARE = "in space, closed loop", "in space, steps only"
WITH_VORTICES = "in space, closed loop, vortices"
SPATIAL_LED = "in space, steps only, same motion"

SOFT = ("arm.radius=0.02", "arm.youngs_modulus=5e5", "arm.damping_time=0.02")
"""The arm of the comparisons: silicone."""
STEADY = 'flow=[{kind="uniform", velocity=[0.25, 0.0], ramp_time=3.0}]'
STEADY_IN_SPACE = 'flow=[{kind="uniform", velocity=[0.25, -0.15, 0.05], ramp_time=3.0}]'

COMPARED = (CONTROLLED, SPATIAL_BARE)
"""Cases that MuJoCo is compared with."""

BOUNDARY_NODES = (None, 1e-3, 1e-7, 1e-8)
"""Values of simulation.error to compare."""

NOISE = 5e-4
"""Standard deviation of a noisy sensor (m): its controller jerks the base at every step."""


class Contestant(NamedTuple):
    """Something to time."""

    name: str
    run: Callable[[], Any]
    steps: int
    time_step: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, nargs="+", default=[11, 21, 51, 101])
    parser.add_argument("--repeats", type=int, default=7)
    options = parser.parse_args()
    # what is on disk would make a first compilation look faster than it is
    jax.config.update("jax_enable_compilation_cache", False)
    console = Console(highlight=False, markup=False, width=100)

    rows = []
    for nodes in options.nodes:
        with console.status(f"{nodes} nodes"):
            rows.append(measure(nodes, options.repeats))
    console.print(start_table(rows))
    console.print(step_table(rows))
    loops = (CONTROLLED, NOISY, UNCONTROLLED, SPATIAL, BARE, SPATIAL_BARE)
    exponents = {name: exponent(rows, name) for name in loops}
    for name, power in exponents.items():
        if power is not None:
            console.print(f"{name}: time of a step grows as nodes^{power:.2f} from 21 nodes on")
    if mujoco_rod is None:
        console.print(WHY_NOT)
    with console.status("errors held"):
        console.print(held_table(options.nodes[0], options.repeats))
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "step.json"
    path.write_text(json.dumps({"exponents": exponents, "cases": rows}, indent=2), "utf-8")
    console.print(f"wrote {path}")


def measure(nodes: int, repeats: int) -> dict[str, Any]:
    """Compile and time everything at one number of nodes."""
    scenario = crinoid.load(PLANAR, [f"arm.nodes={nodes}", *SOFT, STEADY])
    begun = time.perf_counter()
    setup = jax.block_until_ready(set_up(Prepared(scenario)))
    ready = time.perf_counter()
    compile_stretch(scenario, setup)
    compiled = time.perf_counter()

    quiet = setup.loop
    noise = jnp.array([NOISE, NOISE, 0.0])
    spatial = crinoid.load(IN_SPACE, [f"arm.nodes={nodes}", *SOFT, STEADY_IN_SPACE])
    in_space = set_up(Prepared(spatial))
    shedding = spatial.with_values({"water.vortices": {}})
    in_vortices = set_up(Prepared(shedding))
    loops = [
        closed_loop(CONTROLLED, scenario, setup.state, quiet),
        closed_loop(
            NOISY, scenario, setup.state, eqx.tree_at(lambda x: x.sensors[0].noise, quiet, noise)
        ),
        closed_loop(
            UNCONTROLLED,
            scenario,
            setup.state,
            eqx.tree_at(lambda x: x.enabled, quiet, jnp.asarray(False)),
        ),
        closed_loop(SPATIAL, spatial, in_space.state, in_space.loop),
        closed_loop(WITH_VORTICES, shedding, in_vortices.state, in_vortices.loop),
    ]
    iterations = {each.name: count for each, count in loops}
    contestants = [
        *(each for each, _ in loops),
        bare_steps(BARE, scenario, setup),
        bare_steps(SPATIAL_BARE, spatial, in_space),
        bare_steps(LED, scenario, setup, commands_of(scenario, setup)),
        bare_steps(SPATIAL_LED, spatial, in_space, commands_of(spatial, in_space)),
    ]
    warned = {}
    if mujoco_rod is not None:
        for planar in (False, True):
            for time_step in (0.005, 0.01):
                name = f"MuJoCo {'2D' if planar else '3D'}, {1e3 * time_step:g} ms"
                model = mujoco_rod.rod(scenario, time_step, planar=planar)
                data = mujoco.MjData(model)
                steps = max(200, round(40_000 / nodes))
                run = partial(mujoco_rod.run, model, data, steps)
                contestants.append(Contestant(name, run, steps, time_step))
                run()
                warned[name] = mujoco_rod.warnings(data)

    times: dict[str, list[float]] = {each.name: [] for each in contestants}
    for each in contestants:
        each.run()
    for _ in range(repeats):  # in turn, so that a busy machine slows all of them alike
        for each in contestants:
            start = time.perf_counter()
            each.run()
            times[each.name].append((time.perf_counter() - start) / each.steps)
    return {
        "nodes": nodes,
        "set_up_seconds": ready - begun,
        "stretch_seconds": compiled - ready,
        "iterations_per_step": iterations,
        "seconds_per_step": times,
        "time_step": {each.name: each.time_step for each in contestants},
        "ratio": {
            name: {loop: float(np.median(np.divide(times[loop], times[name]))) for loop in COMPARED}
            for name in times
            if name.startswith("MuJoCo")
        },
        "warnings": warned,
    }


def compile_stretch(scenario: crinoid.Scenario, setup: Setup) -> None:
    """Run a chunk of no steps, as `crinoid run` does first."""
    stride, count = jnp.asarray(scenario.output_steps), instants(scenario)
    carry = setup.loop.start(setup.state)
    jax.block_until_ready(fast_chunk(setup.loop, carry, carry.steps, stride, count))


def instants(scenario: crinoid.Scenario) -> int:
    """Return the number of instants that a whole run keeps."""
    return scenario.simulation.steps // scenario.output_steps


def closed_loop(
    name: str, scenario: crinoid.Scenario, state: Any, loop: Loop
) -> tuple[Contestant, float]:
    """Return a whole run of the loop, and its iterations a step."""
    stride, count = scenario.output_steps, instants(scenario)
    carry = loop.start(state)

    def run() -> Any:
        return jax.block_until_ready(
            fast_chunk(loop, carry, jnp.asarray(count * stride), jnp.asarray(stride), count)
        )

    _, kept, filled, outcome = run()
    if not outcome.converged or filled != count:
        raise RuntimeError(f"the run of {scenario.arm.nodes} nodes stopped early")
    steps = count * stride
    return (
        Contestant(name, run, steps, scenario.simulation.time_step),
        float(np.sum(kept.iterations)) / steps,
    )


def commands_of(scenario: crinoid.Scenario, setup: Setup) -> jax.Array:
    """Return the commands that the controller gives in the whole run, one for each step."""

    @eqx.filter_jit(compiler_options=OFTEN)
    def roll(loop: Loop, state: Any) -> jax.Array:
        def tick(carry: Any, _: None) -> tuple[Any, jax.Array]:
            carry, _ = loop.tick(carry)
            return carry, carry.command

        return jax.lax.scan(tick, loop.start(state), length=scenario.simulation.steps)[1]

    return roll(setup.loop, setup.state)


def bare_steps(
    name: str, scenario: crinoid.Scenario, setup: Setup, commands: jax.Array | None = None
) -> Contestant:
    """Return time steps in a scan: no sensor, controller, records, halving or energy ledger.

    Without commands the base stays where it is.
    """
    steps = scenario.simulation.steps
    if commands is None:
        commands = jnp.zeros((steps, len(setup.loop.system.inputs)))

    @eqx.filter_jit(compiler_options=OFTEN)
    def roll(system: Any, state: Any, commands: jax.Array) -> Any:
        def step(state: Any, command: jax.Array) -> tuple[Any, None]:
            return system.step(state, command)[0], None

        # of what is not asked for at the end, the compiler leaves out what no step needs
        return jax.lax.scan(step, state, commands)[0].position

    return Contestant(
        name,
        lambda: jax.block_until_ready(roll(setup.loop.system, setup.state, commands)),
        steps,
        scenario.simulation.time_step,
    )


def held_table(nodes: int, repeats: int) -> Table:
    """Show what it costs to hold steps to an error: one program, whatever the value."""
    base = crinoid.load("station-keeping", [f"arm.nodes={nodes}", *SOFT, STEADY])
    setup = set_up(Prepared(base))
    contestants, rows = [], []
    for error in BOUNDARY_NODES:
        scenario = base if error is None else base.with_values({"simulation.error": error})
        loop = eqx.tree_at(lambda x: x.system, setup.loop, crinoid.system(scenario))
        each, iterations = closed_loop(
            "off" if error is None else f"{error:g}", base, setup.state, loop
        )
        kept = each.run()[1]
        contestants.append(each)
        largest = float(np.max(kept.error)) / base.arm.length
        rows.append((int(np.sum(kept.steps)), each.steps * iterations, largest))
    times: list[list[float]] = [[] for _ in contestants]
    for _ in range(repeats):
        for each, taken in zip(contestants, times, strict=True):
            start = time.perf_counter()
            each.run()
            taken.append(time.perf_counter() - start)
    table = Table(title=f"Steps held to an error, {nodes} nodes", title_justify="left")
    for name in (
        "simulation.error",
        "largest step_error / length",
        "steps",
        "Newton",
        "time / off",
    ):
        table.add_column(name, justify="right")
    for each, (steps, iterations, largest), taken in zip(contestants, rows, times, strict=True):
        ratio = float(np.median(np.divide(taken, times[0])))
        table.add_row(each.name, f"{largest:.1e}", str(steps), f"{iterations:.0f}", f"{ratio:.2f}")
    return table


def exponent(rows: list[dict[str, Any]], name: str) -> float | None:
    """Fit the power of the number of nodes with which the time of a step grows."""
    points = [
        (np.log(row["nodes"]), np.log(np.median(row["seconds_per_step"][name])))
        for row in rows
        if row["nodes"] >= 21
    ]
    return float(np.polyfit(*zip(*points, strict=True), 1)[0]) if len(points) > 1 else None


def start_table(rows: list[dict[str, Any]]) -> Table:
    """Show what compiling costs."""
    table = Table(title="First call: tracing, compiling and running", title_justify="left")
    for name in ("nodes", "set-up (s)", "stretch (s)"):
        table.add_column(name, justify="right")
    for row in rows:
        seconds = (row["set_up_seconds"], row["stretch_seconds"])
        table.add_row(str(row["nodes"]), *(f"{each:.2f}" for each in seconds))
    return table


def step_table(rows: list[dict[str, Any]]) -> Table:
    """Show what a step costs."""
    table = Table(title="One time step", title_justify="left")
    table.add_column("nodes", justify="right")
    table.add_column("", no_wrap=True)
    for name in ("median us", "least us", "Newton", "us each", "x real time"):
        table.add_column(name, justify="right")
    for name in ("closed loop / this", "steps in space / this"):
        table.add_column(name, justify="right")
    for row in rows:
        for name, times in row["seconds_per_step"].items():
            typical = float(np.median(times))
            iterations = row["iterations_per_step"].get(name)
            ratios = row["ratio"].get(name, {})
            table.add_row(
                str(row["nodes"]) if name == CONTROLLED else "",
                name + (" (warns)" if row["warnings"].get(name) else ""),
                f"{1e6 * typical:.1f}",
                f"{1e6 * min(times):.1f}",
                "" if iterations is None else f"{iterations:.2f}",
                "" if iterations is None else f"{1e6 * typical / iterations:.1f}",
                f"{row['time_step'][name] / typical:.0f}",
                *(f"{ratios[loop]:.2f}" if ratios else "" for loop in COMPARED),
                end_section=name == list(row["seconds_per_step"])[-1],
            )
    return table


if __name__ == "__main__":
    main()
