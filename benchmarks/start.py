"""How long a whole command takes: a run, cold and with compiled programs kept, help, a mistake.

With ``--before FOLDER``, a checkout of another version, each command is run with both in turn.
"""

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
HERE = Path(__file__).parents[1]
COMMAND = [sys.executable, "-c", "from crinoid.cli import main; main()"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--scenario", nargs="+", default=["station-keeping", "station-keeping-3d"])
    parser.add_argument("--before", type=Path, help="a checkout of another version")
    options = parser.parse_args()
    trees = {"now": HERE} | ({"before": options.before.resolve()} if options.before else {})
    console = Console(highlight=False, markup=False, width=120)
    times: dict[str, dict[str, list[float]]] = {}
    with tempfile.TemporaryDirectory() as place, console.status("starting processes"):
        for repeat in range(options.repeats):
            for command, arguments, code in commands(options.scenario):
                for version, tree in trees.items():
                    home = Path(place) / f"{version}-{repeat}"  # empty at first
                    took = seconds(arguments, tree, home, code)
                    times.setdefault(command, {}).setdefault(version, []).append(took)

    table = Table(title="Wall time of a process", title_justify="left")
    table.add_column("")
    names = [f"{version}, {kind}" for version in trees for kind in ("median", "least")]
    for name in [*names, *(["now / before"] if options.before else [])]:
        table.add_column(name, justify="right")
    for command, each in times.items():
        row = [f"{of(took):.2f} s" for took in each.values() for of in (statistics.median, min)]
        if options.before:
            pairs = zip(each["now"], each["before"], strict=True)
            row.append(f"{statistics.median(now / before for now, before in pairs):.2f}")
        table.add_row(command, *row)
    console.print(table)
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / "start.json"
    path.write_text(json.dumps(times, indent=2), "utf-8")
    console.print(f"wrote {path}")


def commands(scenarios: list[str]) -> list[tuple[str, list[str], int]]:
    """Return what is timed, one after the other: its name, what is called, how it should end."""
    listed = []
    for scenario in scenarios:
        run = [*COMMAND, "run", scenario, "--out", scenario]
        listed += [
            (f"crinoid run {scenario}, nothing compiled yet", run, 0),
            (f"crinoid run {scenario}, compiled before", run, 0),
        ]
    return [
        *listed,
        ("crinoid run, a mistake in the scenario", [*run, "--set", "arm.nodes=two"], 2),
        ("crinoid --help", [*COMMAND, "--help"], 0),
        ("crinoid scenarios", [*COMMAND, "scenarios"], 0),
        ("import crinoid", [sys.executable, "-c", "import crinoid"], 0),
        ("import jax (a part of the runs)", [sys.executable, "-c", "import jax"], 0),
    ]


def seconds(command: list[str], tree: Path, home: Path, code: int) -> float:
    """Run a command of a version to its end, in a home of its own, and return how long it took."""
    home.mkdir(exist_ok=True)
    kept = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    paths = {"PYTHONPATH": str(tree / "src"), "HOME": str(home), "XDG_CACHE_HOME": str(home)}
    begun = time.perf_counter()
    ended = subprocess.run(command, env=kept | paths, capture_output=True, text=True, cwd=home)
    took = time.perf_counter() - begun
    if ended.returncode != code:
        raise RuntimeError(f"{command} ended with {ended.returncode}: {ended.stderr}")
    return took


if __name__ == "__main__":
    main()
