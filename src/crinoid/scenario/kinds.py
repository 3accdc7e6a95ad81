"""Kinds of tables from other installed packages, by their names in scenarios.

A package names its tables under the entry points ``crinoid.loads``, ``crinoid.flows``,
``crinoid.controllers``, ``crinoid.sensors`` and ``crinoid.actuators``. One is imported when a
scenario names its kind, and not before.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pkgutil import resolve_name
from typing import Any, get_args

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from crinoid.scenario.errors import Mistake, ScenarioError, got, join, missing, one_of, refusal
from crinoid.scenario.model import Model, Schema
from crinoid.scenario.quantity import unit_of

_MOST_PLACES = 3


def all_keys(schema: Schema) -> dict[str, bool]:
    """Return the dotted keys of a JSON schema, each with whether it is a table.

    A list of tables has its first index: ``flow.0.velocity``.
    """
    found = _below("", schema, schema["$defs"])
    return {key: any(_tables(entry)) for key, entry in found}


def unit_at(schema: Schema, key: str) -> str:
    """Return the unit of a dotted key, in the schema of all tables; empty without one."""
    table, *parts = ("0" if part.isdecimal() else part for part in key.split("."))
    if parts and any(index for index, _ in _tables(schema["properties"].get(table, {}))):
        parts[0] = "0"  # in place of a name
    first, units = ".".join([table, *parts]), units_of(schema)
    return units.get(first) or units.get(first.removesuffix(".0"), "")  # or of a vector


def units_of(schema: Schema) -> dict[str, str]:
    """Return the unit of each dotted key that has one; lists of tables have their first index."""
    found: dict[str, str] = {}
    for key, entry in _below("", schema, schema["$defs"]):
        if unit := unit_of(entry):
            found.setdefault(key, unit)
    return found


def _below(prefix: str, table: Schema, definitions: Schema) -> Iterator[tuple[str, Schema]]:
    for name, entry in table["properties"].items():
        key = join(prefix, name)
        yield key, entry
        for index, found in _tables(entry):
            inner = definitions[found.rpartition("/")[2]]
            yield from _below(join(key, index), inner, definitions)


def _tables(entry: Schema) -> Iterator[tuple[str, str]]:
    """Yield the definitions of a table or of a list of tables, with the index of the latter."""
    for member in (entry, *entry.get("anyOf", ()), *entry.get("allOf", ())):
        if "$ref" in member:
            yield "", member["$ref"]
    items = entry.get("items", {})
    for member in (items, *items.get("oneOf", ())) if isinstance(items, dict) else ():
        if "$ref" in member:
            yield "0", member["$ref"]


def with_places(mistake: Mistake, schema: Schema) -> Mistake:
    """Return a mistake with the places in a scenario where an unknown key exists."""
    table, _, name = mistake.key.partition(".")
    if table == "vary" and name in schema["properties"]:
        return replace(mistake, text=f"{mistake.text}. Write {name} above the first table.")
    if not mistake.text.startswith("unknown key"):
        return mistake
    name = mistake.key.rpartition(".")[2]
    found = [key for key in all_keys(schema) if key.rpartition(".")[2] == name]
    if not found or mistake.key in found:  # of another kind of the same table
        return mistake
    near = [mistake.instead] if name in mistake.instead else []
    *others, last = dict.fromkeys([*near, *found[:_MOST_PLACES]])
    instead = f"{', '.join(others)} or {last}" if others else last
    return replace(mistake, text="unknown key", instead=instead)


def part(name: str, /, *numbers: Any, **named: Any) -> Any:
    """Build a part of crinoid by a class or a function that is named as ``module:Class``.

    The module is imported here: a table describes, and by itself loads no JAX. Numbers and tuples
    of numbers become arrays.
    """
    array = resolve_name("crinoid.assembly.arrays:array_of_plain")
    named = {key: array(value) for key, value in named.items()}
    return resolve_name(name)(*map(array, numbers), **named)


def is_own(part: object) -> bool:
    """Return whether a part or a table comes with crinoid."""
    return type(part).__module__.partition(".")[0] == "crinoid"


@cache
def installed(group: str) -> dict[str, EntryPoint]:
    """Return the kinds of a group from installed packages, by name."""
    return {each.name: each for each in entry_points(group=f"crinoid.{group}")}


def installed_table(group: str, kind: str, base: type[Model]) -> type[Any]:
    """Return the table of a kind from an installed package; it is derived from ``base``."""
    entry = installed(group)[kind]
    try:
        table = entry.load()
    except Exception as error:  # any fault of the package
        raise _broken(entry, f"{type(error).__name__}: {error}") from error
    if not (isinstance(table, type) and issubclass(table, base)):
        raise _broken(entry, f"{entry.value} is not derived from {base.__name__}")
    if table.build is base.build:  # type: ignore[attr-defined]
        raise _broken(entry, f"{entry.value} has no own method build")
    return table


def package_of(entry: EntryPoint) -> str:
    """Return the name of the package that an entry point comes from."""
    return entry.dist.name if entry.dist is not None else entry.value


def _broken(entry: EntryPoint, why: str) -> ScenarioError:
    hint = f"The installed package {package_of(entry)} fails: {' '.join(why.split())}"
    return refusal("kind", got(entry.name, "be a kind that can be loaded", hint))


class KindOf:
    """Mark of tables that differ by ``kind``, some of them from installed packages.

    ``group`` is the name of the entry points without ``crinoid.``, ``base`` that of their tables.
    """

    def __init__(self, group: str, base: type[Model]) -> None:
        self.group, self.base = group, base
        self._own: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        self._own = tuple(
            kind
            for table in get_args(source) or (source,)
            for kind in get_args(table.model_fields["kind"].annotation)
        )
        return core_schema.no_info_wrap_validator_function(
            self._table,
            handler(source),
            # else the further keys of a table of a package would not be written
            serialization=core_schema.simple_ser_schema("any"),
        )

    def _table(self, value: Any, own: Callable[[Any], Any]) -> Any:
        if isinstance(value, Mapping):
            kind = value.get("kind")
        elif isinstance(value, self.base):
            kind = getattr(value, "kind", None)
        else:
            return own(value)
        if kind in self._own:
            return own(value)
        if isinstance(kind, str) and kind in installed(self.group):
            table = installed_table(self.group, kind, self.base)
            return table(**value) if isinstance(value, Mapping) else value
        known = sorted({*self._own, *installed(self.group)})
        must = f"be {one_of(known)}" if known else "be that of a package. None is installed"
        hint = "Other kinds come from installed packages." if known else ""
        raise refusal("kind", missing(must) if kind is None else got(kind, must, hint))
