"""Memory and time of a run that is written to its files while it lasts.

    python benchmarks/streaming.py [--scenario station-keeping] [--pairs 5] [--duration 600]

Memory: the peak of a process that runs a built-in scenario for a tenth of the duration and for all
of it, every time step kept, as `crinoid run` does. Time: the same run held in memory and saved at
its end, and written meanwhile and saved, in pairs, in turns, by the clock and of the processor;
compiling is left out.
"""

import argparse
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.compilation import keep_programs
from crinoid.simulation import play


def scenario(name: str, duration: float, *, every_step: bool) -> crinoid.Scenario:
    values: dict[str, object] = {"simulation.duration": duration, "control.compare": False}
    if every_step:
        values["output.interval"] = crinoid.load(name).simulation.time_step
    return crinoid.load(name).with_values(values)


class Cost(NamedTuple):
    """Seconds until the files of a run are complete."""

    clock: float
    processor: float


def cost(described: crinoid.Scenario, *, streamed: bool) -> Cost:
    """Return what a run takes."""
    folder = Path(tempfile.mkdtemp())
    try:
        prepared = Prepared(described)
        begun = time.perf_counter(), time.process_time()
        play(prepared, into=folder if streamed else None).save(folder)
        return Cost(time.perf_counter() - begun[0], time.process_time() - begun[1])
    finally:
        shutil.rmtree(folder)


def peak(name: str, duration: float) -> float:
    """Return the peak memory (MB) of a process that runs for a duration (s)."""
    ended = subprocess.run(
        [sys.executable, __file__, "--scenario", name, "--only", str(duration)],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    return float(ended.stdout)


def main() -> None:
    takes = argparse.ArgumentParser(description=__doc__)
    takes.add_argument("--scenario", default="station-keeping")
    takes.add_argument("--pairs", type=int, default=5)
    takes.add_argument("--duration", type=float, default=600.0)
    takes.add_argument("--only", type=float, help=argparse.SUPPRESS)
    given = takes.parse_args()
    keep_programs()
    if given.only is not None:
        cost(scenario(given.scenario, given.only, every_step=True), streamed=True)
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
        return
    for duration in (given.duration / 10, given.duration):
        print(
            f"{duration:6.0f} s, every step kept: {peak(given.scenario, duration):.0f} MB at most",
            flush=True,
        )
    for every_step in (False, True):
        described = scenario(given.scenario, given.duration, every_step=every_step)
        cost(described.with_values({"simulation.duration": 1.0}), streamed=True)
        pairs = []
        for number in range(given.pairs):
            turn = (False, True) if number % 2 else (True, False)
            found = {streamed: cost(described, streamed=streamed) for streamed in turn}
            pairs.append((found[False], found[True]))
        print("every step kept" if every_step else f"every {described.output_interval:g} s kept")
        for kind in Cost._fields:
            held, written = (
                [getattr(each, kind) for each in column] for column in zip(*pairs, strict=True)
            )
            more = statistics.median(b / a for a, b in zip(held, written, strict=True)) - 1
            numbers = f"{statistics.median(held):.2f} s, written {statistics.median(written):.2f} s"
            print(f"  {kind:9} in memory {numbers}: {more:+.1%}", flush=True)


if __name__ == "__main__":
    main()
