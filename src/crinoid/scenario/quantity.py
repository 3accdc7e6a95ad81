"""Numbers with their units, and short lists of them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from crinoid.scenario.dimension import Count
from crinoid.scenario.errors import Mistake, counted, shown


@dataclass(frozen=True)
class Quantity:
    """Meaning of a number; kept in the JSON schema, from where error messages take it.

    Parameters
    ----------
    unit
        Its unit; empty for a plain number.
    takes
        What the key takes, in words, where the type and the bounds do not say it well.
    in_space
        What it takes for an arm in space, if that is something else.
    """

    unit: str = ""
    takes: str = ""
    in_space: str = ""

    def __get_pydantic_json_schema__(
        self, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        schema = handler(core_schema)
        given = {"unit": self.unit, "takes": self.takes, "takes_in_space": self.in_space}
        return {**schema, **{key: text for key, text in given.items() if text}}


def unit_of(schema: dict[str, Any]) -> str:
    """Return the unit in the JSON schema of a key; empty if it has none."""
    units = (member.get("unit", "") for member in (schema, *schema.get("anyOf", ())))
    return next(filter(None, units), "")


def _as_tuple(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    return tuple(value) if isinstance(value, list) else value


# TOML has lists and Python users have arrays; a frozen model holds tuples.
AsTuple = BeforeValidator(_as_tuple)

NAME = Quantity(takes="a name of a-z, 0-9 and _ that begins with a letter")

Metres = Annotated[float, Quantity("m")]
SquareMetres = Annotated[float, Quantity("m2")]
Seconds = Annotated[float, Quantity("s")]
Hertz = Annotated[float, Quantity("Hz")]
Degrees = Annotated[float, Quantity("degrees")]
MetresPerSecond = Annotated[float, Quantity("m/s")]
Newtons = Annotated[float, Quantity("N")]
Kilograms = Annotated[float, Quantity("kg")]

Pair = Annotated[tuple[float, float], AsTuple, Quantity(takes="a pair of numbers")]
Triple = Annotated[tuple[float, float, float], AsTuple]
Times = Annotated[tuple[float, ...], AsTuple, Quantity("s", "a list of numbers")]

# A planar arm moves in x (forward) and z (up), a spatial one in y (to port) as well.
Components = Annotated[tuple[float, ...], AsTuple, Field(min_length=2, max_length=3)]
PER_AXIS = Count(plane=(2,), space=(3,))
Vector = Annotated[Components, Quantity(takes="[x, z]", in_space="[x, y, z]"), PER_AXIS]
Position = Annotated[Vector, Quantity("m")]
Velocity = Annotated[Vector, Quantity("m/s")]
Force = Annotated[Vector, Quantity("N")]


INTERVALS = (1e-6, 1e9)
"""Times between two points of a record, a motion or a path (s)."""
LATEST = 1e9
"""Largest time of a point (s); later ones have too few digits left."""
OPPOSITE = -1 + 1e-9
"""Cosine of an angle between directions from which on no way between them is the shorter one."""


def time_conflicts(time: tuple[float, ...]) -> Iterator[Mistake]:
    """Yield what is wrong with the times of a table: they are to be two or more, increasing."""
    low, high = INTERVALS
    if len(time) < 2:
        yield Mistake("time", f"got {shown(time)}, takes 2 times or more")
    for index, (before, after) in enumerate(pairwise(time), start=1):
        if after <= before:
            yield Mistake(f"time.{index}", f"got {after}, takes a number above {before} (s)")
            return
        if not low <= after - before <= high:
            text = f"got {after}, takes {low:g} to {high:g} s more than {before}, the one before"
            yield Mistake(f"time.{index}", text)
            return
    for index, instant in enumerate(time):
        if abs(instant) > LATEST:
            text = f"got {instant}, takes a number from {-LATEST:g} to {LATEST:g} (s)"
            yield Mistake(f"time.{index}", text)
            return


def length_conflicts(
    key: str, values: tuple[Any, ...], time: tuple[float, ...]
) -> Iterator[Mistake]:
    """Yield what is wrong with the length of a list that goes with times."""
    if len(values) != len(time):
        has = counted(len(values), "entry", "entries")
        yield Mistake(key, f"has {has}, takes {len(time)}, as time has")


def span_conflicts(key: str, span: tuple[float, float]) -> Iterator[Mistake]:
    """Yield a part of the arm that is not within it, or has no length."""
    if not 0 <= span[0] < span[1] <= 1:
        yield Mistake(key, f"got {shown(span)}, takes [a, b] with 0 <= a < b <= 1")


def unit_vector(vector: tuple[float, ...]) -> tuple[float, ...]:
    """Return a vector with the same direction and a length of one."""
    # by a power of two, which rounds nothing: squares of very large or small numbers have no size
    _, power = math.frexp(max(map(abs, vector)))
    scaled = [math.ldexp(component, -power) for component in vector]
    length = math.hypot(*scaled)
    return tuple(component / length for component in scaled)


def direction_conflicts(key: str, vector: tuple[float, ...]) -> Iterator[Mistake]:
    """Yield a vector that has no direction."""
    if not any(vector):
        yield Mistake(key, f"got {shown(vector)}, takes a vector that is not 0")
