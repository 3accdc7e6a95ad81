"""Kinds of tables that other installed packages bring, by the names that scenarios give them.

A package names its tables under the entry points ``crinoid.loads``, ``crinoid.flows``,
``crinoid.controllers``, ``crinoid.sensors`` and ``crinoid.actuators``. One is imported when a
scenario asks for its kind, and not before.
"""

from collections.abc import Callable, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, get_args

from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from crinoid.scenario.errors import Mistake, ScenarioError, one_of, shown
from crinoid.scenario.model import Model

__all__ = ["KindOf", "installed", "installed_table", "is_own"]


def is_own(part: object) -> bool:
    """Tell whether a part or a table comes with crinoid."""
    return type(part).__module__.partition(".")[0] == "crinoid"


@cache
def installed(group: str) -> dict[str, EntryPoint]:
    """Return the kinds of a group that installed packages bring, by name."""
    return {each.name: each for each in entry_points(group=f"crinoid.{group}")}


def installed_table(group: str, kind: str, base: type[Model]) -> type[Any]:
    """Load the table of a kind that an installed package brings; it is derived from ``base``."""
    entry = installed(group)[kind]
    try:
        table = entry.load()
    except Exception as error:  # whatever the package does wrong
        raise _broken(entry, f"{type(error).__name__}: {error}") from error
    if not (isinstance(table, type) and issubclass(table, base)):
        raise _broken(entry, f"{entry.value} is not derived from {base.__name__}")
    if table.build is base.build:  # type: ignore[attr-defined]
        raise _broken(entry, f"{entry.value} has no method build of its own")
    return table


def _broken(entry: EntryPoint, why: str) -> ScenarioError:
    package = entry.dist.name if entry.dist is not None else entry.value
    text = f"got {shown(entry.name)}, which the installed package {package} brings and which "
    return ScenarioError([Mistake("kind", f"{text}cannot be loaded: {' '.join(why.split())}")])


class KindOf:
    """Mark of tables that are told apart by ``kind``, some of them by installed packages.

    Parameters
    ----------
    group
        Name of the entry points, without ``crinoid.``.
    base
        What their tables are derived from.
    """

    def __init__(self, group: str, base: type[Model]) -> None:
        self.group, self.base = group, base
        self._own: tuple[str, ...] = ()

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        self._own = tuple(
            kind
            for table in get_args(source)
            for kind in get_args(table.model_fields["kind"].annotation)
        )
        return core_schema.no_info_wrap_validator_function(
            self._table,
            handler(source),
            # else what a table of a package has of its own would not be written
            serialization=core_schema.simple_ser_schema("any"),
        )

    def _table(self, value: Any, own: Callable[[Any], Any]) -> Any:
        tables = isinstance(value, Mapping)
        if not tables and not isinstance(value, self.base):
            return own(value)
        given: Any = value
        kind = given.get("kind") if tables else given.kind
        if kind in self._own:
            return own(value)
        if isinstance(kind, str) and kind in installed(self.group):
            table = installed_table(self.group, kind, self.base)
            return table(**given) if tables else given
        known = sorted({*self._own, *installed(self.group)})
        takes = one_of(known) if known else "that of a package, of which none is installed"
        got = "missing" if kind is None else f"got {shown(kind)}"
        raise ScenarioError([Mistake("kind", f"{got}, takes {takes}")])
