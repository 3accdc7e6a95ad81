"""Means over the seeds of a study: their tables, and their file."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from rich import box
from rich.table import Table

from crinoid.cli.display import new_table, seed_notes
from crinoid.cli.folder import clear_own
from crinoid.results.measure_labels import (
    head_of,
    main_measures,
    plain_number,
    unit_of,
)
from crinoid.results.metrics import MEASURES, Measure, write_rows
from crinoid.results.units import Unit, largest
from crinoid.scenario import counted
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.scenario import scenario_schema
from crinoid.studies.statistics import MEANS, RUNS, SeedMean, mean_row, seed_means
from crinoid.view.figures import write_means
from crinoid.view.figures.study import short_keys

_MOST_ROWS, _MOST_ACROSS = 24, 8
_FEW, _FEW_EXTREMES = 3, 2
"""Measures of a table of means, without those of packages, and of a table of extremes."""


class SeedTables:
    """Means over the seeds of a study, for each combination of the other keys."""

    def __init__(
        self,
        varied: Sequence[Mapping[str, Any]],
        numbers: Mapping[str, Float[np.ndarray, " run"]],
        registry: Mapping[str, Measure],
    ) -> None:
        self.registry = registry
        self.means = seed_means(varied, numbers)

    def write(self, folder: Path) -> list[Path]:
        """Write all means to ``means.csv``, and a figure; remove earlier ones without any.

        The figure is drawn from ``cases.csv``.
        """
        path = folder / MEANS
        if not self.means:
            clear_own(folder, [MEANS])
            return []
        write_rows(path, (mean_row(each, self.registry[each.name]) for each in self.means))
        return [path, *write_means(folder)]

    def tables(self) -> Iterator[Table]:
        """Yield tables for a terminal: of two keys a grid, else a row for each combination."""
        if not self.means:
            return
        keys = list(self.means[0].values)
        names = main_measures(dict.fromkeys(each.name for each in self.means))
        shown = [*names[:_FEW], *(name for name in names[_FEW:] if name not in MEASURES)]
        if len(keys) == 2 and self._is_grid(keys):
            for name in [shown[0], *(name for name in shown[1:] if name not in MEASURES)]:
                yield self._grid(name, keys)
        else:
            yield self._list(shown, keys)
        if any(each.extreme for each in self.means):
            yield self._extremes(keys)

    @property
    def notes(self) -> list[str]:
        """Notes on the intervals, where runs differ by their seeds."""
        if not any(each.mean.half > 0 for each in self.means):
            return []
        finished: dict[str, int] = {}  # a measure may be unknown in runs that finished
        for each in self.means:
            group = str(each.values)
            finished[group] = max(finished.get(group, 0), each.mean.seeds)
        return seed_notes(min(finished.values()))

    def _of(self, name: str) -> tuple[list[SeedMean], Unit]:
        found = [each for each in self.means if each.name == name]
        size = largest(np.array([each.mean.value for each in found]))
        return found, unit_of(self.registry[name].attributes, size)

    def _levels(self, key: str) -> list[str]:
        return list(dict.fromkeys(_words(each.values[key]) for each in self.means))

    def _is_grid(self, keys: list[str]) -> bool:
        """Return whether two keys have all combinations of their values, few of the second."""
        down, across = (len(self._levels(key)) for key in keys)
        names = {each.name for each in self.means}
        return across <= _MOST_ACROSS and len(self.means) == len(names) * down * across

    def _grid(self, name: str, keys: list[str]) -> Table:
        found, unit = self._of(name)
        cells = {tuple(map(_words, each.values.values())): each.mean.text(unit) for each in found}
        down, across = keys
        levels = {key: self._levels(key) for key in keys}
        rows = [[one, *(cells[one, other] for other in levels[across])] for one in levels[down]]
        title = f"{head_of(name, unit)}{_over_seeds(found)}"
        heads = [" | ".join(_key_heads(keys)), *levels[across]]
        return new_table(title, heads, rows, box=box.SIMPLE, pad_edge=False)

    def _list(self, names: list[str], keys: list[str]) -> Table:
        columns = [self._of(name) for name in names]
        rows = [
            [
                *map(_words, row[0].values.values()),
                *(each.mean.text(unit) for each, (_, unit) in zip(row, columns, strict=True)),
            ]
            for row in zip(*(found for found, _ in columns), strict=True)
        ]
        heads = _key_heads(keys) + [
            head_of(name, unit) for name, (_, unit) in zip(names, columns, strict=True)
        ]
        return _cut(f"Measures{_over_seeds(columns[0][0])}", heads, rows)

    def _extremes(self, keys: list[str]) -> Table:
        names = list(dict.fromkeys(each.name for each in self.means if each.extreme))
        shown = main_measures(names)[:_FEW_EXTREMES]
        rows = []
        groups = groupby(self.means, key=lambda each: each.values)
        units = {name: self._of(name)[1] for name in shown}
        for values, group in groups:
            extremes = {each.name: each.extreme for each in group if each.name in shown}
            cells = ((units[name], extremes[name]) for name in shown)
            texts = [
                f"{u.number(e.value)} [{u.number(e.low)}, {u.number(e.high)}]" if e else "-"
                for u, e in cells
            ]
            rows.append([*map(_words, values.values()), *texts])
        heads = [*_key_heads(keys), *(head_of(name, units[name]) for name in shown)]
        return _cut(f"Exceeded by one run in {RUNS}: Gumbel fit and 95 % interval", heads, rows)


def _key_heads(keys: list[str]) -> list[str]:
    units = (unit_at(scenario_schema(), key) for key in keys)
    named = zip(short_keys(keys).values(), units, strict=True)
    return [f"{short} ({unit})" if unit else short for short, unit in named]


def _cut(title: str, heads: list[str], rows: list[list[str]]) -> Table:
    table = new_table(title, heads, rows[:_MOST_ROWS], box=box.SIMPLE, pad_edge=False)
    if len(rows) > _MOST_ROWS:
        table.caption = f"{len(rows) - _MOST_ROWS} more rows are in {MEANS}"
    return table


def _over_seeds(found: Sequence[SeedMean]) -> str:
    counts = [each.mean.seeds for each in found]
    least, most = min(counts), max(counts)
    seeds = counted(most, "seed") if least == most else f"{least} to {most} seeds"
    return f", mean and 95 % interval over {seeds}" if most > 1 else ""


def _words(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_words, value))}]"
    return plain_number(value) if isinstance(value, float) else str(value)
