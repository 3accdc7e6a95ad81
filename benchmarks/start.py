"""How long a whole command takes: a run, cold and with compiled code kept, and a mistake."""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

RESULTS = Path(__file__).parent / "results"
COMMAND = [sys.executable, "-c", "from crinoid.cli import main; main()"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--scenario", default="station-keeping")
    options = parser.parse_args()
    console = Console(highlight=False, markup=False, width=100)
    times: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as place, console.status("starting processes"):
        folder = Path(place)
        run = [*COMMAND, "run", options.scenario, "--out", str(folder / "result")]
        mistake = [*run, "--set", "arm.nodes=two"]
        for repeat in range(options.repeats):
            cache = folder / f"cache-{repeat}"  # empty for the first run of each repeat
            for name, command, code in (
                ("crinoid run, nothing compiled yet", run, 0),
                ("crinoid run, compiled before", run, 0),
                ("crinoid run, a mistake in the scenario", mistake, 2),
                ("import crinoid", [sys.executable, "-c", "import crinoid"], 0),
                ("import jax (a part of all of these)", [sys.executable, "-c", "import jax"], 0),
            ):
                times.setdefault(name, []).append(seconds(command, cache, code))

    table = Table(title=f"Wall time of a process ({options.scenario})", title_justify="left")
    table.add_column("")
    for name in ("median", "least"):
        table.add_column(name, justify="right")
    for name, each in times.items():
        table.add_row(name, f"{statistics.median(each):.2f} s", f"{min(each):.2f} s")
    console.print(table)
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "start.json"
    path.write_text(json.dumps(times, indent=2), "utf-8")
    console.print(f"wrote {path}")


def seconds(command: list[str], cache: Path, code: int) -> float:
    """Run a command to its end and return how long it took."""
    environment = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": str(cache),
        # as `crinoid run` sets them for its own cache folder
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    begun = time.perf_counter()
    ended = subprocess.run(command, env=environment, capture_output=True, text=True)
    took = time.perf_counter() - begun
    if ended.returncode != code:
        raise RuntimeError(f"{command} ended with {ended.returncode}: {ended.stderr}")
    return took


if __name__ == "__main__":
    main()
