"""Slave of an FMU: crinoid copies this file into each, where pythonfmu3 loads it.

The rest of crinoid does not import it. pythonfmu3 is next to it in the archive.
"""

import ctypes
import re
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

from pythonfmu3 import (
    DefaultExperiment,
    Dimension,
    Float64,
    Fmi3Causality,
    Fmi3Slave,
    Fmi3Status,
    Fmi3StepResult,
    Fmi3Variability,
    Int64,
    Unit,
)

_RADIANS = 0.017453292519943295
_BASE: dict[str, dict[str, int]] = {
    **{name: {name: 1} for name in ("m", "s", "kg", "rad")},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "Hz": {"s": -1},
    "degrees": {"rad": 1},
}
"""Exponents of SI base units by symbol."""


class ArmSlave(Fmi3Slave):
    """An arm as a slave of FMI 3.0."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        # not next to this module, which may be loaded from another copy of the archive
        here = Path(options["resources"])
        needed = (here / "requirements.txt").read_text().strip()
        try:
            from crinoid.foundation.version import __version__
            from crinoid.scenario import load
            from crinoid.simulation.co_simulation import CoSimulation
        except ImportError as error:
            raise self._lacking(needed, str(error)) from None
        if needed != f"crinoid=={__version__}":
            raise self._lacking(needed, f"it has {__version__}")
        scenario = load(here / "scenario.toml")
        self._arm = arm = CoSimulation(scenario)
        self.modelName, self.guid = (here / "identity.txt").read_text().split()
        self.author, self.version = "crinoid", __version__
        self.description = f"{scenario.title or self.modelName}. Needs Python with {needed}."
        self.default_experiment = DefaultExperiment(0.0, scenario.simulation.duration, arm.period)
        self.register_variable(
            Float64(
                "time",
                causality=Fmi3Causality.independent,
                variability=Fmi3Variability.continuous,
                description="time",
                unit=self._unit("s"),
                getter=lambda: arm.time,
            )
        )
        for causality in Fmi3Causality.input, Fmi3Causality.output, Fmi3Causality.parameter:
            for each in getattr(arm, f"{causality.name}s"):
                self._register(each, causality)

    def exit_initialization_mode(self) -> None:
        """Find the equilibrium and compile, with the parameters."""
        self._called(self._arm.start)

    def do_step(self, current_time: float, step_size: float) -> Fmi3StepResult:
        """Advance by a communication step; log the reason where that fails."""
        try:
            self._arm.advance(current_time, step_size)
        except Exception as error:
            self.log(" ".join(str(error).splitlines()), Fmi3Status.error)
            return Fmi3StepResult(Fmi3Status.error)
        return Fmi3StepResult()

    def to_xml(self, model_options: Any = None) -> Element:
        """Return the description of the model, with what pythonfmu3 has no words for."""
        root = super().to_xml(model_options or {})
        root.set("variableNamingConvention", "flat")  # keys of a scenario have indexes
        kind = root.find("CoSimulation")
        assert kind is not None
        kind.set("canHandleVariableCommunicationStepSize", "false")
        kind.set("fixedInternalStepSize", repr(self._arm.period))
        return root

    def _lacking(self, needed: str, reason: str) -> RuntimeError:
        where = f"Python {sys.version.split()[0]} of {sys.prefix}"
        return RuntimeError(f'the FMU needs {needed} in {where}: pip install "{needed}" ({reason})')

    def _called(self, method: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a method; an exception has one line."""
        try:
            return method(*arguments)
        except Exception as error:
            # the library drops its references at an exception, and again when the host frees it
            for each in (type(self), self, self.log_queue):
                ctypes.pythonapi.Py_IncRef(ctypes.py_object(each))
            raise RuntimeError("; ".join(str(error).splitlines())) from None

    def _register(self, variable: Any, causality: Fmi3Causality) -> None:
        name, arm = variable.name, self._arm
        about = {
            "causality": causality,
            "description": variable.meaning,
            "getter": lambda: self._called(arm.get, name),
        }
        if causality is not Fmi3Causality.output:
            about["setter"] = lambda value: self._called(arm.set, name, value)
        if causality is Fmi3Causality.parameter:
            about["variability"] = Fmi3Variability.fixed
        if isinstance(variable.start, int):
            self.register_variable(Int64(name, **about))
            return
        if variable.shape:
            about["getter"] = lambda: self._called(arm.get, name).ravel().tolist()
            about["dimensions"] = [Dimension(str(size)) for size in variable.shape]
        self.register_variable(Float64(name, unit=self._unit(variable.unit), **about))

    def _unit(self, text: str) -> str | None:
        """Return the unit's name, defined by SI base units; None without a known unit."""
        above, _, below = text.partition("/")
        base: Counter[str] = Counter()
        for sign, part in (1, above), (-1, below):
            for symbol, power in re.findall(r"([A-Za-z]+)(-?\d*)", part):
                if symbol not in _BASE:
                    return None
                for name, exponent in _BASE[symbol].items():
                    base[name] += sign * exponent * int(power or 1)
        if not base:
            return None
        factor = _RADIANS if "degrees" in text else 1.0
        self.register_units([Unit(text, factor=factor, **base)])
        return text
