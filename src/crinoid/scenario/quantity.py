"""Types of keys: numbers with units, short lists, and marks of the dimension of the arm.

A mark next to the type of a key states how it differs between the plane and space. A table does
not know its dimension; the scenario does, and applies the marks.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, TypeVar

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from crinoid.scenario.errors import Mistake, counted, got, join
from crinoid.scenario.model import Model


@dataclass(frozen=True)
class Count:
    """Valid lengths of a list in the plane and in space; 1 is a plain number."""

    plane: tuple[int, ...]
    space: tuple[int, ...]

    def fits(self, value: Any, dimension: int) -> bool:
        """Return whether a value, or each vector of a path, has a valid length."""
        if value is None or isinstance(value, str):
            return True
        if isinstance(value, tuple) and value and isinstance(value[0], tuple):
            return all(self.fits(item, dimension) for item in value)
        count = len(value) if isinstance(value, tuple) else 1
        return count in (self.space if dimension == 3 else self.plane)


class _SchemaMark:
    """Mark that adds keywords to the JSON schema of a key."""

    def _keywords(self) -> dict[str, Any]:
        raise NotImplementedError

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return {**handler(core_schema), **self._keywords()}


@dataclass(frozen=True)
class InSpace(_SchemaMark):
    """Default of a key for an arm in space, where it differs from the one in the plane."""

    default: Any

    def _keywords(self) -> dict[str, Any]:
        default = list(self.default) if isinstance(self.default, tuple) else self.default
        return {"default_in_space": default}


class Follows:
    """Mark of a key whose default follows from other keys."""


@dataclass(frozen=True)
class Only(_SchemaMark):
    """Mark of a key that exists in one dimension only.

    Parameters
    ----------
    dimension
        2 or 3.
    hint
        The remedy in the other dimension, a sentence; by default to change the dimension.
    """

    dimension: int
    hint: str = ""

    def _keywords(self) -> dict[str, Any]:
        return {"only_in": self.dimension}


def dimension_conflicts(table: Model, dimension: int) -> Iterator[Mistake]:
    """Yield the values that are not for an arm of this dimension, in a table and those below."""
    other = 5 - dimension
    for name, mark in _marks(type(table)):
        value = getattr(table, name)
        if isinstance(mark, Only) and mark.dimension == other and _given(table, name):
            must = f"be left out in {'space' if dimension == 3 else 'the plane'}"
            yield table.mistake(name, must, mark.hint or f"Set arm.dimension = {other} to use it.")
        elif isinstance(mark, Count) and not mark.fits(value, dimension):
            spatial = dimension == 2 and mark.fits(value, 3)
            yield table.mistake(name, hint="Set arm.dimension = 3 to use it." if spatial else "")
    for name, index, inner in _inner(table):
        for mistake in dimension_conflicts(inner, dimension):
            yield mistake.under(_key(name, index))


def dimension_defaults(table: Model, dimension: int) -> dict[str, Any]:
    """Return the keys of a table whose default depends on the dimension, with their new values.

    Keys with an explicit value do not change.
    """
    changed: dict[str, Any] = {}
    for name, mark in _marks(type(table)):
        if isinstance(mark, InSpace) and not _given(table, name):
            planar = type(table).model_fields[name].default
            changed[name] = mark.default if dimension == 3 else planar
    for name, index, inner in _inner(table):
        found = dimension_defaults(inner, dimension)
        if not found:
            continue
        copied = inner.model_copy()
        copied.__dict__.update(found)  # `update` of the copy would make them explicit
        if index is None:
            changed[name] = copied
        else:
            items = changed.get(name, getattr(table, name))
            changed[name] = (*items[:index], copied, *items[index + 1 :])
    return changed


def unwritten(
    table: Model, dimension: int, left_open: Callable[[str], bool], prefix: str = ""
) -> dict[str, Any]:
    """Return the keys to leave out of a written scenario, in the form of pydantic's ``exclude``.

    These are the keys of the other dimension. Keys without an explicit value whose default depends
    on the dimension, or on other keys, are left out too, if ``left_open`` is true of their dotted
    key.
    """
    found: dict[str, Any] = {}
    for name, mark in _marks(type(table)):
        other = isinstance(mark, Only) and mark.dimension != dimension
        follows = isinstance(mark, Only | InSpace | Follows) and not _given(table, name)
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
def _marks(table: type[Model]) -> tuple[tuple[str, Count | InSpace | Only | Follows], ...]:
    return tuple(
        (name, mark)
        for name, field in table.model_fields.items()
        for mark in field.metadata
        if isinstance(mark, Count | InSpace | Only | Follows)
    )


def _given(table: Model, name: str) -> bool:
    return name in table.model_fields_set and getattr(table, name) is not None


def _inner(table: Model) -> Iterator[tuple[str, int | None, Model]]:
    """Yield the tables directly below a table, each with its key and its index in a list."""
    for name, value in table:
        if isinstance(value, Model):
            yield name, None, value
        elif isinstance(value, tuple):
            for index, item in enumerate(value):
                if isinstance(item, Model):
                    yield name, index, item


@dataclass(frozen=True)
class Quantity(_SchemaMark):
    """Unit and values of a key, for the JSON schema and the messages made from it.

    Parameters
    ----------
    unit
        Its unit; empty for a plain number.
    expects
        The valid values in words, where the type and the bounds do not say it well.
    in_space
        The valid values for an arm in space, if they differ.
    """

    unit: str = ""
    expects: str = ""
    in_space: str = ""

    def _keywords(self) -> dict[str, Any]:
        texts = {"unit": self.unit, "expects": self.expects, "expects_in_space": self.in_space}
        return {key: text for key, text in texts.items() if text}


def unit_of(schema: dict[str, Any]) -> str:
    """Return the unit in the JSON schema of a key; empty if it has none."""
    units = (member.get("unit", "") for member in (schema, *schema.get("anyOf", ())))
    return next(filter(None, units), "")


def _as_tuple(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    return tuple(value) if isinstance(value, list) else value


# TOML has lists and Python users have arrays; a frozen model has tuples.
AsTuple = BeforeValidator(_as_tuple)
_Item = TypeVar("_Item")
ListOf = Annotated[tuple[_Item, ...], AsTuple]

Name = Annotated[
    str | None,
    Field(pattern="^[a-z][a-z0-9_]*$"),
    Quantity(expects="a name of a-z, 0-9 and _ that begins with a letter"),
]

Metres = Annotated[float, Quantity("m")]
SquareMetres = Annotated[float, Quantity("m2")]
Seconds = Annotated[float, Quantity("s")]
Hertz = Annotated[float, Quantity("Hz")]
Degrees = Annotated[float, Quantity("degrees")]
MetresPerSecond = Annotated[float, Quantity("m/s")]
Newtons = Annotated[float, Quantity("N")]
Kilograms = Annotated[float, Quantity("kg")]
CubicMetres = Annotated[float, Quantity("m3")]
NewtonMetres = Annotated[float, Quantity("N m")]
Pascals = Annotated[float, Quantity("Pa")]
PerMetre = Annotated[float, Quantity("1/m")]
DegreesPerSecond = Annotated[float, Quantity("degrees/s")]

Pair = Annotated[tuple[float, float], AsTuple, Quantity(expects="a pair of numbers")]
Triple = Annotated[tuple[float, float, float], AsTuple]
Times = Annotated[tuple[float, ...], AsTuple, Quantity("s", "a list of numbers")]

# A planar arm moves in x (forward) and z (up), a spatial one in y (to port) as well.
Components = Annotated[tuple[float, ...], AsTuple, Field(min_length=2, max_length=3)]
PER_AXIS = Count(plane=(2,), space=(3,))
Vector = Annotated[Components, Quantity(expects="[x, z]", in_space="[x, y, z]"), PER_AXIS]
Position = Annotated[Vector, Quantity("m")]
Velocity = Annotated[Vector, Quantity("m/s")]
Force = Annotated[Vector, Quantity("N")]


INTERVALS = (1e-6, 1e9)  # times between two points of a record, a motion or a path (s)
LATEST = 1e9  # largest time of a point (s); a later one has too few digits after the point
OPPOSITE = -1 + 1e-9  # cosine between opposite directions: neither way is the shorter one


def time_conflicts(time: tuple[float, ...]) -> Iterator[Mistake]:
    """Yield the mistakes in the times of a table: two or more, increasing by usable steps."""
    low, high = INTERVALS
    if len(time) < 2:
        yield Mistake("time", got(time, "have at least 2 entries"))
    for index, (before, after) in enumerate(pairwise(time), start=1):
        if not low <= after - before <= high:
            must = f"be {low:g} to {high:g} s after {before}, the time before it"
            yield Mistake(f"time.{index}", got(after, must))
            return
    for index, instant in enumerate(time):
        if abs(instant) > LATEST:
            must = f"be a number from {-LATEST:g} to {LATEST:g} (s)"
            yield Mistake(f"time.{index}", got(instant, must))
            return


def length_conflicts(
    key: str, values: tuple[Any, ...], time: tuple[float, ...]
) -> Iterator[Mistake]:
    """Yield a list that is not as long as that of its times."""
    if len(values) != len(time):
        must = f"have {counted(len(time), 'entry', 'entries')}, one for each time"
        yield Mistake(key, got(values, must))


def span_conflicts(key: str, span: tuple[float, float]) -> Iterator[Mistake]:
    """Yield a part of the arm that is not within it, or has no length."""
    if not 0 <= span[0] < span[1] <= 1:
        yield Mistake(key, got(span, "be [a, b] with 0 <= a < b <= 1"))


def direction_conflicts(key: str, vector: tuple[float, ...]) -> Iterator[Mistake]:
    """Yield a vector without a direction."""
    if not any(vector):
        yield Mistake(key, got(vector, "be a vector that is not 0"))


def name_conflicts(names: Mapping[str, str], owners: Mapping[str, str]) -> Iterator[Mistake]:
    """Yield names, by the key of a table, that an earlier table or an owner has already."""
    owners = dict(owners)
    for key, name in names.items():
        if name in owners:
            yield Mistake(f"{key}.name", got(name, f"differ from the name of {owners[name]}"))
        owners.setdefault(name, key)


def unit_vector(vector: tuple[float, ...]) -> tuple[float, ...]:
    """Return a vector with the same direction and a length of one."""
    # by a power of two, which rounds nothing: squares of very large or small numbers have no size
    _, power = math.frexp(max(map(abs, vector)))
    scaled = [math.ldexp(component, -power) for component in vector]
    length = math.hypot(*scaled)
    return tuple(component / length for component in scaled)
