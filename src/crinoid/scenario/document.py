"""TOML documents: reading them, and setting single keys by their dotted name."""

import tomllib
from typing import Any

from crinoid.scenario.errors import Mistake, ScenarioError, shown

__all__ = ["assign", "override", "parse", "value_at", "value_of"]


def parse(text: str) -> dict[str, Any]:
    """Read a TOML document."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ScenarioError([Mistake("", "not valid TOML: nested too deeply")]) from None
    except ValueError as error:  # broken, or a number of thousands of digits
        lines = text.split("\n")
        end = f"(at line {len(lines)}, column {len(lines[-1]) + 1})"
        what = str(error).replace("(at end of document)", end)
        raise ScenarioError([Mistake("", f"not valid TOML: {what}")]) from None


def override(document: dict[str, Any], setting: str) -> None:
    """Change a document by one ``key=value``, in place; see `value_of`."""
    key, equals, text = setting.partition("=")
    if not equals or not key.strip():
        takes = "key=value, such as arm.length=0.6"
        raise ScenarioError([Mistake("", f"got {shown(setting)}, takes {takes}")])
    assign(document, key.strip(), value_of(text.strip()))


def assign(document: dict[str, Any], key: str, value: Any) -> None:
    """Set a dotted key of a document, in place; tables that are missing are made.

    A number is an index where it meets a list; the index after the last one adds an entry.
    """
    *outer, last = _parts(key)
    table: Any = document
    for depth, part in enumerate(outer):
        index = _index(table, part, key, outer[:depth])
        entry = table.get(index) if isinstance(table, dict) else table[index]
        if entry is None:
            following = [*outer, last][depth + 1]
            entry = table[index] = [] if following.isdecimal() else {}
        table = entry
    table[_index(table, last, key, outer)] = value


def value_of(text: str) -> Any:
    """Return a TOML value; what is not TOML is taken as text, so that words need no quotes."""
    try:
        table = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return table["value"] if len(table) == 1 else text


def value_at(document: dict[str, Any], key: str) -> Any:
    """Return what stands at a dotted key of a document; None where nothing does."""
    found: Any = document
    for part in _parts(key):
        if isinstance(found, list) and part.isdecimal() and int(part) < len(found):
            found = found[int(part)]
        elif isinstance(found, dict):
            found = found.get(part)
        else:
            return None
    return found


def _index(table: Any, part: str, key: str, outer: list[str]) -> Any:
    """Return a part of a key as the table takes it; a list gets an entry if it asks for one."""
    here = ".".join(outer)
    if isinstance(table, dict):
        return part
    if not isinstance(table, list):
        text = f"unknown key, {here} is {shown(table)} and not a table"
        raise ScenarioError([Mistake(key, text)])
    if not part.isdecimal() or len(part) > 9 or int(part) > len(table):
        text = f"unknown key, {here} takes an index from 0 to {len(table)} ({len(table)} adds one)"
        raise ScenarioError([Mistake(key, text)])
    if int(part) == len(table):
        table.append(None)
    return int(part)


def _parts(key: str) -> list[str]:
    try:
        if set(key) & set("#[]\n"):
            raise ValueError(key)
        table: Any = tomllib.loads(f"{key} = 0")
    except ValueError:
        text = "not a key; takes names joined by dots, such as arm.length"
        raise ScenarioError([Mistake(key.replace("\n", " "), text)]) from None
    parts = []
    while isinstance(table, dict):
        part, table = next(iter(table.items()))
        parts.append(part)
    return parts
