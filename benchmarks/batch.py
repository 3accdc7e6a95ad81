"""Time steps a second of many arms, and the memory they take: `crinoid.simulate_batch`.

Each batch is run in a process of its own by the programs of `crinoid run`, from the start of its
first arm to its dataset: that is with starts, controllers, energy ledgers, records and measures.
*Steps only* are those of as many arms without all that. Beside them, in turn with them, MuJoCo's
rod in the threads of its `rollout` and those of PyElastica and SoRoMoX in as many processes, all
without water, control and records, where they are installed.
"""

import argparse
import json
import multiprocessing
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from functools import cache
from importlib.util import find_spec
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

import crinoid
from crinoid.simulation.batch import cores
from step import PLANAR, RESULTS, SOFT, STEADY

CASES = {
    "uniform, control off": [STEADY, "control.kind=none"],
    "uniform, PID": [STEADY],
    "turbulence, control off": ["flow.0.modes=64", "control.kind=none"],
    "turbulence, PID": ["flow.0.modes=64"],
    "uniform, steps only": [STEADY, "control.kind=none"],
    "turbulence, steps only": ["flow.0.modes=64", "control.kind=none"],
}
NODES = 21
MUJOCO_STEP = 0.005
ELASTICA_STEP = 0.0008
SOROMOX_STEP = 0.001
"""Time steps (s) with which the others go well (``space.py``; SoRoMoX diverges with 2 ms)."""
SEGMENTS = 8
"""Segments of SoRoMoX's arms, each with one curvature and one extension: 16 unknowns."""
SWINGS = 100
"""Time steps of MuJoCo's arms, and a tenth of those of the other two."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, nargs="+", default=[1, 4, 16, 64, 256, 1024, 4096])
    parser.add_argument("--duration", type=float, default=30.0, help="of each arm (s)")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--one", action="store_true", help="run one batch in this process")
    options = parser.parse_args()
    if options.one:
        run_one = steps if options.cases[0].endswith("steps only") else batch
        print(json.dumps(run_one(options.cases[0], options.arms[0], options.duration)))
        return
    console = Console(highlight=False, markup=False, width=120)
    contestants: dict[str, Callable[[int], dict[str, Any]]] = {
        case: lambda arms, case=case: alone(case, arms, options.duration) for case in options.cases
    }
    for name, module, run in (
        ("MuJoCo, 5 ms", "mujoco", mujoco_arms),
        ("PyElastica, 0.8 ms", "elastica", elastica_arms),
        ("SoRoMoX, 1 ms", "soromox", soromox_arms),
    ):
        if find_spec(module) is None:
            console.print(f"without {name.partition(',')[0]}: pip install '.[bench]'")
        else:
            contestants[name] = run
    rows = []
    for arms in options.arms:
        found: dict[str, list[dict[str, Any]]] = {name: [] for name in contestants}
        for _ in range(options.repeats):  # in turn, so that a busy machine slows all of them alike
            for name, run in contestants.items():
                with console.status(f"{arms} arms: {name}"):
                    found[name].append(run(arms))
        rows += [summed_up(name, arms, each) for name, each in found.items()]
    table = Table(title=f"{NODES} nodes, {cores()} cores", title_justify="left")
    heads = ("", "arms", "steps/s", "most", "CPU us a step", "x real time", "MB", "not ok")
    for head in heads:
        table.add_column(head, justify="right" if head else "left")
    for row in rows:
        table.add_row(
            row["name"],
            str(row["arms"]),
            f"{row['rate']:,.0f}",
            f"{row['most']:,.0f}",
            f"{row['cpu']:.1f}",
            f"{row['real_time']:,.0f}",
            f"{row['memory']:.0f}" if row["memory"] else "",
            str(row["failed"]),
        )
    console.print(table)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "batch.json").write_text(json.dumps(rows, indent=2), "utf-8")


def summed_up(name: str, arms: int, found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the medians of repeats, and the best of them."""
    rates = [each["steps"] / each["seconds"] for each in found]
    return {
        "name": name,
        "arms": arms,
        "rate": float(np.median(rates)),
        "most": max(rates),
        "cpu": 1e6 * float(np.median([each["cpu"] / each["steps"] for each in found])),
        "real_time": float(np.median(rates)) * found[0]["time_step"],
        "memory": max(each["memory"] for each in found) / 1e6,
        "failed": max(each["failed"] for each in found),
    }


def alone(case: str, arms: int, duration: float) -> dict[str, Any]:
    """Run a batch in a process of its own."""
    command = [sys.executable, __file__, "--one", "--cases", case]
    command += ["--arms", str(arms), "--duration", str(duration)]
    ended = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(ended.stdout.splitlines()[-1])


def arm(case: str, duration: float) -> crinoid.Scenario:
    """Return the scenario of a case."""
    settings = [f"arm.nodes={NODES}", f"simulation.duration={duration}", "control.compare=false"]
    return crinoid.load(PLANAR, [*SOFT, *settings, *CASES[case]])


def moduli(arms: int) -> np.ndarray:
    """Return the Young's modulus of each arm (Pa)."""
    return np.linspace(4.5e5, 5.5e5, arms)


def batch(case: str, arms: int, duration: float) -> dict[str, Any]:
    """Time a batch, its programs loaded."""
    from crinoid.compilation import keep_programs

    keep_programs()
    scenario, over = arm(case, duration), {"arm.youngs_modulus": moduli(arms), "seed": range(arms)}
    crinoid.simulate_batch(scenario, seeds=1)

    def failed() -> int:
        return int((crinoid.simulate_batch(scenario, over)["status"] != "ok").sum())

    return timed(failed, arms, scenario)


def timed(run: Callable[[], int], arms: int, scenario: crinoid.Scenario) -> dict[str, Any]:
    """Time what returns how many arms failed."""
    begun, used = time.perf_counter(), time.process_time()
    failed = run()
    return {
        "seconds": time.perf_counter() - begun,
        "cpu": time.process_time() - used,
        "steps": arms * scenario.simulation.steps,
        "time_step": scenario.simulation.time_step,
        "failed": failed,
        "memory": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss,
    }


def steps(case: str, arms: int, duration: float) -> dict[str, Any]:
    """Time the steps of arms alone, one after the other on each core, compiled before."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    from crinoid.compilation import OFTEN
    from spread import over_cores

    scenario = arm(case, duration)

    def swing(numbers: Any, moduli: jax.Array) -> jax.Array:
        def one(modulus: jax.Array) -> jax.Array:
            system = crinoid.assemble(eqx.tree_at(lambda x: x.arm.youngs_modulus, numbers, modulus))
            command = jnp.zeros(len(system.inputs))

            def step(state: Any, _: None) -> tuple[Any, jax.Array]:
                state, outcome = system.step(state, command)
                return state, outcome.converged

            state, converged = jax.lax.scan(step, system.rest(), length=scenario.simulation.steps)
            return jnp.where(converged.all(), state.position[-1], jnp.nan)

        return jax.lax.map(one, moduli)

    def split(numbers: Any, moduli: jax.Array) -> jax.Array:
        return over_cores(swing, (numbers,), moduli)

    run = eqx.filter_jit(split if arms % cores() == 0 else swing, compiler_options=OFTEN)
    given = crinoid.parameters(scenario), jnp.asarray(moduli(arms))

    def failed() -> int:
        return int((~np.isfinite(run(*given))).any(axis=1).sum())

    failed()  # compiles
    return timed(failed, arms, scenario)


def bare() -> crinoid.Scenario:
    """Return the arm that the others swing in air."""
    return crinoid.load(PLANAR, [f"arm.nodes={NODES}", *SOFT, STEADY])


def mujoco_arms(arms: int) -> dict[str, Any]:
    """Time MuJoCo's rods, in the threads of its rollout."""
    import mujoco
    from mujoco import rollout

    import mujoco_rod

    model = mujoco_rod.rod(bare(), MUJOCO_STEP)
    data = [mujoco.MjData(model) for _ in range(cores())]
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data[0], start, kind)
    starts = np.tile(start, (arms, 1))
    with rollout.Rollout(nthread=cores()) as pool:
        pool.rollout(model, data, starts[:1], nstep=1)
        begun, used = time.perf_counter(), time.process_time()
        pool.rollout(model, data, starts, nstep=SWINGS)
        seconds, cpu = time.perf_counter() - begun, time.process_time() - used
    return {
        "seconds": seconds,
        "cpu": cpu,
        "steps": arms * SWINGS,
        "time_step": MUJOCO_STEP,
        "failed": arms if any(map(mujoco_rod.warnings, data)) else 0,
        "memory": 0,
    }


def elastica_arms(arms: int) -> dict[str, Any]:
    """Time PyElastica's rods."""
    return in_processes(elastica_swing, arms, ELASTICA_STEP)


def soromox_arms(arms: int) -> dict[str, Any]:
    """Time SoRoMoX's rods, those of a process together."""
    return in_processes(soromox_swing, arms, SOROMOX_STEP)


def in_processes(
    swing: Callable[[int], tuple[float, int]], arms: int, time_step: float
) -> dict[str, Any]:
    """Time arms in as many processes as there are cores."""
    share = [arms // cores() + (number < arms % cores()) for number in range(cores())]
    share = [each for each in share if each]
    # not forked: a process that has begun threads must not be
    context = multiprocessing.get_context("spawn")
    with ExitStack() as stack:
        # pools of one, so that each compiles what it will run
        pools = [stack.enter_context(ProcessPoolExecutor(1, context)) for _ in share]
        for _ in range(2):
            begun = time.perf_counter()
            runs = [pool.submit(swing, arms) for pool, arms in zip(pools, share, strict=True)]
            found = [run.result() for run in runs]
            seconds = time.perf_counter() - begun
    return {
        "seconds": seconds,
        "cpu": sum(cpu for cpu, _ in found),
        "steps": arms * 10 * SWINGS,
        "time_step": time_step,
        "failed": sum(failed for _, failed in found),
        "memory": 0,
    }


def elastica_swing(arms: int) -> tuple[float, int]:
    """Let arms of PyElastica swing; return the time that it took (s) and how many diverged."""
    os.environ["NUMBA_NUM_THREADS"] = "1"
    import elastica_rod

    rod, failed = elastica_rod.ElasticaRod(bare()), 0
    begun = time.process_time()
    for _ in range(arms):
        failed += not np.isfinite(rod.tips(ELASTICA_STEP, 1, 10 * SWINGS)).all()
    return time.process_time() - begun, failed


def soromox_swing(arms: int) -> tuple[float, int]:
    """Let arms of SoRoMoX swing; return the time that it took (s) and how many diverged."""
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
    rods = soromox_rods()
    begun = time.process_time()
    tips = rods.tips(np.linspace(4.5e5, 5.5e5, arms), SOROMOX_STEP, 10 * SWINGS)
    return time.process_time() - begun, int((~np.isfinite(tips)).any(axis=1).sum())


@cache
def soromox_rods() -> Any:
    """Return the rod of SoRoMoX, compiled once in a process."""
    import soromox_rod

    return soromox_rod.SoromoxRod(bare(), SEGMENTS)


if __name__ == "__main__":
    main()
