"""Files that crinoid wrote: the mark by which each format names its author."""

import csv
import io
import mmap
import re
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from crinoid.foundation.result_variables import VARIABLES
from crinoid.results.metrics import header_of, is_table
from crinoid.results.result_file import attributes
from crinoid.results.summary import HEAD

MADE = "made by crinoid"
"""First words of the comment in each film."""
PRODUCER = "crinoid"
"""Producer of an ONNX file."""
TIME, SHARE = "time (s)", "share of time"
"""Heads of the first column of a table over time, and of the last one of a histogram."""
_TABLE_ENDS = (["extreme", "extreme_low", "extreme_high"], ["p_value", "against"])
"""Last columns of means over seeds, and of a comparison."""
_PRODUCED = bytes([0x12, len(PRODUCER)]) + PRODUCER.encode()
"""Field 2 of an ONNX file, as Protocol Buffers writes it after the version (two bytes)."""
FIGURES = {
    ".png": (b"Software\0crinoid", b"Source\0%s"),
    ".pdf": (b"/Creator (crinoid", b"/Subject (%s)"),
    ".svg": (b"<dc:title>crinoid", b"<dc:source>%s<"),
}
"""Marks in a figure by its ending: of crinoid, and of the file that it shows."""
_UNCHANGED = re.compile(rb"creator>crinoid<.*created[^>]*>([^<]+)<.*modified[^>]*>\1<", re.DOTALL)
"""Properties of a workbook that no other program has saved again."""
_MARKS: dict[str, tuple[bytes, int | None]] = {
    ".json": (b'"crinoid_version"', 100),
    **{ending: (mark, None) for ending, (mark, _) in FIGURES.items()},
    ".html": (b'name="generator" content="crinoid', 2000),
    ".glb": (b'"generator":"crinoid', None),
    ".mcap": (b"crinoid_version", None),
    ".usda": (b"crinoid_version", 2000),
    ".onnx": (_PRODUCED, 2 + len(_PRODUCED)),
    ".fmu": (b'author="crinoid"', None),
    ".mp4": (MADE.encode(), None),
    ".gif": (MADE.encode(), None),
    **dict.fromkeys((".npz", ".mat"), (b"crinoid_version", None)),
}
"""Mark of crinoid by ending, and the number of bytes that it is within; None: anywhere."""


def is_own(path: Path) -> bool:
    """Return whether crinoid wrote a file; of netCDF and HDF5 files the attributes say so."""
    ending = path.suffix.lower()
    if ending == ".csv":
        head, line = header_of(path)
        names = {re.split("[. ]", each)[0] for each in head[1:]}
        over_time = head[:1] == [TIME] and names <= {each.name for each in VARIABLES}
        summed_up = any(head[-len(ends) :] == ends for ends in _TABLE_ENDS)
        known = over_time or head == [*HEAD] or head[1:2] == ["branch"] or head[-1:] == [SHARE]
        return is_table(path) or summed_up or (known and line == table_head(head))
    if ending == ".xlsx":
        with suppress(OSError, KeyError, zipfile.BadZipFile), zipfile.ZipFile(path) as book:
            return bool(_UNCHANGED.search(book.read("docProps/core.xml")))
        return False
    if ending not in _MARKS:
        return bool(attributes(path))
    mark, within = _MARKS[ending]
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            return data.find(mark, 0, within or len(data)) >= 0
    except (OSError, ValueError):  # ValueError: it is empty
        return False


def table_head(names: Sequence[str]) -> str:
    """Return the head of a table: each name in quotation marks.

    Spreadsheets read these, but write none where none are needed. So they distinguish a table of
    crinoid's from one that was made or saved elsewhere.
    """
    quoted = io.StringIO()
    csv.writer(quoted, quoting=csv.QUOTE_ALL).writerow(names)
    return quoted.getvalue()
