"""The files that exports are written to, beside what is exported and named after it."""

import csv
import io
import json
import re
import struct
from collections.abc import Sequence
from pathlib import Path

from crinoid.result import attributes
from crinoid.variables import VARIABLES

TIME = "time (s)"
"""Head of the first column of a table."""
_LONGEST = 1 << 24
"""Characters of a head beyond which nobody reads it."""
PRODUCER = "crinoid"
"""Who an ONNX file names as its producer."""
_VERSION, _PRODUCER = b"\x08", bytes([0x12, len(PRODUCER)]) + PRODUCER.encode()
"""Fields 1 and 2 of an ONNX file, as Protocol Buffers writes them."""
_ENDINGS = {
    "vtkhdf": (".vtkhdf", "-surroundings.vtkhdf"),
    "csv": (".csv",),
    "gltf": (".glb",),
    "onnx": (".onnx",),
}
KINDS = tuple(_ENDINGS)
"""Formats to export to."""


def files_of(folder: Path, name: str, kind: str) -> list[Path]:
    """Return the files in a folder of the export of a result or policy of some name."""
    return [folder / f"{name}{ending}" for ending in _ENDINGS[kind]]


def exports_in(folder: Path, name: str) -> list[Path]:
    """Return all exports of a result or policy in a folder."""
    every = (path for kind in KINDS for path in files_of(folder, name, kind))
    return [path for path in every if path.is_file() and is_own(path)]


def is_own(path: Path) -> bool:
    """Tell whether a file is an export that crinoid wrote."""
    look = {".csv": _is_table, ".glb": _is_gltf, ".onnx": _is_onnx}.get(
        path.suffix, lambda path: bool(attributes(path))
    )
    return look(path)


def head_of(names: Sequence[str]) -> str:
    """Return the head of a table: each name in quotation marks.

    Programs of tables read these, but write none where none are needed. So they tell a table of
    crinoid's from one that was made or saved elsewhere.
    """
    quoted = io.StringIO()
    csv.writer(quoted, quoting=csv.QUOTE_ALL).writerow(names)
    return quoted.getvalue()


def _is_table(path: Path) -> bool:
    """Tell by the head of a table."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            line = file.readline(_LONGEST)
        head = next(csv.reader([line]), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    names = {re.split("[. ]", each)[0] for each in head[1:]}
    known = head[:1] == [TIME] and names <= {each.name for each in VARIABLES}
    return known and line == head_of(head)


def _is_gltf(path: Path) -> bool:
    """Tell by the generator that a file names."""
    try:
        with path.open("rb") as file:
            magic, _, _, length, kind = struct.unpack("<4sIII4s", file.read(20))
            if (magic, kind) != (b"glTF", b"JSON"):
                return False
            asset = json.loads(file.read(length))["asset"]
            return str(asset["generator"]).startswith("crinoid")
    except (OSError, struct.error, ValueError, LookupError, TypeError):
        return False


def _is_onnx(path: Path) -> bool:
    """Tell by the producer that a file names, right after the version of the format (one byte)."""
    try:
        with path.open("rb") as file:
            head = file.read(len(_PRODUCER) + 2)
    except OSError:
        return False
    return head[:1] == _VERSION and head[2:] == _PRODUCER
