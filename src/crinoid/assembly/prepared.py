"""One case of a scenario with its files and parts: each is read or built once."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

from crinoid.scenario import MeasuredFlow, Mesh, Scenario, Seabed
from crinoid.scenario.base_motion import InFile, ResponseMotion
from crinoid.scenario.document import digests
from crinoid.scenario.errors import gathered, refusal
from crinoid.scenario.library import Source, scenario_of
from crinoid.scenario.waves import WavesFlow

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Array, Float

    from crinoid.assembly.facts import Facts
    from crinoid.assembly.parameters import Parameters
    from crinoid.assembly.plan import Parts
    from crinoid.control import Sensor, Target
    from crinoid.dynamics import System
    from crinoid.recording import Recording, Sea, SolidSurface


class Prepared:
    """A scenario with its files and parts, each read or built at its first use.

    Every attribute and method raises `crinoid.ScenarioError` if a file of the scenario does not
    fit its key.

    Parameters
    ----------
    source
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.
    parts
        Parts of a user's own, which no scenario describes.
    """

    def __init__(self, source: Source, parts: Parts | None = None) -> None:
        self.scenario, self.parts = scenario_of(source), parts
        _require_text(self.scenario)  # as in a result: better refused before a run than after

    @staticmethod
    def with_parts(source: Source, parts: Parts) -> Prepared:
        """Return a scenario with parts; its ``control.kind`` is "custom" where one controls it."""
        scenario = scenario_of(source)
        require_one_case(scenario)
        if parts.controller is not None:
            scenario = scenario.with_values({"control.kind": "custom"})
        return Prepared(scenario, parts)

    def with_scenario(self, scenario: Scenario) -> Prepared:
        """Return another scenario with the same files, which are not read again."""
        other, before = Prepared(scenario, self.parts), self.scenario
        # the grid of a mesh depends on what touches it, the drawn part of a bed on the base
        solid = [
            (each.arm, each.tool, each.base.position, each.obstacle) for each in (before, scenario)
        ]
        names = ["digests", "recordings", "seas", "series"]
        names += ["surfaces"] if solid[0] == solid[1] else []
        vars(other).update({name: vars(self)[name] for name in names if name in vars(self)})
        return other

    @cached_property
    def digests(self) -> dict[str, str]:
        """SHA-256 digest of each file of the scenario, at its first reading."""
        return digests(self.scenario.to_dict())

    @cached_property
    def recordings(self) -> dict[int, Recording]:
        """The measured currents by their index in ``flow``."""
        flows = enumerate(self.scenario.flow)
        measured = {index: flow for index, flow in flows if isinstance(flow, MeasuredFlow)}
        if not measured:
            return {}
        _ = self.digests
        from crinoid.recording import read_recording  # xarray, slow to load

        others = (self.scenario, self.series)
        readers = {f"flow.{i}": partial(read_recording, e, *others) for i, e in measured.items()}
        return dict(zip(measured, gathered(readers).values(), strict=True))

    @cached_property
    def seas(self) -> dict[int, Sea]:
        """The surface waves in files by their index in ``flow``."""
        flows = enumerate(self.scenario.flow)
        waves = {i: e for i, e in flows if isinstance(e, WavesFlow) and e.state is None}
        if not waves:
            return {}
        _ = self.digests
        from crinoid.recording import read_sea  # xarray, slow to load; few need it

        duration = self.scenario.simulation.duration
        readers = {f"flow.{i}": partial(read_sea, flow, duration) for i, flow in waves.items()}
        return dict(zip(waves, gathered(readers).values(), strict=True))

    @cached_property
    def series(self) -> dict[str, Any]:
        """The series, or RAOs, in the files of prescribed motions and of the target, by table."""
        scenario = self.scenario
        in_file = any(
            isinstance(motion, InFile | ResponseMotion) for motion in scenario.base.motion
        )
        if scenario.target.file is None and not in_file:
            return {}
        _ = self.digests
        from crinoid.recording import series_readers  # xarray, slow to load; few need it

        return gathered(series_readers(scenario))

    @cached_property
    def surfaces(self) -> dict[str, SolidSurface]:
        """The solids in the files of obstacles, by table."""
        if not any(isinstance(each, Mesh | Seabed) for each in self.scenario.obstacle):
            return {}
        _ = self.digests
        from crinoid.recording import surface_readers  # xarray, slow to load; few need it

        return gathered(surface_readers(self.scenario))

    @property
    def count(self) -> int:
        """Number of numbers in its files."""
        series = [each for read in self.series.values() for each in vars(read).values()]
        records = [values for r in self.recordings.values() for values in (r.time, r.velocity)]
        grids = [each.spline.coefficients for each in self.surfaces.values()]
        seas = [values for each in self.seas.values() for values in each.given.values()]
        return sum(getattr(each, "size", 0) for each in (*series, *records, *grids, *seas))

    def notes(self) -> list[str]:
        """Return notes on the files of the scenario, a sentence each."""
        read = {f"flow.{index}": each for index, each in (self.recordings | self.seas).items()}
        notes = [
            f"{key}: {note}"
            for key, found in (read | self.series | self.surfaces).items()
            for note in found.notes
        ]
        if vessels := {key: each for key, each in self.series.items() if hasattr(each, "beyond")}:
            from crinoid.assembly.response import waves_of  # JAX: slow to load; few need it

            notes += [
                f"{key}: flow.{index}: {note}"
                for index, flow in waves_of(self.parameters.flow)
                for key, vessel in vessels.items()
                if (note := vessel.beyond(flow))
            ]
        return notes

    @cached_property
    def parameters(self) -> Parameters:
        """The numbers of the scenario by name, as arrays."""
        from crinoid.assembly.parameters import Parameters  # JAX: slow to load, not for reading

        flows = self.recordings | self.seas
        found = Parameters.of(self.scenario, flows, self.series, self.surfaces)
        if self.parts is None:
            return found
        return replace(found, actuator=(*found.actuator, *self.parts.actuators))

    @cached_property
    def system(self) -> System:
        """The arm, its base and the water as arrays: the differentiable core."""
        # JAX: slow to load, not for reading
        from crinoid.assembly.system import assemble_once, check_steady
        from crinoid.compilation import about

        space = self.scenario.arm.dimension == 3
        about(f"the arm in {'space' if space else 'the plane'}")
        system = assemble_once(self.parameters)
        if self.parts is not None:
            system = self.parts.added(system)
        for index, flow in enumerate(system.forces.water.flows):
            check_steady(flow, f"flow {index}", self.scenario)
        return system

    @cached_property
    def sensors(self) -> tuple[Sensor, ...]:
        """The sensors, that of the tip first."""
        from crinoid.assembly.control_loop import build_sensors  # JAX: slow to load

        own = () if self.parts is None else self.parts.sensors
        return (*build_sensors(self.scenario), *own)

    def target(self, tip: Float[Array, " pose"]) -> Target:
        """Return the target, for an arm whose tip has the pose ``tip`` at t = 0."""
        from crinoid.assembly.control_loop import build_target  # JAX: slow to load

        return build_target(self.scenario, self.series.get("target"), self.system, tip)

    @cached_property
    def facts(self) -> Facts:
        """Quantities that follow from the scenario without a run."""
        from crinoid.assembly.facts import Facts

        return Facts(self)

    @cached_property
    def room(self) -> Float[np.ndarray, " m"]:
        """Distance of each obstacle from the arm without load (m)."""
        from crinoid.assembly.system import clearance  # JAX: slow to load, not for reading

        return clearance(self.system)

    def check(self) -> None:
        """Refuse several cases, files that do not fit, and obstacles inside the arm."""
        require_one_case(self.scenario)
        self.notes()
        if self.scenario.obstacle:
            _ = self.room
        if self.scenario.contact.self_:
            from crinoid.assembly.system import check_far_clearances

            check_far_clearances(self.system)


def require_one_case(scenario: Scenario) -> None:
    """Refuse a scenario with several cases."""
    if scenario.vary:
        raise ValueError("a scenario with [vary] describes several cases; run scenario.cases()")


def at_rest(scenario: Scenario) -> Scenario:
    """Return the scenario of the result of `equilibrium`."""
    # of one instant all are saved
    still = {"simulation.start": "equilibrium", "output.variables": None}
    return scenario.with_values(scenario.idle_values | still)


def _require_text(scenario: Scenario) -> None:
    """Refuse a scenario that does not read back as it was from its own text."""
    try:
        again = Scenario.from_toml(scenario.to_toml().encode().decode())
        why = "" if again == scenario else "another scenario comes back"
    except (TypeError, ValueError) as error:  # of a table that a package brings, or of a character
        why = " ".join(str(error).split())
    if why:
        text = "got a scenario that TOML cannot hold; must read back as it was written"
        raise refusal("", f"{text} ({why})")


def system(scenario: Source) -> System:
    """Assemble the arm, its base and the water of a scenario: the differentiable core.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.

    Returns
    -------
    System

    Raises
    ------
    ScenarioError
        If a file of the scenario does not fit its key.

    Examples
    --------
    >>> system = crinoid.system("still-water")
    >>> system.tip(system.rest()).round(3).tolist()  # x, z (m), angle (rad)
    [0.5, -10.0, 0.0]
    """
    return Prepared(scenario).system


def parameters(scenario: Source) -> Parameters:
    """Return the numbers of a scenario by name: what `crinoid.assemble` makes a system of.

    Parameters
    ----------
    scenario : Scenario, str or path
        One case (`crinoid.Scenario.cases`), the name of a built-in scenario, or a file.

    Returns
    -------
    crinoid.assembly.parameters.Parameters
        Arrays in SI units and rad, a pytree.

    Raises
    ------
    ScenarioError
        If a file of the scenario does not fit its key.

    Examples
    --------
    >>> numbers = crinoid.parameters("still-water")
    >>> float(numbers.arm.youngs_modulus), float(numbers.water.density)  # Pa, kg/m3
    (500000.0, 1025.0)
    """
    return Prepared(scenario).parameters
