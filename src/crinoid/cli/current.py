"""Showing the current of a scenario: a file, figures and a table."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from crinoid.cli.finding import place_of, prepare_one, save_finding
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.notes import say_doubts
from crinoid.current import FLOW, Statistics, sample_current, statistics
from crinoid.plausibility import IN_THE_WATER
from crinoid.recording import Recording
from crinoid.scenario import Scenario


def show_current(scenario: Scenario, folder: Path, *, force: bool, console: Console) -> None:
    """Sample the current of a scenario at its arm, save and draw it, and sum it up."""
    prepared = prepare_one(scenario, "a current")
    if not scenario.flow:
        console.print("still water: the scenario has no [[flow]]")
        return
    prepared.notes()  # which reads the files
    with place_of(folder / FLOW, force=force):
        say_doubts(console, prepared, IN_THE_WATER)
        dataset = sample_current(prepared)
        files = save_finding(dataset, folder / FLOW)
    time = dataset["time"].values
    late = time >= dataset.attrs["settled"] - 1e-9
    found = [
        statistics(dataset["flow_velocity"].sel(place=place).values[late], time[1] - time[0])
        for place in ("root", "tip")
    ]
    axes = ", ".join(dataset["axis"].values)
    console.print(_table(dataset.attrs["title"], axes, time[late], *found))
    for index, recording in prepared.recordings.items():
        console.print(f"flow.{index}: {_described(recording)}", soft_wrap=True)
    say_notes(console, dataset.attrs["notes"].splitlines())
    say_written(console, files)


def _table(title: str, axes: str, time: np.ndarray, root: Statistics, tip: Statistics) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column(f"{time[0]:g} to {time[-1]:g} s")
    for place in ("at the root", "at the tip"):
        table.add_column(place, justify="right")

    def add(name: str, texts: list[str]) -> None:
        table.add_row(name, *texts)

    both = (root, tip)
    add(f"mean velocity {axes}", [_row(found.mean, "m/s") for found in both])
    add("mean speed", [f"{found.mean_speed:.3f} m/s" for found in both])
    add("greatest speed", [f"{found.greatest_speed:.3f} m/s" for found in both])
    add(f"standard deviation {axes}", [_row(found.standard_deviation, "m/s") for found in both])
    add(f"intensity {axes}", [_row(100 * found.intensity, "%", 1) for found in both])
    add(f"integral time {axes}", [_row(found.integral_time, "s", 2) for found in both])
    add(f"integral length {axes}", [_row(found.integral_length, "m", 2) for found in both])
    return table


def _row(values: np.ndarray, unit: str, digits: int = 3) -> str:
    """Write the values of all axes; a dash for what there is not."""
    texts = ("-" if np.isnan(value) else f"{value + 0.0:.{digits}f}" for value in values)
    return f"{', '.join(texts)} {unit}"


def _described(recording: Recording) -> str:
    text = (
        f"{recording.name}, {recording.length:.6g} s at {1 / recording.interval:.6g} Hz, "
        f"{recording.time.size} samples"
    )
    if recording.levels is None:
        text += " at one place"
    else:
        low, high = recording.levels[[0, -1]]
        text += f" at {recording.levels.size} levels from z = {low:.4g} to {high:.4g} m"
    if recording.time_scale != 1:
        text += f"; a second of it lasts {recording.time_scale:g} s"
    text += f"; the run begins {recording.begins:.4g} s into it"
    distance = float(np.linalg.norm(recording.slowness))
    if distance > 0:
        text += f" and it is carried past the arm at {1 / distance:.3g} m/s"
    return text
