"""The command: progress, tables, a file with all numbers and a figure for each."""

import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import matplotlib as mpl
import typer
from rich.table import Table

from benchmarks.engines import Engine, find_peers
from benchmarks.figure import draw_benchmark
from benchmarks.measurement import Row, Scope
from benchmarks.registry import BENCHMARKS, title
from crinoid.cli.command import console, folder_for
from crinoid.cli.declaration import Command, Option, out
from crinoid.cli.display import new_table, say_notes, say_written
from crinoid.cli.folder import claimed
from crinoid.cli.interruption import Interrupted
from crinoid.compilation import free_memory
from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.cores import cores
from crinoid.foundation.status import Status
from crinoid.foundation.version import __version__, versions
from crinoid.results.units import length_unit, si_unit
from crinoid.scenario.errors import got, one_of, refusal
from crinoid.view.figures import style

BENCH = "bench.json"

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False)


Command(
    "bench",
    "benchmarks.command:bench",
    "Measure times of steps, runs and commands, and the errors that they buy.",
    Option(
        "NAME", list[str], "Benchmarks; --list names them.", "all", name="names", required=False
    ),
    Option("--peers", False, "Run other programs that are installed, too."),
    Option("--list", False, "List the benchmarks, and run none.", name="listed"),
    out("results/bench"),
    Option("--force", False, "Replace earlier benchmarks."),
).add_to(app)


def bench(
    names: list[str] | None, out: Path | None, *, peers: bool, listed: bool, force: bool
) -> str:
    """Run benchmarks, or list all."""
    folder = folder_for(out, "bench")
    if listed:
        list_benchmarks()
        return ""
    return run_benchmarks(chosen(names or ()), folder, peers=peers, force=force)


def chosen(names: Sequence[str]) -> list[str]:
    """Return the names of benchmarks in their order, all without any."""
    for name in names:
        if name not in BENCHMARKS:
            raise refusal("NAME", got(name, f"be {one_of(BENCHMARKS)}"))
    return [name for name in BENCHMARKS if not names or name in names]


def list_benchmarks() -> None:
    """Print the names of all benchmarks with what each measures."""
    width = max(map(len, BENCHMARKS)) + 2
    for name in BENCHMARKS:
        console.print(f"{name:{width}}{title(name)}", soft_wrap=True)


def run_benchmarks(
    names: Sequence[str], folder: Path, *, peers: bool, force: bool, scope: Scope | None = None
) -> str:
    """Run benchmarks, print and save their rows, and draw them; return what went wrong."""
    with claimed(folder):
        if (folder / BENCH).exists() and not force:
            text = f"{folder} contains benchmarks. Choose another folder, or use --force to "
            raise refusal("--out", f"{text}replace them.")
        engines, missing = find_peers() if peers else ((), [])
        say_notes(missing)
        scope = (scope or Scope())._replace(peers=engines)
        found: dict[str, dict[str, Any]] = {}
        troubles: list[str] = []
        try:
            for name in names:
                rows: list[Row] = []
                remarks: list[str] = []
                found[name] = {"title": title(name), "rows": rows, "remarks": remarks}
                with console.status(f"{name}: {title(name)}"):
                    try:
                        for each in BENCHMARKS[name].benchmark(scope):
                            (remarks if isinstance(each, str) else rows).append(each)
                    except (RuntimeError, subprocess.SubprocessError) as error:
                        troubles.append(f"{name}: {error}")
                free_memory()
                _show(rows)
                say_notes(remarks)
        except (Interrupted, KeyboardInterrupt):
            troubles = [f"{Status.INTERRUPTED} in {name}, what was measured is saved"]
            if not any(each["rows"] for each in found.values()):
                raise
        trouble = "; ".join(troubles)
        say_written(_save(folder, found, engines, trouble or Status.OK.value))
    return trouble


def _save(
    folder: Path, found: dict[str, dict[str, Any]], engines: Sequence[Engine], status: str
) -> list[Path]:
    """Write the rows with what they depend on, and draw each benchmark; return the files."""
    measured = {
        name: {**each, "rows": [row._asdict() for row in each["rows"]]}
        for name, each in found.items()
    }
    contents = {
        "command": " ".join(["python -m benchmarks", *sys.argv[1:]]),
        "status": status,
        "date": datetime.now(UTC).date().isoformat(),
        "machine": {"processor": _processor(), "cores": cores(), "system": platform.system()},
        "versions": versions(),
        "peers": [{"name": engine.name, "leaves out": engine.omits} for engine in engines],
        "benchmarks": measured,
    }
    with atomic_write(folder / BENCH) as temporary:
        temporary.write_text(json.dumps(contents, indent=1, allow_nan=False), "utf-8")
    files = [folder / BENCH]
    for name, each in measured.items():
        if each["rows"]:
            files.append(folder / f"{name}.png")
            with mpl.rc_context(style.STYLE), atomic_write(files[-1]) as temporary:
                metadata = {"Software": f"crinoid {__version__}", "Source": BENCH}
                figure = draw_benchmark(each["title"], each["rows"])
                figure.savefig(temporary, format="png", facecolor="white", metadata=metadata)
    return files


def _processor() -> str:
    """Return the name of the processor."""
    if os.path.exists("/proc/cpuinfo"):
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(": ")[2]
    return platform.processor() or platform.machine()


def _show(rows: Sequence[Row]) -> None:
    """Print a table for each quantity; the figure has the curves of those with an error."""
    rows = [row for row in rows if "error" not in row.at]
    for quantity in dict.fromkeys(row.quantity for row in rows):
        console.print(_table(quantity, [row for row in rows if row.quantity == quantity]))


def _table(quantity: str, rows: Sequence[Row]) -> Table:
    keys = list(dict.fromkeys(key for row in rows for key in row.at))
    engines = len({row.engine for row in rows}) > 1
    heads = ["", *(["engine"] if engines else []), *(key.replace("_", " ") for key in keys)]
    lines = [
        [
            row.name,
            *([row.engine] if engines else []),
            *(f"{row.at[key]:.3g}" if key in row.at else "" for key in keys),
            *(shown(value, row.unit) for value in (row.median, row.least, row.most)),
        ]
        for row in rows
    ]
    return new_table(quantity, [*heads, "median", "least", "most"], lines)


def shown(value: float, unit: str) -> str:
    """Return a value with its unit."""
    if unit == "1":
        return f"{value:.3g}" if value < 1e3 else f"{value:,.0f}"
    if unit == "1/s":
        return f"{value:,.0f} 1/s"
    return (length_unit(abs(value)) if unit == "m" else si_unit(abs(value), unit)).text(value)
