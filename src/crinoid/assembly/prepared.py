"""One case of a scenario, ready to be computed: every file read once, every part built once."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

from crinoid.scenario import MeasuredFlow, Mistake, Scenario, ScenarioError
from crinoid.scenario.errors import gathered
from crinoid.scenario.files import digests
from crinoid.scenario.library import Source, scenario_of

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from crinoid.assembly.parameters import Parameters
    from crinoid.assembly.parts import Parts
    from crinoid.dynamics import System
    from crinoid.recording import Recording, Series


class Prepared:
    """A scenario with what it is made from, each part read or built when it is first asked for.

    Every attribute and method raises `crinoid.ScenarioError` if a file that the scenario names is
    not what it takes.

    Parameters
    ----------
    source
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    parts
        Parts of a user's own, which no scenario describes.
    """

    def __init__(self, source: Source, parts: Parts | None = None) -> None:
        scenario = scenario_of(source)
        _require_text(scenario)  # a result holds it as text: better refused before a run than after
        self.scenario, self.parts = scenario, parts

    @cached_property
    def digests(self) -> dict[str, str]:
        """The SHA-256 digest of each file that the scenario names, as it is when first read."""
        return digests(self.scenario.to_dict())

    @cached_property
    def recordings(self) -> dict[int, Recording]:
        """The measured currents by their index in ``flow``."""
        measured = {
            index: flow
            for index, flow in enumerate(self.scenario.flow)
            if isinstance(flow, MeasuredFlow)
        }
        if not measured:
            return {}
        _ = self.digests
        from crinoid.recording import Stage, read_recording  # xarray, slow to load; few need it

        stage = Stage.of(self.scenario, self.series)
        found = gathered(
            {
                f"flow.{index}": lambda flow=flow: read_recording(flow, stage)
                for index, flow in measured.items()
            }
        )
        return dict(zip(measured, found.values(), strict=True))

    @cached_property
    def series(self) -> dict[str, Series]:
        """The series in the files of prescribed motions and of the target, by table."""
        scenario = self.scenario
        if scenario.target.file is None and all(m.kind != "file" for m in scenario.base.motion):
            return {}
        _ = self.digests
        from crinoid.recording import series_readers  # xarray, slow to load; few need it

        return gathered(series_readers(scenario))

    @property
    def count(self) -> int:
        """How many numbers its files hold."""
        series = [values for each in self.series.values() for values in (each.time, each.values)]
        records = [values for r in self.recordings.values() for values in (r.time, r.velocity)]
        return sum(values.size for values in (*series, *records))

    def notes(self) -> list[str]:
        """Return what a user should know of the files that were read, a sentence each."""
        read = {f"flow.{index}": recording for index, recording in self.recordings.items()}
        return [
            f"{key}: {note}" for key, found in (read | self.series).items() for note in found.notes
        ]

    @cached_property
    def parameters(self) -> Parameters:
        """The numbers of the scenario by name, as arrays."""
        from crinoid.assembly.parameters import Parameters  # JAX: slow to load, not for reading

        found = Parameters.of(self.scenario, self.recordings, self.series)
        if self.parts is None:
            return found
        return replace(found, actuator=(*found.actuator, *self.parts.actuators))

    @cached_property
    def system(self) -> System:
        """The arm, its base and the water as arrays: the differentiable core."""
        from crinoid.assembly.samples import check_steady  # JAX: slow to load, not for reading
        from crinoid.assembly.system import assemble_once

        system = assemble_once(self.parameters)
        if self.parts is not None:
            system = self.parts.added(system)
        for index, flow in enumerate(system.forces.water.flows):
            check_steady(flow, f"flow {index}", self.scenario)
        return system

    @cached_property
    def room(self) -> Float[np.ndarray, " m"]:
        """How far each obstacle is from the arm without load (m)."""
        from crinoid.assembly.room import find_room  # JAX: slow to load, not for reading

        return find_room(self.system)

    def check(self) -> None:
        """Refuse files that do not fit the scenario, and obstacles inside the arm."""
        self.notes()
        if self.scenario.obstacle:
            _ = self.room


def _require_text(scenario: Scenario) -> None:
    """Refuse a scenario that does not read back as it was from its own text."""
    try:
        again = Scenario.from_toml(scenario.to_toml().encode().decode())
        why = "" if again == scenario else "another scenario comes back"
    except (TypeError, ValueError) as error:  # of a table that a package brings, or of a character
        why = " ".join(str(error).split())
    if why:
        text = "got a scenario that TOML cannot hold; must read back as it was written"
        raise ScenarioError([Mistake("", f"{text} ({why})")])


def system(scenario: Source) -> System:
    """Assemble the arm, its base and the water of a scenario: the differentiable core.

    Raises
    ------
    ScenarioError
        If a file that the scenario names is not what it takes.
    """
    return Prepared(scenario).system


def parameters(scenario: Source) -> Parameters:
    """Return the numbers of a scenario by name: what `crinoid.assemble` makes a system of.

    Raises
    ------
    ScenarioError
        If a file that the scenario names is not what it takes.
    """
    return Prepared(scenario).parameters
