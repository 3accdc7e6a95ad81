"""Means over the seeds of a study: their tables, and their file."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from rich import box
from rich.table import Table

from crinoid.cli.command import console
from crinoid.cli.display import new_table, say_notes, say_when, seed_notes
from crinoid.cli.finding import page_in
from crinoid.cli.folder import clear_own
from crinoid.foundation.representation import with_units
from crinoid.results.measure_labels import head_of, main_measures, plain_number, unit_of
from crinoid.results.metrics import MEASURES, measures_of, write_rows
from crinoid.results.units import Unit, largest
from crinoid.scenario import counted
from crinoid.scenario.kinds import unit_at
from crinoid.scenario.scenario import scenario_schema
from crinoid.studies.design import Design
from crinoid.studies.statistics import MEAN_COLUMNS, MEANS, RUNS, Means, records, seed_means
from crinoid.view.figures import write_means
from crinoid.view.figures.study import short_keys

_MOST_ROWS, _MOST_ACROSS = 24, 8
_FEW, _FEW_EXTREMES = 3, 2
"""Measures of a table of means, without those of packages, and of a table of extremes."""


class SeedTables:
    """Tables of the means over the seeds of a study: of measures of some of its runs."""

    def __init__(
        self, plan: Design, runs: Sequence[int], numbers: Mapping[str, Float[np.ndarray, " run"]]
    ) -> None:
        self.plan, self.registry = plan, measures_of(plan.scenario)
        self.means = seed_means(map(plan.values, runs), numbers, self.registry)
        columns = [] if self.means.empty else list(self.means.columns)
        self.keys: list[str] = columns[: -len(MEAN_COLUMNS)]

    def show(self, tables: Iterable[Table], folder: Path, notes: Iterable[str] = ()) -> list[Path]:
        """Print tables of a study, means and notes; write means, their figure and the page.

        The figure is drawn from ``cases.csv``. Earlier means are removed if there are none.
        """
        for each in (*tables, *self._tables()):
            console.print(each)
        say_when(self.plan.scenario, self.plan.keys)
        written = []
        if self.means.empty:
            clear_own(folder, [MEANS])
        else:
            write_rows(folder / MEANS, records(self.means))
            written = [folder / MEANS, *write_means(folder)]
        pages, lacking = page_in(folder)
        say_notes([*self._notes(), *notes, *lacking])
        return written + pages

    def _tables(self) -> Iterator[Table]:
        """Yield tables: of two keys a grid, else a row for each combination."""
        if self.means.empty:
            return
        names = main_measures(self.means["measure"].unique())
        shown = [*names[:_FEW], *(name for name in names[_FEW:] if name not in MEASURES)]
        if len(self.keys) == 2 and self._is_grid():
            for name in [shown[0], *(name for name in shown[1:] if name not in MEASURES)]:
                yield self._grid(name)
        else:
            title = f"Measures{_over_seeds(self._of(shown[0])[0])}"
            yield self._cut(title, shown, [self._texts(name) for name in shown])
        if self.means["extreme"].notna().any():
            yield self._extremes()

    def _notes(self) -> list[str]:
        """Return notes on the intervals, where runs differ by their seeds."""
        if self.means.empty or not (self.means["high"] > self.means["low"]).any():
            return []
        # a measure may be unknown in runs that finished
        return seed_notes(int(self.means["runs"].groupby(level=0).max().min()))

    def _of(self, name: str) -> tuple[pd.DataFrame, Unit]:
        found = self.means[self.means["measure"] == name]
        return found, unit_of(self.registry[name].attributes, largest(found["mean"].to_numpy()))

    def _texts(self, name: str) -> list[str]:
        found, unit = self._of(name)
        columns = (found[each].to_numpy() for each in ("mean", "low", "high", "runs"))
        return Means(*columns).texts(unit)

    def _values(self, key: str) -> list[str]:
        """Return the words of a key in each combination."""
        return self.means.loc[~self.means.index.duplicated(), key].map(_words).tolist()

    def _is_grid(self) -> bool:
        """Return whether two keys have all combinations of their values, few of the second."""
        down, across = (len(set(self._values(key))) for key in self.keys)
        return across <= _MOST_ACROSS and len(self._values(self.keys[0])) == down * across

    def _grid(self, name: str) -> Table:
        down, across = (self._values(key) for key in self.keys)
        cells = dict(zip(zip(down, across, strict=True), self._texts(name), strict=True))
        heads = list(dict.fromkeys(across))
        rows = [[one, *(cells[one, other] for other in heads)] for one in dict.fromkeys(down)]
        found, unit = self._of(name)
        title = f"{head_of(name, unit)}{_over_seeds(found)}"
        heads = [" | ".join(_key_heads(self.keys)), *heads]
        return new_table(title, heads, rows, box=box.SIMPLE, pad_edge=False)

    def _extremes(self) -> Table:
        known = self.means[self.means["extreme"].notna()]
        shown = main_measures(known["measure"].unique())[:_FEW_EXTREMES]
        texts = []
        for name in shown:
            found, unit = self._of(name)
            ends = found[["extreme", "extreme_low", "extreme_high"]].to_numpy()
            numbers = ([*map(unit.number, row)] for row in ends)
            cells = zip(found["extreme"].notna(), numbers, strict=True)
            texts.append([f"{v} [{low}, {high}]" if ok else "-" for ok, (v, low, high) in cells])
        title = f"Exceeded by one run in {RUNS}: Gumbel fit and 95 % interval"
        return self._cut(title, shown, texts)

    def _cut(self, title: str, names: list[str], texts: list[list[str]]) -> Table:
        """Return a table with a row for each combination, or for the first of many."""
        heads = [*_key_heads(self.keys), *(head_of(name, self._of(name)[1]) for name in names)]
        rows = list(zip(*map(self._values, self.keys), *texts, strict=True))
        table = new_table(title, heads, rows[:_MOST_ROWS], box=box.SIMPLE, pad_edge=False)
        if len(rows) > _MOST_ROWS:
            table.caption = f"{len(rows) - _MOST_ROWS} more rows are in {MEANS}"
        return table


def _key_heads(keys: list[str]) -> list[str]:
    units = [unit_at(scenario_schema(), key) for key in keys]
    return with_units(short_keys(keys).values(), units)


def _over_seeds(found: pd.DataFrame) -> str:
    least, most = int(found["runs"].min()), int(found["runs"].max())
    seeds = counted(most, "seed") if least == most else f"{least} to {most} seeds"
    return f", mean and 95 % interval over {seeds}" if most > 1 else ""


def _words(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_words, value))}]"
    return plain_number(value) if isinstance(value, float) else str(value)
