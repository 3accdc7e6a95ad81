"""Workbook of a run: its measures, its variables over time, and their meanings."""

import math
from collections.abc import Iterable
from itertools import chain

import xlsxwriter

from crinoid.results.own_files import PRODUCER, TIME
from crinoid.results.summary import summarised
from crinoid.scenario.errors import got, refusal
from crinoid.view.export.source import Files, Report, Table
from crinoid.view.export.table import columns_of, note_on_empty, rows_of

_MOST_COLUMNS = 16_384
"""Columns of a sheet of Excel."""

Row = Iterable[str | float | None]


def write_xlsx(source: Table, files: Files, report: Report) -> list[str]:
    """Write the sheets of a run: measures, the table of `write_csv`, and its variables.

    Returns notes on numbers that are not finite.
    """
    columns = columns_of(source)
    if len(columns) >= _MOST_COLUMNS:
        must = f"be fewer than {_MOST_COLUMNS} columns"
        raise refusal("--variables", got(len(columns), must, "Name fewer variables or --nodes."))
    empty = 0

    def counted() -> Iterable[Row]:
        nonlocal empty
        for row in rows_of(source, columns, report):
            empty += row.count(None)
            yield row

    measures = [
        (name, value, each.unit, each.meaning)
        for name, each in summarised(source.result).items()
        if (value := each.value) is not None
    ]
    about = [(name, str(text)) for name, text in source.attributes.items()]
    named = {name: source.data[name].attrs for name, _ in columns}
    meanings = [(k, a.get("units", ""), a.get("long_name", "")) for k, a in named.items()]
    with xlsxwriter.Workbook(files[0], {"constant_memory": True}) as book:
        book.set_properties({"author": PRODUCER})
        _write(book, "summary", ("measure", "value", "unit", "meaning"), [*measures, (), *about])
        heads = (TIME, *(part.head(name) for name, part in columns))
        _write(book, "time series", heads, counted())
        _write(book, "variables", ("variable", "unit", "meaning"), meanings)
    return note_on_empty(empty)


def _write(book: xlsxwriter.Workbook, name: str, head: Row, rows: Iterable[Row]) -> None:
    sheet, bold = book.add_worksheet(name), book.add_format({"bold": True})
    sheet.freeze_panes(1, 1)
    sheet.set_column(0, 3, 24)
    for number, row in enumerate(chain([head], rows)):
        for place, cell in enumerate(row):
            if isinstance(cell, str):
                sheet.write_string(number, place, cell, None if number else bold)
            elif cell is not None and math.isfinite(cell):
                sheet.write_number(number, place, cell)
