"""Comma-separated values of a run over time."""

import csv
from collections.abc import Collection, Iterator, Sequence
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
import xarray as xr

from crinoid.foundation.result_variables import LARGE
from crinoid.results.chunks import chosen_pieces
from crinoid.results.own_files import TIME, table_head
from crinoid.scenario.errors import Mistake, ScenarioError, got, shown
from crinoid.view.export.source import Files, Report, Table


class VariablePart(NamedTuple):
    """Part of a variable: one index along some of its dimensions."""

    labels: tuple[str, ...]
    """Labels of these indices: ``slide``, ``kinetic``, ``x``; by number ``node3``."""
    unit: str  # unit in the form of CF; empty where the result has none
    place: tuple[tuple[str, int], ...]  # dimensions and their indices

    def head(self, name: str) -> str:
        """Return the head of its column in a table."""
        whole = ".".join((name, *self.labels))
        return f"{whole} ({self.unit})" if self.unit else whole

    def of(self, variable: xr.DataArray) -> xr.DataArray:
        """Return this part of a variable."""
        return variable.isel(dict(self.place), drop=True)


Columns = Sequence[tuple[str, VariablePart]]


def variables_of(data: xr.Dataset, wanted: Sequence[str] | None) -> list[str]:
    """Return the requested variables, or all over time that are not along the arm."""
    over_time = {
        str(name): variable
        for name, variable in data.data_vars.items()
        if variable.dims[:1] == ("time",) and variable.dtype.kind in "fi"
    }
    if wanted is None:
        return [name for name, each in over_time.items() if not LARGE & {*each.dims}]
    for name in wanted:
        if name not in over_time:
            text = got(name, "be a variable of the result over time")
            near = get_close_matches(name.lower(), over_time, n=1)
            raise ScenarioError([Mistake("--variables", text, *near)])
        if list(wanted).count(name) > 1:
            raise ScenarioError([Mistake("--variables", f"got {shown(name)} twice")])
    return list(wanted)


def columns_of(source: Table) -> Columns:
    """Return the columns of a table: variables, and parts of them at nodes or edges by number.

    Negative numbers count from the tip.
    """
    data, nodes, found = source.data, source.nodes, []
    names = variables_of(data, source.variables)
    for name in names:
        along = next((str(dim) for dim in data[name].dims if dim in LARGE), None)
        taken = None if along is None or nodes is None else _places(along, data.sizes[along], nodes)
        for part in parts_of(data[name].isel(time=0), ()):
            if taken is None or dict(part.place)[str(along)] in taken:
                found.append((name, part))
    if nodes is not None and not any(LARGE & {*data[name].dims} for name in names):
        text = "no variable along the arm is written. Name one in --variables."
        raise ScenarioError([Mistake("--nodes", text)])
    return found


def _places(along: str, count: int, nodes: Sequence[int]) -> set[int]:
    for node in nodes:
        if not -count <= node < count:
            must = f"be 0 to {count - 1}, or -{count} to -1 counted from the tip ({along}s)"
            raise ScenarioError([Mistake("--nodes", got(node, must))])
    return {node % count for node in nodes}


def write_csv(source: Table, files: Files, report: Report) -> list[str]:
    """Write a table with a row for each instant; return notes on numbers that are not finite."""
    columns, empty = columns_of(source), 0
    with files[0].open("w", newline="", encoding="utf-8") as file:
        file.write(table_head([TIME, *(part.head(name) for name, part in columns)]))
        writer = csv.writer(file)
        for row in rows_of(source, columns, report):
            empty += row.count(None)
            writer.writerow(row)
    return note_on_empty(empty)


def rows_of(source: Table, columns: Columns, report: Report) -> Iterator[list[float | None]]:
    """Yield the time and the columns at each instant; None for a number that is not finite."""
    names = list(dict.fromkeys(name for name, _ in columns))
    written = 0
    for piece in chosen_pieces(source.data, names, source.records):
        table = [piece["time"].values, *(part.of(piece[name]).values for name, part in columns)]
        rows = np.stack([np.asarray(column, float) for column in table], axis=1)
        cells: list[list[float | None]] = rows.tolist()
        for row, column in np.argwhere(~np.isfinite(rows)):
            cells[row][column] = None
        yield from cells
        written += piece.sizes["time"]
        report(written, source.records.size)


def note_on_empty(empty: int) -> list[str]:
    """Return a note on a number of empty cells, if there are any."""
    if not empty:
        return []
    return [f"{empty} {'cell is' if empty == 1 else 'cells are'} empty: without a finite number"]


def parts_of(variable: xr.DataArray, kept: Collection[str]) -> Iterator[VariablePart]:
    """Yield the parts of a variable, whole along some dimensions."""
    dims = [str(dim) for dim in variable.dims if dim not in kept]
    for places in np.ndindex(*(variable.sizes[dim] for dim in dims)):
        place = tuple(zip(dims, places, strict=True))
        coords, labels, units = variable.coords, [], [str(variable.attrs.get("units", ""))]
        for dim, number in place:
            labels.append(str(coords[dim].values[number]) if dim in coords else f"{dim}{number}")
            if f"{dim}_unit" in coords and not units[0]:  # parts have different units
                units.append(str(coords[f"{dim}_unit"].values[number]))
        yield VariablePart(tuple(labels), "".join(units), place)
