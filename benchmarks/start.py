"""Size of programs, and time of commands: the first, with nothing compiled before, and later."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import jaxprs_in_params

import crinoid
from benchmarks.measurement import Rows, Scope, row, seconds_of
from benchmarks.step import ARMS
from crinoid.assembly.plan import find_state
from crinoid.assembly.prepared import Prepared
from crinoid.scenario import load

_COMMAND = "from crinoid.cli import main; main()"


def benchmark(scope: Scope) -> Rows:
    """Yield equations of programs, and times of commands, each in a home that is empty at first."""
    yield from _sizes(scope)
    commands = {
        "crinoid run station-keeping": [_COMMAND, "run", "station-keeping"],
        "crinoid run station-keeping-3d": [_COMMAND, "run", "station-keeping-3d"],
        "crinoid --help": [_COMMAND, "--help"],
        "import crinoid": ["import crinoid"],
        "import jax": ["import jax"],
    }
    for name, code in list(commands.items())[-scope.most if scope.most else 0 :]:
        times: dict[str, list[float]] = {"first time": [], "later": []}
        for _ in range(max(1, scope.repeats // 2)):
            with tempfile.TemporaryDirectory() as home:
                for when in times:
                    times[when].append(seconds_of(partial(_run, code, Path(home))))
        for when, each in times.items():
            yield row(f"{name}, {when}", "time", "s", each)


def _sizes(scope: Scope) -> Rows:
    """Yield how many equations JAX traces for a step of the built-in scenarios, and at the start.

    They take most of the time to trace and to compile, and no busy machine changes them.
    """
    for axes, name in list(ARMS.items())[: scope.most]:
        system = Prepared(load(name)).system
        state, command = jax.eval_shape(system.rest), jnp.zeros(len(system.inputs))
        for program, traced in {
            "time step": jax.make_jaxpr(system.step)(state, command),
            "equilibrium": jax.make_jaxpr(partial(find_state.function, system, True))(),
        }.items():
            yield row(f"{program}, {axes}", "equations", "1", [float(equations(traced.jaxpr))])


def equations(traced: Any) -> int:
    """Return the number of equations of a trace, those of its parts included."""
    parts = [part for each in traced.eqns for part in jaxprs_in_params(each.params)]
    return len(traced.eqns) + sum(map(equations, parts))


def _run(code: Sequence[str], home: Path) -> None:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    source = str(Path(crinoid.__file__).parents[1])
    own = {"PYTHONPATH": source, "HOME": str(home), "XDG_CACHE_HOME": str(home)}
    subprocess.run(
        [sys.executable, "-c", *code], env=kept | own, cwd=home, capture_output=True, check=True
    )
