"""Comparison of controllers: progress, a file, a figure and a table."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.cli.display import listed, new_table, notes_of_cases, progress_bar, reporter, show
from crinoid.cli.finding import finding
from crinoid.cli.interruption import Interruption
from crinoid.foundation.status import Status
from crinoid.scenario import Scenario, got, one_of, refusal, shown
from crinoid.scenario.control import KINDS
from crinoid.scenario.kinds import installed
from crinoid.studies.comparison import COMPARISON, ControllerComparison
from crinoid.view.figures.controllers import speed_unit
from crinoid.view.figures.style import DEGREES, largest, length_unit, si_unit


def kinds_of(text: str) -> list[str]:
    """Return the kinds of controllers in a list with commas."""
    kinds = [kind.strip() for kind in text.split(",")]
    known = [kind for kind in (*KINDS, *installed("controllers")) if kind != "custom"]
    for kind in kinds:
        if kind not in known:
            text = got(kind, f"be {one_of(known)}, separated by commas")
            raise refusal("--controllers", text)
        if kinds.count(kind) > 1:
            text = f"got {shown(kind)} twice; must name each controller once"
            raise refusal("--controllers", text)
    return kinds


def seeds_of(count: int, first: int) -> range:
    """Return the seeds from the first one on."""
    if count < 1:
        raise refusal("--seeds", got(count, "be at least 1"))
    if first < 0:
        raise refusal("--first-seed", got(first, "be at least 0"))
    return range(first, first + count)


def compare_controllers(
    scenario: Scenario, kinds: list[str], seeds: range, folder: Path, *, force: bool
) -> str:
    """Run a scenario under each controller, save, draw and sum up; return what went wrong."""
    with (
        finding(scenario, folder / COMPARISON, "a comparison", force=force) as found,
        Interruption() as interruption,
    ):
        with progress_bar() as bar:
            comparison = ControllerComparison(scenario, kinds, seeds)

            def stop() -> bool:
                # until a run is complete there is nothing to save: stop immediately
                return comparison.has_runs and interruption.stop()

            comparison.run(reporter(bar, ""), stop)
            interruption.stop()
        data = comparison.dataset()
        rms, notes = data["rms_error"].values, []
        if len(seeds) > 1 and np.isfinite(rms).all() and not np.ptp(rms, axis=1).any():
            notes = ["nothing in this scenario is random: all seeds give the same run"]
        of_runs = {
            name: [note for note in notes if note not in found.doubts]
            for name, notes in comparison.notes.items()
        }
        show(comparison_table(data), [*notes, *notes_of_cases(of_runs)], found.save(data))
    failures = [
        f"{kind} with seed {seed}: {arm.status}"
        for (kind, seed), arm in comparison.runs.items()
        if Status.of(arm.status) not in (Status.OK, Status.INTERRUPTED)
    ]
    text, status = listed(failures, COMPARISON), str(data.attrs["status"])
    if Status.of(status) is Status.INTERRUPTED:
        return f"{status} and saved" + (f"; {text}" if text else "")
    return text


def comparison_table(data: xr.Dataset) -> Table:
    """Return means over the runs that reached their end."""
    rows: list[tuple[str, ...]] = []

    def add(name: str, values: xr.DataArray, text_of: Callable[[float], str]) -> None:
        rows.append((name, *("-" if np.isnan(v) else text_of(v) for v in values.values.tolist())))

    rms, most = data["rms_error"], data["max_error"]
    length = length_unit(largest(most.values)).text
    add("tip error, RMS", rms.mean("seed"), length)
    add("tip error, RMS, worst run", rms.max("seed"), length)
    add("tip error, maximum", most.max("seed"), length)
    kinds, scenario = data["controller"].values, Scenario.from_toml(data.attrs["scenario"])
    moves = scenario.target.moves or (scenario.target.frame == "base" and scenario.base.motion)
    if "none" in kinds and not moves:
        ratio = rms / data["fluctuation"].sel(controller="none", drop=True)
        mean = ratio.where(np.isfinite(ratio)).mean("seed")
        add("tip error over fluctuation", mean, lambda share: f"{share:.1%}")
    if "rms_angle_error" in data:
        add("angle error, RMS", data["rms_angle_error"].mean("seed"), DEGREES.text)
        add("angle error, maximum", data["max_angle_error"].max("seed"), DEGREES.text)
    for index, name in enumerate(data["input"].values):
        speed = data["effort"][..., index]
        unit = speed_unit(str(data["input_unit"].values[index]), largest(speed.values))
        add(f"speed of {name}, RMS", speed.mean("seed"), unit.text)
    work = data["work"]
    joules = si_unit(largest(work.values), "J")
    add("work of base and actuators", work.mean("seed"), joules.text)
    add("time per tick", data["tick_time"], lambda time: si_unit(time, "s").text(time))
    count = data.sizes["seed"]
    complete = np.isfinite(rms.values).sum(axis=1)
    rows.append(("runs", *(str(n) if n == count else f"{n} of {count}" for n in complete)))
    return new_table(data.attrs["title"], ("", *map(str, kinds)), rows)
