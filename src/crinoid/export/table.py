"""A table of a run over time, as comma-separated values."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from pathlib import Path

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.export.files import TIME, head_of
from crinoid.export.parts import Part, parts_of
from crinoid.export.source import Source
from crinoid.pieces import chosen_pieces
from crinoid.scenario.errors import Mistake, ScenarioError, shown
from crinoid.variables import LARGE


def variables_of(data: xr.Dataset, wanted: Sequence[str] | None) -> list[str]:
    """Return the variables of a table: those that are wanted, or all that are not along the arm.

    Raises
    ------
    ScenarioError
        If one is unknown, not over time, or named twice.
    """
    over_time = {
        str(name): variable
        for name, variable in data.data_vars.items()
        if variable.dims[:1] == ("time",) and variable.dtype.kind in "fi"
    }
    if wanted is None:
        return [name for name, each in over_time.items() if not LARGE & {*each.dims}]
    for name in wanted:
        if name not in over_time:
            takes = "takes variables of the result over time, with commas between them"
            if name in data.variables:
                takes = f"which is not over time; {takes}"
            near = get_close_matches(name.lower(), over_time, n=1)
            mistake = Mistake("--variables", f"got {shown(name)}, {takes}", *near)
            raise ScenarioError([mistake])
        if list(wanted).count(name) > 1:
            raise ScenarioError([Mistake("--variables", f"got {shown(name)} twice")])
    return list(wanted)


def columns_of(
    data: xr.Dataset, names: Sequence[str], nodes: Sequence[int] | None
) -> list[tuple[str, Part]]:
    """Return the columns of a table: a variable, and a part of it.

    Parameters
    ----------
    data, names
        The result, and variables of it.
    nodes
        Numbers of the nodes, or of the edges, to take of what is along the arm; negative ones
        count from the tip.

    Raises
    ------
    ScenarioError
        If there is no such node, or nothing along the arm to take it of.
    """
    found = []
    for name in names:
        along = next((str(dim) for dim in data[name].dims if dim in LARGE), None)
        taken = None if along is None else _places(along, data.sizes[along], nodes)
        for part in parts_of(data[name].isel(time=0), ()):
            if taken is None or dict(part.place)[str(along)] in taken:
                found.append((name, part))
    if nodes is not None and not any(LARGE & {*data[name].dims} for name in names):
        text = "no variable that is along the arm is written: takes one in --variables"
        raise ScenarioError([Mistake("--nodes", text)])
    return found


def _places(along: str, count: int, nodes: Sequence[int] | None) -> set[int]:
    if nodes is None:
        return set(range(count))
    for node in nodes:
        if not -count <= node < count:
            text = f"got {node}, takes numbers of {along}s from 0 to {count - 1}, or from -{count}"
            raise ScenarioError([Mistake("--nodes", f"{text} to -1 counted from the tip")])
    return {node % count for node in nodes}


def write_table(
    source: Source,
    columns: Sequence[tuple[str, Part]],
    path: Path,
    report: Callable[[int], None],
) -> list[str]:
    """Write a table with a row for each instant; numbers that are not finite leave a cell empty.

    Returns
    -------
    list of str
        Sentences on cells that are empty.
    """
    names = list(dict.fromkeys(name for name, _ in columns))
    written = empty = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(head_of([TIME, *(_head(name, part) for name, part in columns)]))
        writer = csv.writer(file)
        for piece in chosen_pieces(source.data, names, source.records):
            table = [piece["time"].values, *(part.of(piece[name]).values for name, part in columns)]
            rows = np.stack([np.asarray(column, float) for column in table], axis=1)
            empty += int(np.sum(~np.isfinite(rows)))
            writer.writerows(_cells(rows))
            written += piece.sizes["time"]
            report(written)
    if not empty:
        return []
    return [f"{empty} {'cell is' if empty == 1 else 'cells are'} empty: no finite number is there"]


def _head(name: str, part: Part) -> str:
    whole = ".".join((name, *part.labels))
    return f"{whole} ({part.unit})" if part.unit else whole


def _cells(rows: Float[np.ndarray, "row column"]) -> list[list[float | str]]:
    """Return what is to be written: all digits of a number, nothing of one that is not finite."""
    cells: list[list[float | str]] = rows.tolist()
    for row, column in np.argwhere(~np.isfinite(rows)):
        cells[row][column] = ""
    return cells
