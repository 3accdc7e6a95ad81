"""Many arms at once: whole runs and bare steps, in time steps a second."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from benchmarks.measurement import Rows, Scope, in_turn, row
from benchmarks.step import ARMS, Run, march, steady
from crinoid.assembly.prepared import system as assembled
from crinoid.compilation import OFTEN, compiled
from crinoid.dynamics import State, System
from crinoid.foundation.cores import cores
from crinoid.scenario import Scenario, load
from crinoid.studies.batch import simulate_batch

_STEPS, _JOLT = 100, 0.03
"""Number of bare time steps, and their largest command (m, rad): each arm has its own."""


def benchmark(scope: Scope) -> Rows:
    """Yield the time steps of all arms together in a second."""
    flagship, arms = scope.shortened(load(ARMS["plane"])), scope.arms
    runs = {("whole runs, moving", count): _whole(flagship, count) for count in (1, arms)}
    for name, run in _bare(steady("plane", scope), arms).items():
        runs[f"bare steps, {name}", arms] = run, arms * _STEPS
    times = in_turn([run for run, _ in runs.values()], scope.repeats)
    for ((name, count), (_, steps)), each in zip(runs.items(), times, strict=True):
        yield row(name, "time steps a second", "1/s", steps / each, arms=count)


def _whole(scenario: Scenario, arms: int) -> Run:
    """Return runs with start, sensor, controller, ledger, records, notes and measures."""
    moduli = np.linspace(0.9, 1.1, arms) * scenario.arm.youngs_modulus
    over: dict[str, np.ndarray] = {"arm.youngs_modulus": moduli, "seed": np.arange(arms)}

    def run() -> None:
        if (simulate_batch(scenario, over)["status"] != "ok").any():
            raise RuntimeError(f"{scenario.title}: a run of the batch failed")

    return run, arms * scenario.simulation.steps


def _one(system: System, state: State, command: Float[Array, " input"]) -> Array:
    end, converged = march(system, state, command, _STEPS)
    return jnp.where(converged, end.position[-1], jnp.nan)


@compiled(**OFTEN)
def _together(system: System, state: State, commands: Float[Array, "arm input"]) -> Array:
    return jax.vmap(partial(_one, system, state))(commands)


@compiled(**OFTEN)
def _one_by_one(system: System, state: State, commands: Float[Array, "arm input"]) -> Array:
    return jax.lax.map(partial(_one, system, state), commands)


def _bare(scenario: Scenario, arms: int) -> dict[str, Callable[[], None]]:
    """Return the bare steps of many arms, in three ways."""
    system = assembled(scenario)
    rest = system.rest()
    commands = jnp.linspace(-_JOLT, _JOLT, arms)[:, None] * jnp.ones(len(system.inputs))

    def run(many: Callable[..., Array], threads: int) -> None:
        parts = [part for part in jnp.array_split(commands, threads) if len(part)]
        with ThreadPoolExecutor(len(parts)) as pool:
            runs = [pool.submit(many, system, rest, part) for part in parts]
            found = [run.result() for run in runs]
        if not all(np.isfinite(part).all() for part in found):
            raise RuntimeError("a step of the batch failed")

    return {
        "one by one": partial(run, _one_by_one, 1),
        "one by one, on each core": partial(run, _one_by_one, cores()),
        "together (vmap)": partial(run, _together, 1),
    }
