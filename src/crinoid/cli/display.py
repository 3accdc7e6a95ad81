"""What commands print: progress, notes, names of files, and tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich import box
from rich.progress import BarColumn, Progress, Task, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from crinoid.assembly.prepared import Prepared
from crinoid.cli.command import console
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.results.measure_labels import unit_of
from crinoid.results.metrics import MEASURES, Measure
from crinoid.results.result import Result
from crinoid.results.table import equilibrium_summary, summary
from crinoid.results.units import Unit, largest
from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.document import flat
from crinoid.view.figures.study import short_keys

if TYPE_CHECKING:
    from crinoid.simulation import Progress as Reached

_FEW = 3  # number of keys that a line names


class _TimeColumn(TimeRemainingColumn):
    """The time left, or the time so far where the end is not known."""

    max_refresh: Any = None  # each time

    def render(self, task: Task) -> Text:
        """Return it as text."""
        if task.total is None:
            return Text(f"{task.elapsed or 0.0:.0f} s so far")
        return super().render(task)


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Show a progress bar."""
    with Progress(
        TextColumn("{task.description:>14}"),
        BarColumn(),
        TextColumn("{task.fields[reached]}"),
        _TimeColumn(),
        console=console,
        transient=True,
    ) as bar:
        bar.add_task("compiling", total=None, reached="")
        yield bar


def reporter(bar: Progress, prefix: str) -> Callable[[Reached], None]:
    """Return the callback that moves the bar: simulated time, speed and time left."""
    task = bar.task_ids[0]
    label = ""

    def report(reached: Reached) -> None:
        nonlocal label
        if reached.label != label:
            label = reached.label
            bar.reset(task, total=reached.duration, description=f"{prefix}{label}")
        speed = reached.time / reached.elapsed
        text = f"{reached.time:.1f} of {reached.duration:g} s, {speed:.0f} x real time"
        bar.update(task, completed=reached.time, reached=text)

    return report


def say_notes(notes: Iterable[str]) -> None:
    """Print each note on one line, after the word note."""
    for note in notes:
        console.print(f"note: {note}", soft_wrap=True)


_FEW_SEEDS = 5  # seeds below which intervals are wide: half of one is 2.8 standard errors


def seed_notes(seeds: int) -> list[str]:
    """Return a note on 95 % intervals of so few seeds; none where there is no interval."""
    if not 1 < seeds < _FEW_SEEDS:
        return []
    return [f"95 % intervals of {seeds} seeds are wide. Use 10 or more."]


_ONSETS = ("flow", "load", "base", "target", "simulation")  # tables that decide when errors count
_AIMS = ("target", "control")  # tables that give the tip a target


def say_when(scenario: Scenario, varied: Iterable[str] = ()) -> None:
    """Print what errors count from: the start without a target, and a time after an onset."""
    varied = list(varied)
    if varied and not scenario.aims and not any(key.startswith(_AIMS) for key in varied):
        say_notes(["there is no target: errors are displacements from the start"])
    if scenario.judged_from > 0 and not any(key.startswith(_ONSETS) for key in varied):
        say_notes([f"errors count from {scenario.judged_from:g} s (target.judged_from)"])


def say_absent(scenario: Scenario) -> None:
    """Name flows and loads without effect at t = 0, and flows at a random instant."""
    for name in ("flow", "load"):
        for index, each in enumerate(getattr(scenario, name)):
            where = f"{name}.{index}"
            if late := [key for key in ("start", "ramp_time") if getattr(each, key) > 0]:
                settings = " ".join(f"--set {where}.{key}=0" for key in late)
                say_notes([f"{where} is 0 at t = 0, and has no effect here. Try {settings}"])
            elif name == "flow" and each.drawn:
                say_notes([f"{where} ({each.kind}) is at a random instant. It depends on seed"])


def say_written(paths: Iterable[Path]) -> None:
    """Print the names of files that were written."""
    for path in paths:
        console.print(f"wrote {path}", soft_wrap=True)


def show(
    table: Table, notes: Iterable[str], files: Iterable[Path], lines: Iterable[str] = ()
) -> None:
    """Print a table, lines below it, notes, and the names of files that were written."""
    console.print(table)
    for line in lines:
        console.print(line, soft_wrap=True)
    say_notes(notes)
    say_written(files)


def say_where(paths: Sequence[Path]) -> None:
    """Print where the results are; the first of them is in their folder."""
    say_written(paths)
    if paths:
        console.print(f"figures: crinoid report {paths[0].parent}", soft_wrap=True)


def say_doubts(prepared: Prepared, tables: Collection[str] = ()) -> list[str]:
    """Print the implausible values of a scenario before it is run; return them."""
    found = plausibility_warnings(prepared, tables)
    say_notes(found)
    return found


def listed(failures: Sequence[str], place: str) -> str:
    """Return the first failures, and how many more are in a file."""
    left = len(failures) - _MOST_FAILURES
    more = [f"{left} more {'is' if left == 1 else 'are'} in {place}"] if left > 0 else []
    return "; ".join([*failures[:_MOST_FAILURES], *more])


def new_table(
    title: str | None, heads: Iterable[str], rows: Iterable[Sequence[str]], **style: Any
) -> Table:
    """Return a table of names in the first column and numbers in the others."""
    table = Table(title=title, title_justify="left", **style)
    for index, head in enumerate(heads):
        table.add_column(head, justify="right" if index else "left")
    for row in rows:
        table.add_row(*row)
    return table


def statistics_table(
    title: str | None, heads: Sequence[str], columns: Sequence[Mapping[str, Any]]
) -> Table:
    """Return a table of statistics by name, a column for each place; ``heads`` may be none."""

    def text(values: Any) -> str:
        if np.isnan(values).all():
            return "not defined"
        numbers = (np.round(values, _DECIMALS) + 0.0).ravel().tolist()
        return ", ".join("-" if np.isnan(each) else _PLAIN.number(each) for each in numbers)

    rows = [(name, *(text(column[name]) for column in columns)) for name in columns[0]]
    return new_table(title, heads, rows, show_header=bool(heads))


_PLAIN = Unit(1.0, "")
_DECIMALS = 9  # of a statistic: less is round-off
_MOST_NOTES, _MOST_FAILURES = 6, 4
_NUMBER = re.compile(r"\d[\d.]*(?:e[+-]?\d+)?")


def words_of(note: str) -> str:
    """Return a note without its numbers."""
    return _NUMBER.sub("#", note)


def notes_of_cases(notes: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the notes of a study, given by case in order, each once with the cases that have it.

    Notes that differ in their numbers only are one; not all are returned where there are many.
    """
    alike: dict[tuple[str, int], list[tuple[int, str]]] = {}
    for number, each in enumerate(notes.values()):
        count = Counter[str]()  # two notes of one case stay two
        for note in each:
            words = words_of(note)
            alike.setdefault((words, count[words]), []).append((number, note))
            count[words] += 1
    names, found = list(notes), []
    for cases in alike.values():
        numbers = [number for number, _ in cases]
        where = _ranges(names, numbers)
        if len({note for _, note in cases}) > 1:
            where += f" (numbers are those of {names[numbers[0]]})"
        found.append(f"{where}: {cases[0][1]}")
    left = len(found) - _MOST_NOTES
    return found if left <= 0 else [*found[:_MOST_NOTES], f"{left} more in the cases' results"]


def _ranges(names: list[str], numbers: list[int]) -> str:
    """Return names of cases; of more than two that follow each other the first and the last."""
    parts: list[str] = []
    # numbers that follow each other lead their places in the list by the same amount
    for _, group in groupby(enumerate(numbers), lambda each: each[1] - each[0]):
        run = [number for _, number in group]
        if len(run) > 2:
            parts.append(f"{names[run[0]]} to {names[run[-1]]}")
        else:
            parts += [names[number] for number in run]
    return ", ".join(parts)


_VARIED_WIDTH = 23  # characters for the varied keys, so that measures fit into 80 columns


def run_table(result: Result, *, full: bool = False) -> Table:
    """Return the summary of a run, and of the one without control if there is one."""
    found = summary(result, full=full)
    return new_table(result.dataset.attrs["title"], found.heads, found.rows)


def equilibrium_table(result: Result) -> Table:
    """Return the summary of an equilibrium."""
    title, rows = result.dataset.attrs["title"], equilibrium_summary(result).rows
    return new_table(title, (), rows, show_header=False)


def cases_table(
    title: str, keys: list[str], rows: list[dict[str, Any]], registry: Mapping[str, Measure]
) -> Table:
    """Return the cases of a study, with the main measures and those of packages."""
    table = Table(title=title, title_justify="left", box=box.SIMPLE, pad_edge=False)
    table.add_column("case", no_wrap=True)
    names = short_keys(keys)
    values = [[_value(row[key]) for key in names] for row in rows]
    wide = [
        max(len(text) for text in (*_folded(short).split("\n"), *column))
        for short, column in zip(names.values(), zip(*values, strict=True), strict=True)
    ]
    in_columns = sum(wide) + 3 * (len(wide) - 1) <= _VARIED_WIDTH
    if in_columns:
        for short in names.values():
            table.add_column(_folded(short), justify="right", no_wrap=True)
    else:  # one below the other in each case
        table.add_column("varied", max_width=_VARIED_WIDTH, overflow="fold")
    units = {}
    heads = {"steady_error": "steady\nerror", "rms_error": "RMS\nerror"}
    if any(row["rms_error_uncontrolled"] != "" for row in rows):
        heads |= {"deflection": "steady,\nfree", "rms_error_uncontrolled": "RMS,\nfree"}
    heads |= {name: _folded(name) for name in registry if name not in MEASURES}
    for name, heading in heads.items():
        known = [row[name] for row in rows if row[name] != ""]
        size = largest(np.array(known, dtype=float))
        unit = units[name] = unit_of(registry[name].attributes, size)
        head = f"{heading}\n({unit.name})" if unit.name else heading
        table.add_column(head, justify="right", no_wrap=True)
    steps = any(row[name] != "" for row in rows for name in ("rise_time", "settling_time"))
    if steps:
        table.add_column("settled\n(s)", justify="right", no_wrap=True)
    for row, varied in zip(rows, values, strict=True):
        if not in_columns:
            below = zip(names.values(), varied, strict=True)
            varied = ["\n".join(_folded(short, _VARIED_WIDTH, text) for short, text in below)]
        settled, not_yet = row["settling_time"], "not" * (row["rise_time"] != "")
        table.add_row(
            row["case"].removeprefix("case-"),
            *varied,
            *("" if row[name] == "" else unit.number(row[name]) for name, unit in units.items()),
            *([not_yet if settled == "" else f"{settled:.2f}"] if steps else []),
        )
    return table


def _folded(key: str, width: int = 9, value: str = "") -> str:
    """Return a key, and a value behind it, on lines that end at the key's dots and underscores."""
    lines = [""]
    pieces = key.replace(".", ".\0").replace("_", "_\0").split("\0")
    for piece in [*pieces, *([f" {value}"] if value else [])]:
        if lines[-1] and len(lines[-1]) + len(piece) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(lines)


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(item) for item in value)}]"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def difference(found: Mapping[str, object], scenario: Scenario) -> str:
    """Return the first keys that differ from those of a result, in brackets."""
    try:
        old = dict(flat(Scenario.from_toml(str(found.get("scenario"))).to_dict()))
    except ScenarioError:  # of another version
        return ""
    new = dict(flat(scenario.to_dict()))
    keys = [key for key in dict.fromkeys([*new, *old]) if new.get(key) != old.get(key)]
    more = f" and {len(keys) - _FEW} more" if len(keys) > _FEW else ""
    return f" ({', '.join(keys[:_FEW])}{more} differ{'s' * (len(keys) == 1)})" if keys else ""
