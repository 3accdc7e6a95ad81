"""Every key that a scenario takes, as ``--set`` names it."""

from collections.abc import Iterator
from typing import Any

from crinoid.scenario.errors import join
from crinoid.scenario.quantity import unit_of

__all__ = ["all_keys", "unit_at"]

Schema = dict[str, Any]


def all_keys(schema: Schema) -> dict[str, bool]:
    """Return the dotted keys of a JSON schema, each with whether it is a table.

    A list of tables stands with its first index: ``flow.0.velocity``.
    """
    found = _below("", schema, schema["$defs"])
    return {key: any(_tables(entry)) for key, entry in found}


def unit_at(schema: Schema, key: str) -> str:
    """Return the unit of what a dotted key takes, in the schema of all tables; empty if none."""
    first = ".".join("0" if part.isdecimal() else part for part in key.split("."))
    wanted = {first, first.removesuffix(".0")}  # one component of a vector
    keys = _below("", schema, schema["$defs"])
    return next(filter(None, (unit_of(entry) for name, entry in keys if name in wanted)), "")


def _below(prefix: str, table: Schema, definitions: Schema) -> Iterator[tuple[str, Schema]]:
    for name, entry in table["properties"].items():
        key = join(prefix, name)
        inner = list(_tables(entry))
        yield key, entry
        for index, found in inner:
            place = join(key, index)
            yield from _below(place, definitions[found.rpartition("/")[2]], definitions)


def _tables(entry: Schema) -> Iterator[tuple[str, str]]:
    """Yield the definitions of a table or of a list of tables, with the index of the latter."""
    for member in (entry, *entry.get("anyOf", ()), *entry.get("allOf", ())):
        if "$ref" in member:
            yield "", member["$ref"]
    items = entry.get("items", {})
    for member in (items, *items.get("oneOf", ())) if isinstance(items, dict) else ():
        if "$ref" in member:
            yield "0", member["$ref"]
