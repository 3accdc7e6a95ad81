"""Summary of a result: its numbers by name in SI units, as JSON and CSV."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.status import Status
from crinoid.results.effort import input_speed, input_units, input_use, solver_use, speed_unit
from crinoid.results.metrics import MEASURES, RunStatistics, known, measures_of
from crinoid.results.result import Result

SUMMARY_JSON, SUMMARY_CSV = "summary.json", "summary.csv"
HEAD = ("name", "value", "uncontrolled", "unit", "meaning")
"""Columns of the table."""
_FREQUENCIES = 4  # natural frequencies of an equilibrium


class SummaryEntry(NamedTuple):
    """A number of a result."""

    unit: str
    meaning: str
    value: float | int | None  # None where a result has no such number
    uncontrolled: float | int | None = None  # that of the run without control


def summarised(result: Result) -> dict[str, SummaryEntry]:
    """Return the numbers of a result by name; an equilibrium is a result of one instant."""
    rests = result.dataset.sizes["time"] == 1 and result.ended is Status.OK
    return dict(numbers_at_rest(result) if rests else _of_run(result))


def write_summary(result: Result, folder: Path) -> list[Path]:
    """Write the numbers of a result to ``summary.json`` and ``summary.csv``; return their paths.

    Raises
    ------
    OSError
        If the folder cannot be written to, or the disk is full.
    """
    with np.errstate(all="ignore"):  # a run that diverged may hold huge numbers
        entries, attributes = summarised(result), result.dataset.attrs
    document = {
        "crinoid_version": attributes.get("crinoid_version"),
        "title": attributes.get("title"),
        "status": result.status,
        "seed": int(attributes.get("seed", result.scenario.seed)),
        **{name: known(each.value) for name, each in entries.items()},
    }
    if result.uncontrolled is not None:
        document["uncontrolled"] = {"status": result.uncontrolled.status} | {
            name: known(each.uncontrolled)
            for name, each in entries.items()
            if each.uncontrolled is not None
        }
    document["units"] = {name: each.unit for name, each in entries.items()}
    paths = [folder / SUMMARY_JSON, folder / SUMMARY_CSV]
    with atomic_write(paths[0]) as temporary:
        text = json.dumps(document, indent=2, allow_nan=False, ensure_ascii=False)
        temporary.write_text(text + "\n", "utf-8")
    with (
        atomic_write(paths[1]) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        table = csv.writer(file, quoting=csv.QUOTE_NONNUMERIC)
        table.writerow(HEAD)
        for name, each in entries.items():
            values = (known(each.value), known(each.uncontrolled))
            table.writerow([name, *values, each.unit, each.meaning])
    return paths


def _of_run(result: Result) -> Iterator[tuple[str, SummaryEntry]]:
    """Yield the measures of a run, the use of its inputs, and its time steps."""
    runs = [RunStatistics(each) for each in (result, result.uncontrolled) if each is not None]
    for name, measure in measures_of(result.scenario).items():
        values = [known(measure.read(run)) for run in runs]
        # once for both runs; the other one's are the same number
        values = values[:1] if name in ("rms_error_uncontrolled", "deflection") else values
        yield name, SummaryEntry(measure.unit, measure.meaning, *values)
    yield from _inputs(result)
    use = zip(*(solver_use(run.result) for run in runs), strict=True)
    simulated, steps, iterations, wall = use
    judged = result.scenario.judged_from
    yield "judged_from", SummaryEntry("s", "time from which errors count", judged)
    yield "simulated_time", SummaryEntry("s", "time that was simulated", *simulated)
    yield "time_steps", SummaryEntry("1", "number of time steps", *steps)
    yield "newton_iterations", SummaryEntry("1", "Newton iterations a step", *iterations)
    yield "wall_time", SummaryEntry("s", "computing time", *wall)


def _inputs(result: Result) -> Iterator[tuple[str, SummaryEntry]]:
    """Yield the use of each input that a controller drives, and the speed of each that can move."""
    unit = input_units(result.dataset)
    for name, use in input_use(result).items():
        yield f"{name}.rms", SummaryEntry(unit[name], f"RMS of {name}", use.rms)
        yield f"{name}.low", SummaryEntry(unit[name], f"lowest value of {name}", use.low)
        yield f"{name}.high", SummaryEntry(unit[name], f"highest value of {name}", use.high)
    for name, speed in input_speed(result).items():
        yield f"{name}.speed", SummaryEntry(speed_unit(unit[name]), f"RMS speed of {name}", speed)


def numbers_at_rest(result: Result) -> Iterator[tuple[str, SummaryEntry]]:
    """Yield the numbers of an equilibrium."""
    data = result.dataset
    vectors = {
        "tip": ("tip_position", "m", "position of the tip"),
        "tip_direction": ("tip_direction", "1", "direction of the tip"),
        "base_force": ("base_force", "N", "force of the arm on its base"),
        "base_moment": ("base_moment", "N m", "moment of the arm on its base"),
    }
    for name, (variable, unit, meaning) in vectors.items():
        if variable not in data:
            continue
        values = data[variable].values[0]
        if values.ndim:
            for axis, value in zip(data["axis"].values, values, strict=True):
                yield f"{name}_{axis}", SummaryEntry(unit, f"{meaning}, {axis}", float(value))
        else:
            yield name, SummaryEntry(unit, meaning, float(values))
    angle = data["tip_angle"]
    yield "tip_angle", SummaryEntry("rad", angle.attrs["long_name"], float(angle[0]))
    if "tension" in data:
        tension = float(data["tension"].max())
        yield "max_tension", SummaryEntry("N", "largest axial force in the arm", tension)
    run = RunStatistics(result)
    for name in ("max_curvature", "max_strain"):
        for each in (name, f"{name}_station"):
            measure = MEASURES[each]
            yield each, SummaryEntry(measure.unit, measure.meaning, known(measure.read(run)))
    if "twist" in data:
        twist = float(np.abs(data["twist"]).max())
        yield "max_twist", SummaryEntry("rad m-1", "largest twist of the arm", twist)
    if "contact_force" in data:
        for index, force in enumerate(data["contact_force"].values[0]):
            for axis, value in zip(data["axis"].values, force, strict=True):
                meaning = f"force of obstacle {index}, {axis}"
                yield f"contact_force_{index}_{axis}", SummaryEntry("N", meaning, float(value))
    if "natural_frequency" in data:
        for number, value in enumerate(data["natural_frequency"].values[:_FREQUENCIES], start=1):
            meaning = f"natural frequency {number}"
            yield f"natural_frequency_{number}", SummaryEntry("Hz", meaning, float(value))
