"""Time a sweep: two workers over one, what a batch costs, and a loop of `crinoid run` beside it."""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from crinoid.cli.sweep import WorkerOptions, open_pool
from crinoid.scenario import load
from crinoid.studies.sweep import SweepDesign, SweepStore, run_batches
from crinoid.studies.sweep.engine import Work, perform
from step import RESULTS

SHORT = """
title = "a short run"
[arm]
nodes = 7
[[flow]]
kind = "gauss-markov"
mean = [0.2, 0.0]
standard_deviation = [0.05, 0.05]
correlation_time = 0.3
[simulation]
duration = 1.0
"""
PROGRAM = ["from crinoid.cli import main", "main()"]
MACHINES, CORES = 100, 16
MANY = 1_000_000


def main() -> None:
    """Time all of it and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--loop", type=int, default=10, help="runs of the loop of `crinoid run`")
    parser.add_argument("--part", type=int, default=300, help="runs by which workers are compared")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--processes", action="store_true", help="workers without dask")
    options = parser.parse_args()
    if options.processes:
        PROGRAM.insert(0, "import sys; sys.modules['distributed'] = None")
        sys.modules["distributed"] = None  # type: ignore[assignment]
    folder = Path(tempfile.mkdtemp())
    (folder / "short.toml").write_text(SHORT, "utf-8")
    try:
        found = measure(folder, options.runs, options.loop, options.part, options.repeats)
    finally:
        shutil.rmtree(folder)
    table = Table(title="A sweep of short runs", title_justify="left", show_header=False)
    for name, value in found.items():
        table.add_row(name, f"{value:.4g}")
    Console(highlight=False, markup=False).print(table)
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "sweep.json").write_text(json.dumps(found, indent=2), "utf-8")


def measure(folder: Path, runs: int, loop: int, part: int, repeats: int) -> dict[str, float]:
    """Time everything, in seconds where nothing else is said."""
    scenario = str(folder / "short.toml")
    command(["sweep", scenario, "--seeds", "2", "--out", str(folder / "warm")])
    command(["run", scenario, "--out", str(folder / "warm-run")])
    found: dict[str, float] = {}
    each = [timed(["run", scenario, "--out", str(folder / f"r{n}")]) for n in range(loop)]
    found["a `crinoid run`, compiled"] = sum(each) / loop
    many = ["--seeds", str(runs), "--batch", "100"]
    whole = timed(["sweep", scenario, *many, "--out", str(folder / "whole")])
    found[f"a sweep of {runs}, from start to end"] = whole
    found["times as many runs as the loop"] = runs * found["a `crinoid run`, compiled"] / whole
    size = sum(path.stat().st_size for path in (folder / "whole").rglob("*") if path.is_file())
    found["kilobytes a run"] = size / runs / 1e3
    names = {(10, 1): "one", (10, 2): "two", (1, 1): "alone"}
    times: dict[str, list[float]] = {name: [] for name in names.values()}
    for _ in range(repeats):  # in turn, so that a busy machine slows all of them alike
        for (batch, workers), name in names.items():
            times[name].append(engine(folder, part, batch, workers))
    one, two, alone = (float(np.median(times[name])) for name in names.values())
    found["a run within a sweep, on one worker"] = one / part
    found["two workers over one"] = one / two
    found["milliseconds that a batch costs"] = 1e3 * (alone - one) / (part - part / 10)
    save, collect = writer(folder, 20_000)
    found["milliseconds in which a batch of 100 is saved"] = 1e3 * save
    found["seconds in which 20000 runs are collected"] = collect
    work = MANY * one / part / MACHINES / CORES
    found[f"minutes of work, {MANY} runs on {MACHINES} x {CORES} cores"] = work / 60
    found[f"minutes in which {MANY} runs are saved"] = save * MANY / 100 / 60
    found[f"minutes in which {MANY} runs are collected"] = collect * MANY / 20_000 / 60
    found[f"gigabytes, {MANY} runs"] = MANY * size / runs / 1e9
    return found


def writer(folder: Path, runs: int) -> tuple[float, float]:
    """Return the time in which a batch of 100 is saved, and that in which all are collected."""
    plan = SweepDesign.of(load(folder / "short.toml"), [], seeds=runs, batch=100)
    store = SweepStore(folder / "writer")
    store.folder.mkdir()
    store.start(plan)
    rows = perform(Work(plan.scenario.to_toml(), [{}])) * 100
    begun = time.perf_counter()
    for number, batch in enumerate(plan.batches):
        store.save(number, batch, rows)
    saved = time.perf_counter()
    store.collect(plan)
    return (saved - begun) / len(plan.batches), time.perf_counter() - saved


def engine(folder: Path, runs: int, batch: int, workers: int) -> float:
    """Return how long batches take, from when all workers have run one."""
    plan = SweepDesign.of(load(folder / "short.toml"), [], seeds=runs, batch=batch)
    warm = SweepDesign.of(load(folder / "short.toml"), [], seeds=4 * workers, batch=1)
    pool = open_pool(WorkerOptions(workers, None))
    place = Path(tempfile.mkdtemp(dir=folder))
    try:
        times = []
        for name, each in (("warm", warm), ("timed", plan)):
            store = SweepStore(place / name)
            store.folder.mkdir(parents=True)
            store.start(each)
            begun = time.perf_counter()
            run_batches(each, store, pool, set(), lambda saved: None, lambda: False)
            times.append(time.perf_counter() - begun)
    finally:
        pool.close()
    return times[-1]


def timed(arguments: list[str]) -> float:
    begun = time.perf_counter()
    command(arguments)
    return time.perf_counter() - begun


def command(arguments: list[str]) -> None:
    """Run the command line in a process of its own."""
    subprocess.run(
        [sys.executable, "-c", "; ".join(PROGRAM), *arguments],
        check=True,
        stdout=subprocess.DEVNULL,
        env=os.environ,
    )


if __name__ == "__main__":
    main()
