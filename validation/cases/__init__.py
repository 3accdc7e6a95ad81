"""The validation cases: functions with the decorator `case`, in files of like cases."""

import pkgutil
from importlib import import_module

from validation.case import KINDS, Case


def all_cases() -> list[Case]:
    """Return every case, by kind and name."""
    modules = [import_module(f"{__name__}.{each.name}") for each in pkgutil.iter_modules(__path__)]
    found = [each for module in modules for each in vars(module).values() if type(each) is Case]
    return sorted(found, key=lambda case: (KINDS.index(case.kind), case.name))
