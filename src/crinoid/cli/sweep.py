"""A sweep: checks, workers, progress, tables, and an estimate from a trial run."""

import os
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float
from rich import box
from rich.progress import Progress
from rich.table import Table

from crinoid.assembly.prepared import Prepared
from crinoid.cli.command import console
from crinoid.cli.display import (
    listed,
    new_table,
    notes_of_cases,
    progress_bar,
    say_notes,
    say_written,
)
from crinoid.cli.finding import checked_runs
from crinoid.cli.folder import claimed, clear
from crinoid.cli.interruption import Interruption
from crinoid.cli.seed_means import SeedTables
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.foundation.status import Status
from crinoid.results.measure_labels import head_of, main_measures, unit_for
from crinoid.results.metrics import CASES, measures_of
from crinoid.results.units import length_unit
from crinoid.scenario import counted, refusal, shown
from crinoid.simulation import Progress as RunProgress
from crinoid.simulation import play
from crinoid.studies.sweep.engine import WorkerPool, WorkerPoolError, run_batches
from crinoid.studies.sweep.long_term import extremes_of, judged_time
from crinoid.studies.sweep.plan import PLAN, SweepDesign, read_plan
from crinoid.studies.sweep.store import SweepStore

_MOST_TRIED = 1000  # values of a key that are tried before a sweep starts
_MOST_TOLD = 100  # structures whose implausible values are reported
_ONE_THREAD = ("NPROC", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Variables that keep XLA and linear algebra of a worker to one thread."""
_LONGEST = 10.0  # time after which a trial is long enough (s)
_RUN, _BATCH = 400, 18_000  # bytes on the disk of a run, and of a batch without its runs


def open_pool(workers: int, scheduler: str | None) -> WorkerPool:
    """Start processes of this machine, or find the workers of a scheduler."""
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    from crinoid.studies.sweep.workers import Cluster, Processes

    if scheduler is None:
        return Processes(workers)
    try:
        return Cluster(scheduler)
    except ImportError:
        text = "needs dask.distributed: pip install 'crinoid[sweep]'"
        raise refusal("--scheduler", text) from None
    except WorkerPoolError as error:
        raise refusal("--scheduler", str(error)) from error


def run_sweep(
    plan: SweepDesign,
    folder: Path,
    workers: int,
    scheduler: str | None,
    *,
    sized: bool,
    resume: bool,
    force: bool,
    shares: Float[np.ndarray, " case"] | None = None,
) -> str:
    """Run a sweep, collect and sum up its runs; return what went wrong, if anything.

    ``sized`` says whether the user chose the size of batches; ``shares`` are those of time of the
    cases.
    """
    shares = None if shares is None else np.repeat(shares, plan.seeds) / plan.seeds
    store = SweepStore(folder)
    there = store.files()
    known = resume and PLAN in there
    if known:
        earlier = read_plan(folder)
        asked = (plan if sized else replace(plan, batch=earlier.batch)).to_dict()
        differing = [key for key, value in earlier.to_dict().items() if value != asked[key]]
        if differing:
            text = f"the sweep in {folder} is of another plan ({', '.join(differing)} differ"
            text += f"{'s' if len(differing) == 1 else ''}). Repeat its command, or choose another "
            raise refusal("--resume", f"{text}folder.")
        plan = earlier
    elif there and not force:
        text = f"{folder} contains {there[0]} already. Choose another folder, or use --resume "
        text += "to continue a sweep, or --force to replace it."
        raise refusal("--out", text)
    say_notes(notes_of(plan))
    with claimed(folder):
        store.tidy()
        if not known:
            clear(folder, {}, force=force)
            store.start(plan)
        done, start = store.finished(plan), partial(open_pool, workers, scheduler)
        with Interruption() as interruption:
            interruption.stop()  # from here on there is something to save
            try:
                with progress_bar() as bar:
                    if not _run(plan, store, start, done, bar, interruption.stop):
                        return f"{Status.INTERRUPTED}: {_saved(plan, done)}"
                    bar.update(bar.task_ids[0], description="collecting", reached="")
                    data, files = store.collect(plan, shares)
            except OSError as error:
                reason = f"{error.filename or folder}: {error.strerror or error}"
                return f"{reason}; {_saved(plan, done)}"
            except WorkerPoolError as error:
                return f"{error}; {_saved(plan, done)}"
    numbers = {name: data[name].values for name in measures_of(plan.scenario)}
    means = SeedTables(plan, range(1, plan.runs + 1), numbers)
    tables, notes = [sweep_table(data, shares)], list[str]()
    if shares is not None:
        tables += [extremes_table(data)] * bool(extremes_of(data))
        notes = _long_term_notes(data, plan)
    say_written([*files, *means.show(tables, folder, notes)])
    errors, status = data["rms_error"].values, data["status"].values
    if np.isfinite(errors).any():
        for word, at in (("best", np.nanargmin(errors)), ("worst", np.nanargmax(errors))):
            say_run(plan, folder, word, int(at) + 1, float(errors[at]))
    failures = [
        f"run {number} {words}"
        for number, words in enumerate(status, start=1)
        if Status.of(words) is not Status.OK
    ]
    if not failures:
        return ""
    text = f"{len(failures)} of {len(status)} runs did not reach their end"
    return f"{text}: {listed(failures, CASES)}"


def say_run(plan: SweepDesign, folder: Path, word: str, run: int, error: float) -> None:
    """Print a run with its values and its RMS error, and the command that plays it."""
    values = ", ".join(f"{key} = {shown(value)}" for key, value in plan.values(run).items())
    case = f"run {run} ({values})" if values else f"run {run}"
    text = f"{word}: {case}, RMS tip error {length_unit(error).text(error)}"
    console.print(f"{text}\nplay it: crinoid run --case {folder} {run}", soft_wrap=True)


def notes_of(plan: SweepDesign) -> list[str]:
    """Check representative runs of a plan, and return notes on the first of each structure."""
    firsts = {plan.name(int(runs[0])) for runs in plan.structures[:_MOST_TOLD]}
    found = notes_of_cases(
        {
            name: plausibility_warnings(prepared)
            for name, prepared in checked_runs(plan, plan.examples(_MOST_TRIED), plan.option)
            if name in firsts
        }
    )
    if plan.sampling in ("sobol", "saltelli") and plan.count.bit_count() > 1:
        found.append(f"--count: {plan.count} is no power of two, which Sobol points balance by")
    return found


def _run(
    plan: SweepDesign,
    store: SweepStore,
    start: Callable[[], WorkerPool],
    done: set[int],
    bar: Progress,
    stop: Callable[[], bool],
) -> bool:
    """Run the missing batches, and return whether all are there."""
    if len(done) == len(plan.batches):
        return True
    task = bar.task_ids[0]
    bar.update(task, description="starting")
    pool = start()

    def report(saved: int) -> None:
        if bar.tasks[0].total is None:  # the time left is that of the present runs
            bar.reset(task, total=plan.runs, completed=saved, description="sweep")
        reached = f"{saved} of {plan.runs} runs{'' if saved else ', compiling first'}"
        bar.update(task, completed=saved, reached=reached)

    try:
        return run_batches(plan, store, pool, done, report, stop, lambda text: say_notes([text]))
    finally:
        pool.close()


def _saved(plan: SweepDesign, done: set[int]) -> str:
    text = f"{len(done)} of {counted(len(plan.batches), 'batch', 'batches')}"
    return f"{text} {'is' if len(done) == 1 else 'are'} saved, --resume goes on from there"


def sweep_table(data: xr.Dataset, shares: Float[np.ndarray, " run"] | None = None) -> Table:
    """Return quantiles over the runs that reached their end, and means by their share of time."""
    rows, heads = [], ["", "smallest", "run", "median", "95 %", "largest", "run"]
    names = [str(name) for name, each in data.items() if each.dims == ("run",) and name != "status"]
    for name in main_measures(names):
        values = data[name].values
        known = values[np.isfinite(values)]
        if known.size == 0:
            continue
        unit = unit_for(data[name])
        low, middle, high, most = map(unit.number, np.quantile(known, (0.0, 0.5, 0.95, 1.0)))
        runs = [str(data["run"].values[at(values)]) for at in (np.nanargmin, np.nanargmax)]
        rows.append([head_of(name, unit), low, runs[0], middle, high, most, runs[1]])
        if shares is not None and name != "life":
            weights = shares[np.isfinite(values)]
            mean = known @ weights / weights.sum() if weights.any() else np.nan
            rows[-1].append(unit.number(float(mean)))
    complete, count = int(np.isfinite(data["rms_error"].values).sum()), data.sizes["run"]
    rows.append(["runs", str(count) if complete == count else f"{complete} of {count}"])
    if shares is not None:
        heads.append("mean of time")
        well = [Status.of(words) is Status.OK for words in data["status"].values]
        rows.append(["time that ends well", *[""] * 6, f"{shares[well].sum():.2%}"])
        if np.isfinite(part := float(data.get("combined_within_tolerance", np.nan))):
            rows.append(["time within tolerance over all of it", *[""] * 6, f"{part:.2%}"])
        if np.isfinite(life := float(data.get("combined_life", np.nan))):
            rows.append(["fatigue life over all of it", *[""] * 6, f"{life:.3g} year"])
    return new_table(data.attrs["title"], heads, rows, box=box.SIMPLE, pad_edge=False)


def extremes_table(data: xr.Dataset) -> Table:
    """Return the main extremes over all cases by return period, with the interval of the last."""
    found, rows, periods = extremes_of(data), [], [f"{each:g}" for each in data["return_period"]]
    for name in main_measures(map(str, found)):
        unit = unit_for(found[name])
        numbers = found[name].sel(estimate="value").values
        low, high = map(unit.number, found[name].values[-1, 1:])
        rows.append([head_of(name, unit), *map(unit.number, numbers), f"{low} to {high}"])
    heads = ["exceeded once in (year)", *periods, f"95 % interval, {periods[-1]}"]
    return new_table("Over all of it", heads, rows, box=box.SIMPLE, pad_edge=False)


def _long_term_notes(data: xr.Dataset, plan: SweepDesign) -> list[str]:
    """Return how far extremes extrapolate, or why there are none, and how failures count."""
    runs = f"{counted(plan.seeds, 'seed')} of {judged_time(plan):g} s in each case"
    notes = [f"extremes extrapolate {runs} to {float(data['return_period'].max()):g} years"]
    if not extremes_of(data):
        text = f"no extremes by return period from {runs}"
        notes = [f"{text}: 3 or more must reach their end and differ. Use --seeds 10."]
    if "combined_within_tolerance" in data and data["within_tolerance"].isnull().any():
        notes.append("a run that fails is outside of the tolerance all the time")
    return notes


def estimate_sweep(plan: SweepDesign, workers: int, scheduler: str | None) -> None:
    """Estimate the cost of a sweep from a trial of its first run; write nothing."""
    say_notes(notes_of(plan))
    if scheduler is not None:
        pool = open_pool(workers, scheduler)
        workers = sum(pool.workers().values())
        pool.close()
    with console.status("timing the first run"):
        _play(plan, 0.0)  # compiling does not count
        started = time.perf_counter()
        part = _play(plan, _LONGEST)
        seconds = (time.perf_counter() - started) / part
    whole = "whole" if part > 0.99 else f"{part:.1%} of it"
    hours = plan.runs * seconds / 3600 / max(1, workers)
    size = (plan.runs * _RUN + len(plan.batches) * _BATCH) / 1e9
    rows = (
        ("runs", str(plan.runs)),
        ("batches", f"{len(plan.batches)} of up to {plan.batch} runs"),
        ("structures", str(len(plan.structures))),
        ("workers", str(workers)),
        ("time of a run", f"{seconds:.3g} s on one core (timed: the first run, {whole})"),
        ("hours", f"{hours:.3g}" if workers else "unknown: the scheduler has no workers"),
        ("gigabytes", f"{size:.2g}"),
    )
    console.print(new_table(plan.scenario.title or None, (), rows, show_header=False))


def _play(plan: SweepDesign, seconds: float) -> float:
    """Play the first run for some seconds at least, and return the part of it that was played."""
    case = plan.case(1)
    ends: dict[str, float] = {}
    end = time.perf_counter() + seconds

    def report(progress: RunProgress) -> None:
        ends[progress.label] = progress.time

    play(Prepared(case), report=report, stop=lambda: time.perf_counter() > end, steps=plan.steps)
    stages = 1 + case.control.compared
    return max(sum(ends.values()), case.simulation.time_step) / (stages * case.simulation.duration)
