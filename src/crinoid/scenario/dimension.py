"""Keys that are not the same for an arm in the plane and one in space.

What differs stands beside the type of a key, as one of the marks below. A table does not know in
which dimension it is used; the scenario that holds it does, and looks the marks up.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from pydantic import GetJsonSchemaHandler
from pydantic_core import CoreSchema

from crinoid.scenario.errors import Mistake, join, shown
from crinoid.scenario.model import Model

__all__ = ["Count", "InSpace", "Only", "dimension_conflicts", "fitted", "unwritten"]


@dataclass(frozen=True)
class Count:
    """How many numbers a key takes in the plane and in space; or a word, or nothing."""

    plane: tuple[int, ...]
    space: tuple[int, ...]

    def fits(self, value: Any, dimension: int) -> bool:
        """Tell whether a value has as many numbers, or each vector of a path has."""
        if value is None or isinstance(value, str):
            return True
        if isinstance(value, tuple) and value and isinstance(value[0], tuple):
            return all(self.fits(item, dimension) for item in value)
        count = len(value) if isinstance(value, tuple) else 1
        return count in (self.space if dimension == 3 else self.plane)


@dataclass(frozen=True)
class InSpace:
    """The default of a key for an arm in space, where it is another than in the plane."""

    default: Any

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        default = list(self.default) if isinstance(self.default, tuple) else self.default
        return {**handler(core_schema), "default_in_space": default}


@dataclass(frozen=True)
class Only:
    """Mark of a key that exists in one dimension only.

    Parameters
    ----------
    dimension
        2 or 3.
    but
        End of the message in the other dimension; left out, it tells which one the key needs.
    """

    dimension: int
    but: str = ""

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(core_schema), "only_in": self.dimension}

    def mistake(self, name: str, value: Any) -> Mistake:
        """Say that a key that was given is of the other dimension."""
        text = self.but or f"needs arm.dimension = {self.dimension}"
        return Mistake(name, text if isinstance(value, Model) else f"got {shown(value)}, {text}")


def dimension_conflicts(table: Model, dimension: int) -> Iterator[Mistake]:
    """Yield what an arm of this dimension does not take, in a table and those below it."""
    for name, mark in _marks(type(table)):
        value = getattr(table, name)
        if isinstance(mark, Only) and mark.dimension != dimension and _given(table, name):
            yield mark.mistake(name, value)
        elif isinstance(mark, Count) and not mark.fits(value, dimension):
            yield _other(table.refused(name), mark, value, 5 - dimension)
    for name, index, inner in _inner(table):
        for mistake in dimension_conflicts(inner, dimension):
            yield mistake.under(_key(name, index))


def _other(mistake: Mistake, mark: Count, value: Any, dimension: int) -> Mistake:
    """Say of a list that it is for the other dimension, where it is."""
    if not mark.fits(value, dimension):
        return mistake
    return replace(mistake, text=f"{mistake.text}; this one is for arm.dimension = {dimension}")


def fitted(table: Model, dimension: int) -> dict[str, Any]:
    """Return what changes in a table with the defaults of a dimension, by key.

    What was given stays as it is.
    """
    changed: dict[str, Any] = {}
    for name, mark in _marks(type(table)):
        if isinstance(mark, InSpace) and not _given(table, name):
            planar = type(table).model_fields[name].default
            changed[name] = mark.default if dimension == 3 else planar
    for name, index, inner in _inner(table):
        found = fitted(inner, dimension)
        if not found:
            continue
        copied = inner.model_copy()
        copied.__dict__.update(found)  # `update` of the copy would make them keys that were given
        if index is None:
            changed[name] = copied
        else:
            items = changed.get(name, getattr(table, name))
            changed[name] = (*items[:index], copied, *items[index + 1 :])
    return changed


def unwritten(
    table: Model, dimension: int, left_open: Callable[[str], bool], prefix: str = ""
) -> dict[str, Any]:
    """Return what to leave out when a scenario is written, in the form of pydantic's ``exclude``.

    These are the keys of the other dimension, and those whose default follows the dimension where
    they were not given and ``left_open`` of their dotted key is true.
    """
    found: dict[str, Any] = {}
    for name, mark in _marks(type(table)):
        other = isinstance(mark, Only) and mark.dimension != dimension
        follows = isinstance(mark, Only | InSpace) and not _given(table, name)
        if other or (follows and left_open(join(prefix, name))):
            found[name] = True
    for name, index, inner in _inner(table):
        below = unwritten(inner, dimension, left_open, join(prefix, _key(name, index)))
        if below and index is None:
            found[name] = below
        elif below:
            found.setdefault(name, {})[index] = below
    return found


def _key(name: str, index: int | None) -> str:
    return name if index is None else f"{name}.{index}"


@cache
def _marks(table: type[Model]) -> tuple[tuple[str, Count | InSpace | Only], ...]:
    return tuple(
        (name, mark)
        for name, field in table.model_fields.items()
        for mark in field.metadata
        if isinstance(mark, Count | InSpace | Only)
    )


def _given(table: Model, name: str) -> bool:
    return name in table.model_fields_set and getattr(table, name) is not None


def _inner(table: Model) -> Iterator[tuple[str, int | None, Model]]:
    """Yield the tables below a table, each with its key and, of a list, its index there."""
    for name, value in table:
        if isinstance(value, Model):
            yield name, None, value
        elif isinstance(value, tuple):
            for index, item in enumerate(value):
                if isinstance(item, Model):
                    yield name, index, item
