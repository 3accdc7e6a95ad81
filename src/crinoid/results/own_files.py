"""Files that crinoid wrote: the mark by which each format names its author."""

import csv
import io
import mmap
import re
from collections.abc import Sequence
from pathlib import Path

from crinoid.foundation.result_variables import VARIABLES
from crinoid.results.metrics import header_of, is_table
from crinoid.results.result import attributes

MADE = "made by crinoid"
"""First words of the comment in each film."""
PRODUCER = "crinoid"
"""Producer of an ONNX file."""
TIME = "time (s)"
"""Head of the first column of a table."""
_PRODUCED = bytes([0x12, len(PRODUCER)]) + PRODUCER.encode()
"""Field 2 of an ONNX file, as Protocol Buffers writes it after the version (two bytes)."""
_MARKS = {
    ".png": (b"Software\0crinoid", 2000),
    ".html": (b'name="generator" content="crinoid', 2000),
    ".glb": (b'"generator":"crinoid', None),
    ".onnx": (_PRODUCED, 2 + len(_PRODUCED)),
    ".mp4": (MADE.encode(), None),
    ".gif": (MADE.encode(), None),
}
"""Mark of crinoid by ending, and the number of bytes that it is within; None: anywhere."""


def is_own(path: Path) -> bool:
    """Return whether crinoid wrote a file; of netCDF and HDF5 files the attributes say so."""
    ending = path.suffix.lower()
    if ending == ".csv":
        head, line = header_of(path)
        names = {re.split("[. ]", each)[0] for each in head[1:]}
        over_time = head[:1] == [TIME] and names <= {each.name for each in VARIABLES}
        curve = head[1:2] == ["branch"]
        return is_table(path) or ((over_time or curve) and line == table_head(head))
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
