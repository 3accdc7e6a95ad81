"""Finding the margins of a scenario's control loop: a file, figures and a table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

from crinoid.assembly.prepared import Prepared
from crinoid.cli.folder import check_own, claimed
from crinoid.cli.notes import say_doubts, say_notes
from crinoid.programs import keep_programs
from crinoid.replacement import replacing
from crinoid.report import write_report
from crinoid.report.units import DEGREES, Unit, si_unit
from crinoid.scenario import Mistake, Scenario, ScenarioError
from crinoid.simulation.margins import MARGINS, find_margins


def show_margins(scenario: Scenario, folder: Path, *, force: bool, console: Console) -> None:
    """Find the margins of a scenario's loop, save, draw and show them.

    Raises
    ------
    ScenarioError
        If a file that the scenario names is not what it takes, or there is no loop.
    """
    if scenario.vary:
        text = "margins are those of one case; give its values with --set and leave out vary"
        raise ScenarioError([Mistake("vary", text)])
    keep_programs()
    prepared = Prepared(scenario)
    prepared.check()
    path = folder / MARGINS
    with claimed(folder):
        if not force:
            check_own(path)
        say_doubts(console, prepared)
        with console.status("linearising the loop"):
            dataset = find_margins(prepared)
        with replacing(path) as temporary:
            dataset.to_netcdf(temporary, engine="netcdf4")
        figures = write_report(path)
    console.print(margins_table(dataset))
    say_notes(console, dataset.attrs["notes"].splitlines())
    for each in (path, *figures):
        console.print(f"wrote {each}", soft_wrap=True)


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
    table.add_row("closed loop", "stable" if stable else "unstable", "")
    return table


def _time_unit(value: float) -> Unit:
    return si_unit(value if np.isfinite(value) else 1.0, "s")
