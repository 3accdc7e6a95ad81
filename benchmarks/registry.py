"""The benchmarks, in the order of their run."""

from types import ModuleType

from benchmarks import batch, controllers, gradient, optimise, precision, start, step, tasks

_ALL = (precision, step, batch, gradient, optimise, start, controllers, tasks)
BENCHMARKS: dict[str, ModuleType] = {each.__name__.rpartition(".")[2]: each for each in _ALL}
"""Modules by name; each has `benchmark`, which yields its rows."""


def title(name: str) -> str:
    """Return what a benchmark measures, in a line."""
    return str(BENCHMARKS[name].__doc__).splitlines()[0].rstrip(".")
