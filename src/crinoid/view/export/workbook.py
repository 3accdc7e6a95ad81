"""Workbook of a run: its measures, its variables over time, and their meanings."""

import math
import re
from collections.abc import Iterable, Sequence
from itertools import chain

import xlsxwriter

from crinoid.results.own_files import PRODUCER, TIME
from crinoid.results.summary import summarised
from crinoid.scenario.errors import got, refusal
from crinoid.view.export.source import Files, Report, Table
from crinoid.view.export.table import columns_of, note_on_empty, rows_of

_MOST_COLUMNS = 16_384  # columns of a sheet of Excel
_WIDTH = 14  # least width of a column, in characters

Row = Iterable[str | float | None]


def write_xlsx(source: Table, files: Files, report: Report) -> list[str]:
    """Write measures, the table of `write_csv`, its chart and its variables, angles in degrees."""
    columns = columns_of(source)
    if len(columns) >= _MOST_COLUMNS:
        must = f"be fewer than {_MOST_COLUMNS} columns"
        raise refusal("--variables", got(len(columns), must, "Name fewer variables or --nodes."))
    empty = 0

    def counted() -> Iterable[Row]:
        nonlocal empty
        for row in rows_of(source, columns, report):
            empty += row.count(None)
            sizes = zip(row, factors, strict=True)
            yield [None if cell is None else cell * factor for cell, factor in sizes]

    factors = [1.0, *(_in_degrees(part.unit)[0] for _, part in columns)]
    measures = []
    for name, each in summarised(source.result).items():
        factor, unit = _in_degrees(each.unit)
        if each.value is not None:
            measures.append((name, each.value * factor, unit, each.meaning))
    about = [(name, str(text)) for name, text in source.attributes.items()]
    named = {name: source.data[name].attrs for name, _ in columns}
    meanings = [
        (name, _in_degrees(found.get("units", ""))[1], found.get("long_name", ""))
        for name, found in named.items()
    ]
    parts = [part._replace(unit=_in_degrees(part.unit)[1]) for _, part in columns]
    heads = (TIME, *(part.head(name) for (name, _), part in zip(columns, parts, strict=True)))
    with xlsxwriter.Workbook(files[0], {"constant_memory": True}) as book:
        book.set_properties({"author": PRODUCER})
        _write(book, "summary", ("measure", "value", "unit", "meaning"), [*measures, (), *about])
        _write(book, "time series", heads, counted())
        _add_chart(book, heads, source.records.size)
        _write(book, "variables", ("variable", "unit", "meaning"), meanings)
    return note_on_empty(empty)


def _in_degrees(unit: str) -> tuple[float, str]:
    """Return the factor from a unit to that of the workbook, and its name."""
    if not re.match(r"rad\b", unit):
        return 1.0, unit
    return math.degrees(1), unit.replace("rad", "degree", 1)


def _add_chart(book: xlsxwriter.Workbook, heads: Sequence[str], rows: int) -> None:
    """Draw the error of the tip over time on the first sheet, if the table has it."""
    for place, head in enumerate(heads):
        if head.startswith("tip_error"):
            chart = book.add_chart({"type": "scatter", "subtype": "straight"})
            times, values = (["time series", 1, at, rows, at] for at in (0, place))
            chart.add_series({"categories": times, "values": values, "line": {"width": 1.0}})
            chart.set_x_axis({"name": TIME})
            chart.set_y_axis({"name": head})
            chart.set_legend({"none": True})
            book.get_worksheet_by_name("summary").insert_chart("F2", chart)


def _write(book: xlsxwriter.Workbook, name: str, head: Row, rows: Iterable[Row]) -> None:
    sheet, bold = book.add_worksheet(name), book.add_format({"bold": True})
    sheet.freeze_panes(1, 1)
    head = list(head)
    for place, text in enumerate(head):
        sheet.set_column(place, place, max(_WIDTH, len(str(text)) + 2))
    for number, row in enumerate(chain([head], rows)):
        for place, cell in enumerate(row):
            if isinstance(cell, str):
                sheet.write_string(number, place, cell, None if number else bold)
            elif cell is not None and math.isfinite(cell):
                sheet.write_number(number, place, cell)
