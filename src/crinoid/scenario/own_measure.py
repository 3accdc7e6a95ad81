"""Measures from installed packages, which a scenario names as ``module:function``."""

import importlib
import math
import sys
import threading
from collections.abc import Callable, Iterable
from numbers import Real
from pathlib import Path
from pkgutil import resolve_name
from typing import Any, NamedTuple

from crinoid.scenario.errors import gathered, got, refusal

_KEY = "output.measures"
_SEARCH = threading.Lock()  # of the path, which threads share


class OwnMeasure(NamedTuple):
    """Measure of a run from an installed package: a function of the dataset of its result."""

    key: str  # its place in the scenario
    name: str  # name of the function, which is that of the measure in tables and files
    unit: str  # its attribute ``units``; "1" without it
    meaning: str  # its attribute ``long_name``, or the first line of its docstring
    function: Callable[[Any], Any]

    def of(self, data: Any) -> float | None:
        """Return the number of a run; None where the function returns None.

        A `ScenarioError` names a function that fails, or returns anything else than a finite
        number.
        """
        try:
            found = self.function(data)
            if found is None:
                return None
            plain = found.item() if getattr(found, "ndim", None) == 0 else found
        except Exception as error:  # any fault of the package
            why = " ".join(f"{type(error).__name__}: {error}".split())
            raise refusal(self.key, f"{self.name} of the run failed: {why}") from error
        if isinstance(plain, bool) or not isinstance(plain, Real) or not math.isfinite(plain):
            shape = getattr(found, "shape", ())
            what = f"an array of shape {shape}" if shape else " ".join(repr(plain).split())[:60]
            text = f"{self.name} of the run returned {what}"
            raise refusal(self.key, text, "return a finite number, or None")
        return float(plain)


def own_measures(names: Iterable[str], known: Iterable[str]) -> dict[str, OwnMeasure]:
    """Return measures by name, of functions that are named as ``module:function``.

    Their modules are imported here. A `ScenarioError` names each that is in no installed package,
    or that has the name of another measure: one of these, or one that is ``known``.
    """
    read = {f"{_KEY}.{n}": name for n, name in enumerate(names)}
    found = gathered({key: lambda k=key, n=name: _measure(k, n) for key, name in read.items()})
    measures = dict.fromkeys(known, "")
    for key, each in found.items():
        if each.name in measures:
            raise refusal(key, got(read[key], "name a function whose name no other measure has"))
        measures[each.name] = key
    return {each.name: each for each in found.values()}


def _measure(key: str, name: str) -> OwnMeasure:
    module = name.partition(":")[0]
    try:
        _require_installed(module.partition(".")[0])
        function = resolve_name(name)
        if not callable(function):
            raise TypeError(f"{name} is no function")
        label = function.__name__
        summary = (function.__doc__ or "").strip().partition("\n")[0].rstrip(".")
        unit = getattr(function, "units", "1")
        meaning = getattr(function, "long_name", summary) or label
        if not (isinstance(unit, str) and isinstance(meaning, str)):
            raise TypeError("its attributes units and long_name must be texts")
    except Exception as error:  # any fault of the package
        why = " ".join(f"{type(error).__name__}: {error}".split())
        must = "be a function of an installed package, as in mypackage.measures:reach"
        raise refusal("", got(name, must, f"{why}.")) from error
    return OwnMeasure(key, label, unit, meaning, function)


def _require_installed(package: str) -> None:
    """Raise ImportError for a package of Python itself, or in the working directory alone."""
    if package in sys.stdlib_module_names:
        raise ImportError(f"{package} is a part of Python")
    with _SEARCH:
        # `python -m` and notebooks put the working directory first
        first, *others = sys.path
        here = Path(first or ".").resolve() == Path.cwd()
        path, sys.path = sys.path, others if here else [first, *others]
        try:
            importlib.invalidate_caches()
            found = any(finder.find_spec(package, None) for finder in sys.meta_path)
        finally:
            sys.path = path
    if not found:
        raise ModuleNotFoundError(f"no installed package is named {package!r}")
