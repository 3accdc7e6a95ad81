"""Numbers by name, and arrays, which the builders hand over."""

import dataclasses
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from crinoid.scenario.model import Model

Numbers = dict[str, Any]
_Group = TypeVar("_Group", bound=eqx.Module)


def array(value: object) -> Array:
    """Return an array of floats, for which nothing need be compiled."""
    return jax.device_put(np.asarray(value, float))


def from_table(group: type[_Group], table: Model, **others: Any) -> _Group:
    """Fill a group of numbers: each field is the array of the table's key of the same name.

    A key without a value stays None. ``others`` are fields that are no plain numbers of the table.
    """
    keys = [field.name for field in dataclasses.fields(group) if field.name not in others]
    given = {key: getattr(table, key) for key in keys}
    arrays = {key: None if value is None else array(value) for key, value in given.items()}
    return group(**arrays, **others)
