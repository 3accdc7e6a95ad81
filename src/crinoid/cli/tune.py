"""Tuning of a controller: a search, and its table of margins and errors."""

from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from crinoid.cli.optimise import More, search_and_save
from crinoid.inverse import TUNING
from crinoid.inverse.tuning import MARGINS, Tuning, tunable_numbers
from crinoid.results.units import DEGREES, length_text, si_unit
from crinoid.scenario import ScenarioText

_LITTLE = 0.9  # tip error over that without control above which a tuning deserves a note


def tune_controller(
    text: ScenarioText, seeds: int, iterations: int, margin: float, folder: Path, *, force: bool
) -> tuple[str, int]:
    """Search, save and draw what was found, and sum it up; return what went wrong, and the code."""
    tunable_numbers(text.scenario)
    search = partial(Tuning, text.scenario, seeds, iterations, margin)
    path, beyond = folder / TUNING, "Continue from tuned.toml"
    return search_and_save(text, path, "a tuning", "tune", beyond, search, _more, force=force)


def _more(search: Tuning, data: xr.Dataset) -> More:
    """Return rows of margins and of held-out draws, before and after, and notes."""
    rows: list[tuple[str, ...]] = []
    if search.margin is not None:
        for name in MARGINS:
            pair = (float(data[f"{when}_{name}_margin"]) for when in ("before", "after"))
            rows.append((f"{name} margin", *(_margin(name, each) for each in pair)))
        rows.append(("weakest in", data.attrs["before_water"], data.attrs["after_water"]))
    if search.held_out is not None:
        words = "other draws" if search.random else "the run"
        for number, name in enumerate(("control cost", "RMS tip error")):
            means = np.sqrt((search.held_out[:, number] ** 2).mean(axis=1))
            rows.append((f"{name}, {words}", *map(length_text, means)))
    return rows, _notes(search)


def _margin(name: str, value: float) -> str:
    if np.isnan(value):
        return "unstable"
    unit = {"phase": DEGREES, "delay": si_unit(value if np.isfinite(value) else 1.0, "s")}.get(name)
    return f"{value:.3g}" if unit is None else unit.text(value)


def _notes(search: Tuning) -> list[str]:
    notes = []
    if not search.random:
        notes.append("nothing in this scenario is random: all seeds give the same run")
    if search.held_out is None:
        return notes
    (before, after, _), (_, error, free) = (x.mean(axis=1) for x in search.held_out.swapaxes(0, 1))
    if after > before:
        if search.given is not None and search.goal.violation(search.given) > 0:
            notes.append("the tuned controller costs more, because the given one lacks the margin")
        elif search.random:
            notes.append("the tuned controller costs more in other draws: use more --seeds")
    if error > _LITTLE * free:
        other = 'control.kind = "lqg"' if search.scenario.control.gains else "another kind"
        notes.append(
            "the tuned controller hardly holds the tip better than none. Run tuned.toml and read "
            f"its notes, drive other inputs, or try {other}."
        )
    return notes
