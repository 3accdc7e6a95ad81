"""Old names of modules, public names and attributes, for one minor release: each use warns."""

import importlib
import sys
import warnings
from collections.abc import Callable
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

REMOVED = "0.3.0"
"""Version that no longer has the old names."""
_MOVED = {
    "batch": "studies.batch",
    "chain": "numerics.banded",
    "comparison": "studies.comparison",
    "current": "analysis.current",
    "environment": "learning.environment",
    "export": "view.export",
    "frames": "numerics.frames",
    "identification": "inverse.identification",
    "live": "view.live",
    "metrics": "results.metrics",
    "notebook": "view.notebook",
    "onset": "numerics.ramp",
    "plausibility": "diagnostics.plausibility",
    "products": "numerics.small_matrices",
    "programs": "compilation",
    "record": "results.record",
    "reference": "rod.reference",
    "report": "view.figures",
    "result": "results.result",
    "signals": "results.record",
    "space": "foundation.axes",
    "spline": "numerics.piecewise",
    "status": "foundation.status",
    "sweep": "studies.sweep",
    "tuning": "inverse.tuning",
    "variables": "foundation.result_variables",
    "version": "foundation.version",
}


class _Alias(Loader):
    def __init__(self, name: str) -> None:
        self.name = name

    def exec_module(self, module: ModuleType) -> None:
        warn_of_old_name(module.__name__, self.name)
        sys.modules[module.__name__] = importlib.import_module(self.name)


class _Finder(MetaPathFinder):
    def find_spec(
        self, fullname: str, path: object, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        package, _, rest = fullname.partition(".")
        first, dot, inner = rest.partition(".")
        if package != "crinoid" or first not in _MOVED:
            return None
        return ModuleSpec(fullname, _Alias(f"crinoid.{_MOVED[first]}{dot}{inner}"))


def warn_of_old_name(old: str, new: str) -> None:
    """Warn of a name that a later release no longer has."""
    text = f"{old} is now {new}; crinoid {REMOVED} removes the old name"
    warnings.warn(text, DeprecationWarning, stacklevel=4)


def renamed(new: str) -> property:
    """Return an attribute under its old name, which warns."""

    def read(instance: object) -> Any:
        name = type(instance).__name__
        warn_of_old_name(f"an attribute of crinoid.{name}", f"crinoid.{name}.{new}")
        return getattr(instance, new)

    return property(read)


def renamed_names(module: str, names: dict[str, str]) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a module that offers old names of its members."""

    def read(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module {module!r} has no attribute {name!r}")
        warn_of_old_name(f"{module}.{name}", f"{module}.{names[name]}")
        return getattr(sys.modules[module], names[name])

    return read


def offer_old_names() -> None:
    """Let modules be imported under their old names too."""
    # first: parts of a folder that moved would otherwise be loaded twice
    sys.meta_path.insert(0, _Finder())
