"""The files that a scenario names, and where their relative paths start."""

import hashlib
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field

from crinoid.scenario.quantity import Quantity

__all__ = ["File", "FileName", "anchor", "digests", "named_files"]

_KEYS = ("file", "weights")
"""Keys that name a file."""

# absolute, so that a scenario that is stored means the same file wherever it is read again
FileName = Annotated[
    str,
    Field(min_length=1),
    AfterValidator(lambda path: os.path.abspath(os.path.expanduser(path))),
]
File = Annotated[FileName, Quantity(takes="the path of a CSV or netCDF file")]


def anchor(document: dict[str, Any], folder: Path) -> None:
    """Let the relative paths of a document start from a folder, in place."""
    for holder, key in _places(document):
        holder[key] = str(folder / os.path.expanduser(holder[key]))


def named_files(document: dict[str, Any]) -> list[str]:
    """Return the files that a document names, each once."""
    return list(dict.fromkeys(holder[key] for holder, key in _places(document)))


def digests(document: dict[str, Any]) -> dict[str, str]:
    """Return the SHA-256 digest of each file that a document names and that can be read."""
    found = {}
    for name in named_files(document):
        with suppress(OSError, ValueError):  # ValueError: a name that no file can have
            if Path(name).is_file():  # a pipe would never end
                with Path(name).open("rb") as file:
                    found[name] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


def _places(document: dict[str, Any]) -> Iterator[tuple[Any, Any]]:
    """Yield what holds a file's name, and under which key: any of their keys, also in `vary`."""
    for name, value in document.items():
        # an empty name is no folder; the scenario refuses it
        if name in _KEYS and _named(value):
            yield document, name
        elif name.endswith(tuple(f".{key}" for key in _KEYS)) and isinstance(value, list):
            yield from ((value, index) for index, item in enumerate(value) if _named(item))
        else:
            yield from _inner(value)


def _inner(value: Any) -> Iterator[tuple[Any, Any]]:
    if isinstance(value, dict):
        yield from _places(value)
    elif isinstance(value, list):
        for item in value:
            yield from _inner(item)


def _named(value: Any) -> bool:
    return isinstance(value, str) and bool(value)
