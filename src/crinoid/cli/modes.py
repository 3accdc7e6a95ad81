"""Finding the small vibrations of a scenario's arm: a file, a figure and a table."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

from crinoid.cli.finding import place_of, prepare_one, save_finding
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.notes import say_doubts
from crinoid.plausibility import AT_REST
from crinoid.scenario import Scenario
from crinoid.simulation import MODES, find_vibrations


def show_modes(
    scenario: Scenario, folder: Path, *, count: int, in_air: bool, force: bool, console: Console
) -> str:
    """Find the modes of a scenario, save, draw and show them; return the failure, if any."""
    prepared = prepare_one(scenario, "a mode")
    with place_of(folder / MODES, force=force):
        with console.status("looking for equilibria and modes"):
            dataset, trouble = find_vibrations(prepared, count=count, in_air=in_air)
        say_doubts(console, prepared, AT_REST)
        if dataset is None:
            return trouble
        files = save_finding(dataset, folder / MODES)
    console.print(_table(dataset))
    for medium in dataset["medium"].values:
        here = dataset.sel(medium=medium)
        console.print(f"{medium}: {_described(here)}", soft_wrap=True)
    say_notes(console, dataset.attrs["notes"].splitlines())
    say_written(console, files)
    return trouble


def _table(dataset: xr.Dataset) -> Table:
    table = Table(title=dataset.attrs["title"], title_justify="left")
    table.add_column("mode", justify="right")
    for medium in dataset["medium"].values:
        table.add_column(f"{medium}\n(Hz)", justify="right")
        table.add_column("damping\nratio", justify="right")
    for mode in dataset["mode"].values:
        of = dataset.sel(mode=mode)
        pairs = zip(of["frequency"].values, of["damping_ratio"].values, strict=True)
        table.add_row(str(mode), *(_cell(value) for pair in pairs for value in pair))
    return table


def _cell(value: float) -> str:
    if np.isnan(value):
        return "-"
    return "0" if abs(value) < 1e-6 else f"{value:.4g}"


def _described(here: xr.Dataset) -> str:
    axes = [str(axis) for axis in here["axis"].values]

    def parts(vector: np.ndarray, digits: int) -> str:
        named = zip(axes, vector + 0.0, strict=True)
        return ", ".join(f"{axis} {part:.{digits}f}" for axis, part in named)

    text = f"the tip rests at {parts(here['position'].values[-1].round(4), 4)} m"
    current = here["current"].values
    return f"{text} in water of {parts(current, 3)} m/s" if current.any() else text
