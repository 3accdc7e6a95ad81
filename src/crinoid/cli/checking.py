"""Mistakes in one of many cases, told with the values of that case."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from crinoid.scenario import Mistake, ScenarioError, shown


@contextmanager
def of_case(key: str, values: Mapping[str, Any]) -> Iterator[None]:
    """Say of mistakes in which case they are, and by which key the case came to be."""
    try:
        yield
    except ScenarioError as error:
        told = ", ".join(f"{name} = {shown(value)}" for name, value in values.items())
        mistakes = [Mistake(key, f"case {told}: {mistake}") for mistake in error.mistakes]
        raise ScenarioError(mistakes) from error
