"""Estimate from a log: the file with its figure, and a table of its consistency."""

from pathlib import Path

import numpy as np
import xarray as xr
from rich.table import Table

from crinoid.cli.display import new_table
from crinoid.cli.finding import finding
from crinoid.inverse import ESTIMATE
from crinoid.inverse.estimation import estimated
from crinoid.results.units import DEGREES, length_unit, si_unit
from crinoid.scenario import Scenario

_FAR = 2.0  # mean square of innovations beyond which the observer does not fit the log


def estimate_states(scenario: Scenario, record: Path, folder: Path, *, force: bool) -> None:
    """Run the observer over a log, save and draw the estimate, and sum it up."""
    with finding(scenario, folder / ESTIMATE, "an estimate", force=force) as found:
        data = estimated(found.prepared, record)
        found.show(data, consistency_table(data), notes=_notes(data))


def consistency_table(data: xr.Dataset) -> Table:
    """Return the standard deviations, their mean over time, and the consistency."""
    rows = []
    for name, unit in (("tip_position", "m"), ("tip_angle", "rad"), ("flow_velocity", "m/s")):
        std = data.get(f"estimated_{name}_std")
        if std is None:
            continue
        words = name.replace("_", " ")
        for axis in map(str, data["axis"].values) if "axis" in std.dims else [""]:
            part = std.sel(axis=axis).values if axis else std.values
            size = float(np.mean(part))
            scale = {"m": length_unit(size), "rad": DEGREES}.get(unit, si_unit(size, unit))
            rows.append((f"standard deviation, {words} {axis}".strip(), scale.text(size), ""))
    attributes = data.attrs
    low, high = attributes["mean_square_low"], attributes["mean_square_high"]
    square = f"{attributes['mean_square']:.3g}"
    rows += [
        ("readings", str(attributes["readings_used"]), ""),
        ("mean normalised innovation squared", square, f"{low:.3f} to {high:.3f}"),
        ("innovations within 2 std", f"{100 * attributes['within_two_std']:.1f} %", "95.4 %"),
    ]
    return new_table(attributes["title"], ("", "found", "if the model is right"), rows)


def _notes(data: xr.Dataset) -> list[str]:
    square = data.attrs["mean_square"]
    if square < data.attrs["mean_square_low"]:
        return ["innovations are smaller than the observer expects: its bands are wide"]
    if square > _FAR:
        return [
            "innovations are larger than the observer expects: its bands are narrow. Check the "
            "noise and delay of the sensors, the flows and the numbers of the arm."
        ]
    return []
