"""Real numbers of a scenario, by their keys."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from crinoid.scenario.document import value_at
from crinoid.scenario.errors import join
from crinoid.scenario.model import Model, properties_of
from crinoid.scenario.quantity import unit_of
from crinoid.scenario.scenario import Scenario

_MOST = 3  # entries of a list whose numbers have keys: components of a vector, but not a path


class RealNumber(NamedTuple):
    """A real number of a scenario."""

    key: str  # dotted key with indexes, as in ``--set``
    value: float  # value, in the unit
    unit: str  # unit, as in the schema of a scenario; empty without one
    meaning: str  # description of its key


def real_numbers(scenario: Scenario) -> Iterator[RealNumber]:
    """Yield the real numbers of a scenario, with those in lists of up to three entries."""
    document = scenario.to_dict()  # without keys of the other dimension
    for number in _of_table(scenario, ""):
        if isinstance(value_at(document, number.key), float):
            yield number


def _of_table(table: Model, prefix: str) -> Iterator[RealNumber]:
    schemas = properties_of(type(table))
    for name, field in type(table).model_fields.items():
        alias = field.alias or name
        schema = schemas.get(alias, {})
        about = unit_of(schema), " ".join(field.description.split()) if field.description else ""
        yield from _of_value(getattr(table, name), join(prefix, alias), *about)


def _of_value(value: Any, key: str, unit: str, meaning: str) -> Iterator[RealNumber]:
    if isinstance(value, Model):
        yield from _of_table(value, key)
    elif isinstance(value, float):
        yield RealNumber(key, value, unit, meaning)
    elif isinstance(value, tuple):
        tables = any(isinstance(each, Model) for each in value)
        for index, each in enumerate(value if tables or len(value) <= _MOST else ()):
            yield from _of_value(each, f"{key}.{index}", unit, meaning)
