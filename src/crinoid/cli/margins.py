"""Finding the margins of a scenario's control loop: a file, figures and a table."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

from crinoid.cli.finding import place_of, prepare_one, save_finding
from crinoid.cli.lines import say_notes, say_written
from crinoid.cli.notes import say_doubts
from crinoid.report.units import DEGREES, Unit, si_unit
from crinoid.scenario import Scenario
from crinoid.simulation.margins import MARGINS, find_margins


def show_margins(scenario: Scenario, folder: Path, *, force: bool, console: Console) -> None:
    """Find the margins of a scenario's loop, save, draw and show them."""
    prepared = prepare_one(scenario, "a margin")
    prepared.check()
    with place_of(folder / MARGINS, force=force):
        say_doubts(console, prepared)
        with console.status("linearising the loop"):
            dataset = find_margins(prepared)
        files = save_finding(dataset, folder / MARGINS)
    console.print(margins_table(dataset))
    say_notes(console, dataset.attrs["notes"].splitlines())
    say_written(console, files)


def margins_table(data: xr.Dataset) -> Table:
    """Sum up the margins of a loop."""
    table = Table(title=str(data.attrs["title"]), title_justify="left")
    table.add_column("")
    for name in ("margin", "at"):
        table.add_column(name, justify="right")

    def add(name: str, variable: str, text: str) -> None:
        where = float(data[f"{variable}_frequency"])
        table.add_row(name, text, f"{where:.3g} Hz" if np.isfinite(where) else "")

    stable = bool(data["stable"])
    gain, least = float(data["gain_margin"]), float(data["least_gain"])
    add("gain", "gain_margin", f"{gain:.3g} ({20 * np.log10(gain):.3g} dB)" if stable else "none")
    if least:
        table.add_row("least gain", f"{least:.3g} ({20 * np.log10(least):.3g} dB)", "")
    for name in ("phase", "delay"):
        value = float(data[f"{name}_margin"])
        unit = DEGREES if name == "phase" else _time_unit(value)
        add(name, f"{name}_margin", unit.text(value) if stable else "none")
    add("modulus", "modulus_margin", f"{float(data['modulus_margin']):.3g}")
    away = np.hypot(1 + data["locus_real"], data["locus_imaginary"])
    waters = dict.fromkeys(data["water"].values.tolist())
    for water in waters if len(waters) > 1 else ():
        least = float(away[:, data["water"].values == water].min())
        table.add_row(f"modulus, {water}", f"{least:.3g}", "")
    table.add_row("closed loop", "stable" if stable else f"unstable in {data.attrs['water']}", "")
    return table


def _time_unit(value: float) -> Unit:
    return si_unit(value if np.isfinite(value) else 1.0, "s")
