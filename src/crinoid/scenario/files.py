"""The files that a scenario's document names, and where their relative paths start."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

__all__ = ["anchor", "named_files"]

_VARIED = re.compile(r"flow(?:\.\d+(?:\.file)?)?")


def anchor(document: dict[str, Any], folder: Path) -> None:
    """Let the relative paths of a document start from a folder, in place."""
    for holder, key in _places(document):
        holder[key] = str(folder / Path(holder[key]).expanduser())


def named_files(document: dict[str, Any]) -> list[str]:
    """Return the files that a document names, each once."""
    return list(dict.fromkeys(holder[key] for holder, key in _places(document)))


def _places(document: dict[str, Any]) -> Iterator[tuple[Any, Any]]:
    """Yield what holds a file's name, and under which key; what is malformed is not looked at."""
    yield from _files(document.get("flow"))
    vary = document.get("vary")
    for key, values in vary.items() if isinstance(vary, dict) else ():
        if not _VARIED.fullmatch(key) or not isinstance(values, list):
            continue
        for index, value in enumerate(values):
            if isinstance(value, str) and key.endswith(".file"):
                yield values, index
            yield from _files(value)


def _files(flows: Any) -> Iterator[tuple[Any, Any]]:
    for flow in flows if isinstance(flows, list) else [flows]:
        # an empty name is no folder; the scenario refuses it
        if isinstance(flow, dict) and isinstance(flow.get("file"), str) and flow["file"]:
            yield flow, "file"
