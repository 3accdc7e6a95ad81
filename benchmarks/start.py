"""Time of whole commands: the first one, with nothing compiled before, and later ones."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import crinoid
from benchmarks.measurement import Rows, Scope, row, seconds_of

_COMMAND = "from crinoid.cli import main; main()"


def benchmark(scope: Scope) -> Rows:
    """Yield times of commands from start to end, each in a home that is empty at first."""
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


def _run(code: Sequence[str], home: Path) -> None:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    source = str(Path(crinoid.__file__).parents[1])
    own = {"PYTHONPATH": source, "HOME": str(home), "XDG_CACHE_HOME": str(home)}
    subprocess.run(
        [sys.executable, "-c", *code], env=kept | own, cwd=home, capture_output=True, check=True
    )
