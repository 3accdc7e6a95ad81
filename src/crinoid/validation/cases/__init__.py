"""The validation cases, one a file: each has a `CASE`."""

import pkgutil
from importlib import import_module

from crinoid.validation.case import KINDS, Case


def all_cases() -> list[Case]:
    """Return every case, by kind and name."""
    modules = [f"{__name__}.{each.name}" for each in pkgutil.iter_modules(__path__)]
    found: list[Case] = [import_module(module).CASE for module in modules]
    return sorted(found, key=lambda case: (KINDS.index(case.kind), case.name))
