"""Random scenarios, drawn from the tables of `crinoid.scenario` themselves.

A new key needs nothing here: its type, its bounds and its marks say what may be drawn. What goes
together is not known here. The line of a refusal names the key at fault, and that key is drawn
again, left out or added, until the scenario is accepted.
"""

from __future__ import annotations

import math
import random
import re
from collections.abc import Iterator
from contextlib import suppress
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types as bounds
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from crinoid.foundation.axes import CHANNELS
from crinoid.foundation.result_variables import large_names
from crinoid.scenario import Scenario, ScenarioError
from crinoid.scenario.control import KINDS
from crinoid.scenario.document import assign
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Count, Only, Quantity

Table = dict[str, Any]

_TRIES = 400
_DOTTED = re.compile(r"\b[a-z]\w+(?:\.\w+)+")
"""A key in the text of a refusal, such as the one that is to be given as well."""
_FULL = (0.1, 0.3, 0.6)
"""Shares of the keys with a default that are given."""
_WORDS = {
    "kind": (*KINDS, *["hybrid"] * 4),  # few scenarios suit it
    "inputs": (*CHANNELS[3], "chamber_0", "tendon_0"),
    "variables": large_names(3, without=["vortices", "estimate", "self", "hull"]),
}
"""What keys take that take text by their name; others take any text."""
_TEXTS = ("u", "-v", "vel[E]", "a_1", 'quoted "\\"', "two\nlines\t", "\x00\x7f", "ä€😀", "#")


class Draw:
    """Draws of a random scenario."""

    def __init__(self, source: random.Random) -> None:
        self.source = source
        self.full = source.choice(_FULL)
        self.dimension = source.choice((2, 3))

    def scenario(self) -> Scenario | None:
        """Return a scenario that is accepted; None where no way to one is found."""
        tables = self.table(Scenario)
        for _ in range(_TRIES):
            tables.setdefault("arm", {})["dimension"] = self.dimension
            try:
                scenario = Scenario.from_dict(tables)
            except ScenarioError as error:
                for mistake in reversed(error.mistakes):
                    named = _DOTTED.findall(mistake.text) if self.source.random() < 0.3 else []
                    with suppress(LookupError, ScenarioError):  # a list may be shorter by now
                        self.mend(tables, self.source.choice(named or [mistake.key]))
            else:
                return self.varied(scenario, tables)
        return None

    def varied(self, scenario: Scenario, tables: Table) -> Scenario:
        """Return the scenario, or now and then a study of it: two values of one of its keys."""
        keys = [key for key in _leaves(tables) if not key.startswith("vary")]
        if not keys or self.source.random() > 0.3:
            return scenario
        key = self.source.choice(keys)
        holder, name = _holder(tables, key)
        other = self.key(_model(tables, key), name)
        values = [holder[name], *([] if other is None else [other])]
        try:
            return Scenario.from_dict({**tables, "vary": {key: values}})
        except ScenarioError:
            return scenario

    def mend(self, tables: Table, key: str) -> None:
        """Change the key that a refusal names, or the list or the table that holds it."""
        if key == "arm.dimension":
            self.dimension = 5 - self.dimension
            return
        if self.source.random() < 0.1:  # what it is refused for may lie elsewhere
            key = self.source.choice([*_leaves(tables), key])
        parts = key.split(".")
        while len(parts) > 1 and self.source.random() < 0.05:
            parts.pop()
        holder, name = _holder(tables, ".".join(parts))
        while isinstance(holder, list) and not isinstance(holder[int(name)], dict):
            parts.pop()  # a list of numbers or words is one value
            holder, name = _holder(tables, ".".join(parts))
        if isinstance(holder, list):
            del holder[int(name)]
        elif holder is not None and name in holder and self.source.random() < 0.5:
            del holder[name]
        else:
            model = _model(tables, ".".join(parts))
            value = None if model is None else self.key(model, name)
            if value is not None:
                assign(tables, ".".join(parts), value)

    def table(self, model: type[Model]) -> Table:
        """Return a table with some of its keys."""
        found: Table = {}
        for name, field in model.model_fields.items():
            key = field.alias or name
            needed = field.is_required() or key == "kind"
            share = max(self.full, 0.5) if _tables(field.annotation) else self.full
            if key == "vary" or not (needed or self.source.random() < share):
                continue
            value = self.key(model, key)
            if value is not None:
                found[key] = value
        if "__pydantic_extra__" in model.__annotations__ and self.source.random() < self.full:
            for extra in ("chamber_0", "tendon_0"):
                found[extra] = self.key(model, extra)
        return found

    def key(self, model: type[Model], key: str) -> Any:
        """Return a value for a key of a table; None where it takes none."""
        fields = {field.alias or name: field for name, field in model.model_fields.items()}
        field = fields.get(key)
        if field is None:  # of a table that takes names of its own, all with the same table
            field = next((each for each in fields.values() if _tables(each.annotation)), None)
        if field is None:
            return None
        if key == "dimension":
            return self.dimension
        marks = [*field.metadata]
        if any(isinstance(mark, Only) and mark.dimension != self.dimension for mark in marks):
            return None
        default = field.default if isinstance(field.default, float) else None
        return self.value(field.annotation, marks, key, default)

    def value(self, kind: Any, marks: list[Any], key: str, default: float | None) -> Any:
        """Return a value of a type with its marks; None where there is none."""
        origin, inner = get_origin(kind), get_args(kind)
        if origin is Annotated:
            below = [mark for each in inner[1:] for mark in _marks_of(each)]
            return self.value(inner[0], [*marks, *below], key, default)
        if origin in (Union, UnionType):
            return self.union(inner, marks, key, default)
        if origin is Literal:
            return self.source.choice(inner)
        if origin is dict:
            return {text: self.number([], "") for text in self.source.sample(_TEXTS, 2)}
        if origin is tuple:
            return self.list(inner, marks, key, default)
        if kind is bool:
            return self.source.random() < 0.5
        if kind is int:
            low, high = _limits(marks)
            return self.source.randint(int(low if low > -math.inf else 0), int(min(high, 2**62)))
        if kind is float:
            return self.number(marks, key, default)
        if kind is str:
            return self.text(marks, key)
        return self.table(kind)

    def union(self, inner: tuple[Any, ...], marks: list[Any], key: str, default: Any) -> Any:
        """Return a value of one of the types, with as many numbers as the dimension asks for."""
        counts = self.counts(marks)
        choices = [each for each in inner if each is not NoneType]
        if counts and 1 not in counts:
            choices = [each for each in choices if each is not float]
        if counts == (1,):
            choices = [each for each in choices if not _is_list(each)]
        return self.value(self.source.choice(choices), marks, key, default)

    def list(self, inner: tuple[Any, ...], marks: list[Any], key: str, default: Any) -> Any:
        """Return a list of values; of instants an increasing one."""
        item = inner[0]
        if any(_kind_of(table) is PydanticUndefined for table in _tables(item)):
            return None  # only packages bring its kinds
        sizes = [mark for mark in marks if isinstance(mark, bounds.MinLen | bounds.MaxLen)]
        low = max((m.min_length for m in sizes if isinstance(m, bounds.MinLen)), default=0)
        high = min((m.max_length for m in sizes if isinstance(m, bounds.MaxLen)), default=3)
        counts = tuple(count for count in self.counts(marks) if count > 1)
        nested = _is_list(item)
        if inner[-1] is not ...:
            size = len(inner)
        elif counts and not nested:
            size = self.source.choice(counts)
        else:
            size = self.source.randint(max(low, 1), max(min(high, 3), low, 1))
        kept = [mark for mark in marks if nested or not isinstance(mark, Count)]
        kept = [mark for mark in kept if not isinstance(mark, bounds.MinLen | bounds.MaxLen)]
        found = [self.value(item, kept, key, default) for _ in range(size)]
        sort = key == "time" or (key in ("span", "touch_span", "range", "range_deg"))
        return sorted(found) if sort else found

    def counts(self, marks: list[Any]) -> tuple[int, ...]:
        """Return how many numbers a key takes in this dimension; nothing where none are said."""
        found = next((mark for mark in marks if isinstance(mark, Count)), None)
        return () if found is None else (found.space if self.dimension == 3 else found.plane)

    def number(self, marks: list[Any], key: str, default: float | None = None) -> float:
        """Return a number within its bounds: a round one, one of a usual size, or any at all."""
        source, (low, high) = self.source, _limits(marks)
        unit = next((mark.unit for mark in marks if isinstance(mark, Quantity)), "")
        if key in ("span", "touch_span"):
            low, high = 0.0, 1.0
        size = abs(default or 0.0) or 1.0
        sign = -1 if low < 0 and source.random() < 0.2 else 1
        way = source.random()
        if key == "time":
            value = source.choice((-1.0, 0.0, 0.1, 2.0, 30.0))
        elif unit == "degrees" and way < 0.6:
            value = source.choice((0.0, 90.0, 180.0, -90.0, 45.0))
        elif way < 0.9:
            value = sign * size * 2 ** source.uniform(-1.5, 1.5)
        elif way < 0.95:
            value = float(source.choice((0, 1, -1, 10)))
        else:
            value = sign * source.uniform(1, 10) * 10.0 ** source.randint(-300, 300)
        value = min(max(value, low), high)
        outside = {bounds.Gt: low, bounds.Lt: high}
        if any(value == outside.get(type(mark)) for mark in marks):
            value = (low + high) / 2 if math.isfinite(low + high) else low + size
        return value

    def text(self, marks: list[Any], key: str) -> Any:
        """Return text: one of the words that a key takes, a name, or anything."""
        if key in _WORDS:
            return self.source.choice(_WORDS[key])
        if any(getattr(mark, "pattern", None) for mark in marks):
            return self.source.choice(("a", "b_2", "arm", "lower", "x9"))
        return self.source.choice(_TEXTS)


def drawn(source: random.Random) -> Scenario | None:
    """Return any random scenario that is accepted; None where no way to one is found."""
    return Draw(source).scenario()


def kinds(model: type[Model] = Scenario, prefix: str = "") -> set[str]:
    """Return every kind and every choice of words that the tables offer, such as flow.waves."""
    found = set()
    for name, field in model.model_fields.items():
        tables, key = _tables(field.annotation), f"{prefix}{name}"
        for table in tables:
            kind = _kind_of(table)
            own = f"{key}." if kind is None else f"{key}.{kind}."
            found |= {own[:-1]} | kinds(table, own)
        words = (field.annotation, *get_args(field.annotation))
        for each in words if name != "kind" else ():
            if get_origin(each) is Literal:
                found |= {f"{key} {word}" for word in get_args(each)}
    found |= {f"{prefix}kind {kind}" for kind in KINDS} if prefix == "control." else set()
    return {each for each in found if "PydanticUndefined" not in each}


def traits(table: Model, prefix: str = "") -> Iterator[str]:
    """Yield those of `kinds` that a scenario holds."""
    for name, value in table:
        key = f"{prefix}{name}"
        for each in value if isinstance(value, tuple) else (value,):
            if isinstance(each, Model):
                own = key if _kind_of(type(each)) is None else f"{key}.{each.kind}"
                yield own
                yield from traits(each, f"{own}.")
            elif name != "kind" or prefix == "control.":
                yield f"{key} {each}"


def _marks_of(mark: Any) -> list[Any]:
    return list(mark.metadata) if isinstance(mark, FieldInfo) else [mark]


def _limits(marks: list[Any]) -> tuple[float, float]:
    low, high = -math.inf, math.inf
    for mark in marks:
        low = max(low, getattr(mark, "ge", low), getattr(mark, "gt", low))
        high = min(high, getattr(mark, "le", high), getattr(mark, "lt", high))
    return low, high


def _bare(kind: Any) -> Any:
    return _bare(get_args(kind)[0]) if get_origin(kind) is Annotated else kind


def _is_list(kind: Any) -> bool:
    return get_origin(_bare(kind)) is tuple


def _tables(kind: Any) -> tuple[type[Model], ...]:
    """Return the tables that a type stands for, those in a list as well."""
    kind = _bare(kind)
    if isinstance(kind, type) and issubclass(kind, Model):
        return (kind,)
    return tuple(table for each in get_args(kind) for table in _tables(each))


def _kind_of(kind: Any) -> object:
    """Return the kind of a table that is told apart by it; None of any other type."""
    field = getattr(_bare(kind), "model_fields", {}).get("kind")
    told = field is not None and (field.is_required() or get_origin(field.annotation) is Literal)
    return field.default if told else None


def _holder(tables: Table, key: str) -> tuple[Any, str]:
    """Return the table or list that holds a dotted key, None where it is not there; and its end."""
    *outer, last = key.split(".")
    found: Any = tables
    for part in outer:
        found = found[int(part)] if isinstance(found, list) else (found or {}).get(part)
    return found, last


def _model(tables: Table, key: str) -> type[Model] | None:
    """Return the class of the table that holds a dotted key; None where no table does."""
    choices: tuple[type[Model], ...] = (Scenario,)
    found: Any = tables
    for part in key.split(".")[:-1]:
        if isinstance(found, list):
            found = found[int(part)]
            choices = tuple(c for c in choices if _kind_of(c) in (None, found.get("kind")))
            continue
        if not choices:
            return None
        fields = {field.alias or name: field for name, field in choices[0].model_fields.items()}
        field = fields.get(part) or next(iter(fields.values()))
        found, choices = (found or {}).get(part), _tables(field.annotation)
    return choices[0] if choices and not isinstance(found, list) else None


def _leaves(tables: Table, prefix: str = "") -> Iterator[str]:
    for name, value in tables.items():
        key = f"{prefix}{name}"
        if isinstance(value, dict):
            yield from _leaves(value, f"{key}.")
        else:
            yield key
