"""Scenario: all tables together, to and from TOML."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from itertools import combinations
from math import prod
from typing import Any

import tomli_w

from crinoid.foundation.representation import Represented
from crinoid.scenario.actuator import Actuator, Chamber, Tendon, keyed_threads, thread_name
from crinoid.scenario.arm import Arm
from crinoid.scenario.base import Base
from crinoid.scenario.base_motion import VelocityMotion
from crinoid.scenario.consistency import RULES
from crinoid.scenario.contact import SelfContact
from crinoid.scenario.control import Control
from crinoid.scenario.document import assign, parse, without_empty
from crinoid.scenario.errors import Mistake, ScenarioError, refusal
from crinoid.scenario.flow import Flow
from crinoid.scenario.kinds import with_places
from crinoid.scenario.load import Load
from crinoid.scenario.model import Model, entry
from crinoid.scenario.obstacle import Obstacle
from crinoid.scenario.quantity import ListOf, dimension_conflicts, dimension_defaults, unwritten
from crinoid.scenario.representation import represent
from crinoid.scenario.sensor import Sensor, Sensors
from crinoid.scenario.simulation import Output, Simulation
from crinoid.scenario.target import Target
from crinoid.scenario.tool import Tool
from crinoid.scenario.variation import Levels, Variations, case_words, combination
from crinoid.scenario.vehicle import Hull, Vehicle
from crinoid.scenario.water import Water

_DEFAULT_RATE_HZ = 100.0
_DEFAULT_INTERVAL = 0.02
_MAX_CASES = 10_000
AT_REST = (
    *("arm", "base", "water", "flow", "load"),
    *("tool", "chamber", "tendon", "obstacle", "contact"),
)
"""Tables that an equilibrium depends on."""
_DIMENSION = {"arm", "arm.dimension"}  # keys that set the dimension


class Scenario(Represented, Model):
    """Description of an arm, the water around it, the loads on it and its target.

    Parameters
    ----------
    title : str
        Subject of the scenario.
    seed : int
        Seed of everything random.
    arm, base, vehicle, water, contact, tool, target, sensor, control, simulation, output : dict
        Tables of the TOML file, each as a dictionary or as its class. All may be left out.
    flow, load, obstacle, chamber, tendon, actuator, sensors : list of dict
        Lists of such tables.
    vary : dict of list
        Values by dotted key; every combination is a case.

    Raises
    ------
    ScenarioError
        If anything is wrong, with one line per mistake.

    Examples
    --------
    >>> scenario = crinoid.Scenario(arm={"length": 0.6}, simulation={"duration": 2.0})
    >>> scenario.arm.length, scenario.water.density
    (0.6, 1025.0)
    >>> scenario.with_values({"water.density": 1000.0}).water.density
    1000.0
    """

    title: str = entry("", "Subject of the scenario.")
    seed: int = entry(0, "Seed of everything random.", ge=0, lt=2**63)
    arm: Arm = entry(Arm(), "The arm.")
    base: Base = entry(Base(), "The base of the arm.")
    vehicle: Vehicle | None = entry(None, "The submarine, if it floats or the arm can touch it.")
    water: Water = entry(Water(), "The water.")
    flow: ListOf[Flow] = entry((), "How the water moves; flows add up.")
    load: ListOf[Load] = entry((), "Other forces on the arm.")
    obstacle: ListOf[Obstacle] = entry((), "Rigid bodies that the arm meets.")
    contact: SelfContact = entry(SelfContact(), "Contact of the arm with itself.")
    tool: Tool | None = entry(None, "Body at the tip.")
    chamber: ListOf[Chamber] = entry((), "Chambers of fluid along the arm.")
    tendon: ListOf[Tendon] = entry((), "Tendons along the arm.")
    actuator: ListOf[Actuator] = entry((), "Further actuators.")
    target: Target = entry(Target(), "Target of the tip.")
    sensor: Sensor = entry(Sensor(), "Sensor of the tip.")
    sensors: ListOf[Sensors] = entry((), "Further sensors, for controllers.")
    control: Control = entry(Control(), "The controller.")
    simulation: Simulation = entry(Simulation(), "Time, time steps and solver.")
    output: Output = entry(Output(), "Saved instants and variables.")
    vary: Variations = entry(
        {}, "Dotted keys, each with a list of values; every combination is a case."
    )

    # Only the scenario knows the dimension, and so the words of a mistake and the defaults.
    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ScenarioError as error:
            arm = data.get("arm")
            given = arm if isinstance(arm, Mapping) else dict(arm) if isinstance(arm, Arm) else {}
            dimension = 3 if given.get("dimension") == 3 else 2  # it may be the mistake
            worded = (mistake.in_dimension(dimension) for mistake in error.mistakes)
            raise ScenarioError(
                with_places(mistake, scenario_schema()) for mistake in worded
            ) from None

    def model_post_init(self, context: Any, /) -> None:
        """Set the defaults that follow `arm.dimension`, and refuse tables that conflict."""
        self.__dict__.update(dimension_defaults(self, self.arm.dimension))
        super().model_post_init(context)

    def _representation(self) -> tuple[str, dict[str, str]]:
        return represent(self)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scenario:
        """Return the scenario of tables from ``tomllib``.

        Parameters
        ----------
        data : mapping of str to dict
            Tables by name.

        Returns
        -------
        Scenario

        Raises
        ------
        ScenarioError
            If anything is wrong, with one line per mistake.
        """
        return cls(**data)

    @classmethod
    def from_toml(cls, text: str) -> Scenario:
        """Return the scenario of the text of a TOML file.

        Parameters
        ----------
        text : str
            Text of the file.

        Returns
        -------
        Scenario

        Raises
        ------
        ScenarioError
            If anything is wrong, with one line per mistake.
        """
        return cls(**parse(text))

    def to_dict(self) -> dict[str, Any]:
        """Return the tables as plain dictionaries and lists, without empty ones.

        Returns
        -------
        dict
            Tables by name, for `from_dict`.
        """
        # a case with another dimension has other defaults
        varied = not _DIMENSION.isdisjoint(self.vary)
        return self._tables(lambda key: varied) | ({"vary": self.vary} if self.vary else {})

    def to_toml(self) -> str:
        """Return the scenario as TOML, defaults included; `from_toml` gives it back.

        Returns
        -------
        str
            Text of a file.
        """
        short = r'\[\n([^\[\]{}"]{,80}),\n\s*\]'  # a short list of numbers over several lines
        text = tomli_w.dumps(self.to_dict())
        return re.sub(short, lambda found: f"[{' '.join(found[1].split())}]", text)

    def cases(self) -> list[tuple[dict[str, Any], Scenario]]:
        """Return the cases of the scenario: every combination of the values in ``vary``.

        Returns
        -------
        list of tuple of dict and Scenario
            The values by dotted key, in the order of ``vary``, the last key changing fastest;
            without ``vary`` one empty dictionary with the scenario itself.
        """
        if not self.vary:
            return [({}, self)]
        return [(values, self.with_values(values)) for values in self._combinations()]

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """Return this scenario with other values, and without ``vary``.

        Parameters
        ----------
        values : mapping of str to value
            Values by dotted key, such as ``{"arm.length": 0.6}``.

        Returns
        -------
        Scenario

        Raises
        ------
        ScenarioError
            If anything is wrong, with one line per mistake.
        """
        # defaults still follow the dimension, except those that change in part
        document = self._tables(lambda key: not any(part.startswith(f"{key}.") for part in values))
        places = {key: assign(document, key, value) for key, value in values.items()}
        for key, other in combinations(places, 2):
            if places[key] == places[other]:
                raise refusal(other, f"got {key} too, which is the same; must name it once")
        return Scenario(**document)

    def _tables(self, left_open: Callable[[str], bool]) -> dict[str, Any]:
        """Return all tables except ``vary``, plain, without empty and open keys."""
        excluded = unwritten(self, self.arm.dimension, left_open) | {"vary": True}
        return without_empty(
            self.model_dump(mode="json", by_alias=True, exclude_none=True, exclude=excluded)
        )

    @property
    def floats(self) -> bool:
        """Whether the base is a submarine that floats, rather than one with a prescribed motion."""
        return self.vehicle is not None and self.vehicle.floats

    @property
    def hull(self) -> Hull | None:
        """The hull that the arm can touch."""
        return None if self.vehicle is None else self.vehicle.hull

    @property
    def control_rate_hz(self) -> float:
        """Commands a second."""
        return self.rate_hz(self.control.rate_hz)

    def rate_hz(self, given: float | None) -> float:
        """Return a rate, or the default one for None (Hz)."""
        return given or min(_DEFAULT_RATE_HZ, 1 / self.simulation.time_step)

    @property
    def threads(self) -> dict[str, Chamber | Tendon]:
        """Chambers and tendons by the names of their inputs."""
        keyed = keyed_threads(self.chamber, self.tendon).items()
        return {thread_name(key, thread): thread for key, thread in keyed}

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs besides those of further actuators."""
        return (*self.base.channels.present, *self.threads)

    @property
    def driven(self) -> tuple[str, ...]:
        """The inputs that the controller drives: channels of the base, chambers and tendons."""
        return self.control.settings.drives(self.inputs)

    @property
    def idle_values(self) -> dict[str, Any]:
        """Values by dotted key that switch the controller off."""
        moved = {"target.feed_forward": False} if self.target.feed_forward else {}
        return {"control.kind": "none"} | moved

    @property
    def judged_from(self) -> float:
        """Time from which errors count (s); 0 by default where the last ramp outlasts the run."""
        if self.target.judged_from is not None:
            return self.target.judged_from
        ramped = [each for each in (*self.flow, *self.load) if each.ramp_time > 0]
        ramped += [each for each in self.base.motion if isinstance(each, VelocityMotion)]
        end = max((each.start + each.ramp_time for each in ramped), default=0.0)
        return end if end < self.simulation.duration else 0.0

    @property
    def aims(self) -> bool:
        """Whether the tip has a target other than its pose at t = 0, or a controller."""
        target = self.target
        given = any(each != "initial" for each in (target.tip, target.angle_deg, target.direction))
        return given or target.moves or self.control.settings.feeds_back

    @property
    def output_interval(self) -> float:
        """Time between saved states, in s."""
        return self.output_steps * self.simulation.time_step

    @property
    def output_steps(self) -> int:
        """Number of time steps between saved states."""
        interval = self.output.interval or min(_DEFAULT_INTERVAL, self.simulation.duration)
        return max(1, round(interval / self.simulation.time_step))

    def _combinations(self) -> list[dict[str, Any]]:
        axes = [Levels.of(key, values) for key, values in self.vary.items()]
        count = prod(map(len, self.vary.values()))
        return [combination(axes, number) for number in range(count)]

    def _conflicts(self) -> Iterator[Mistake]:
        mistakes = list(dimension_conflicts(self, self.arm.dimension))
        yield from mistakes
        if not mistakes:
            for rule in RULES:
                yield from rule(self)
            if self.vary:
                yield from self._case_conflicts()

    def _case_conflicts(self) -> Iterator[Mistake]:
        count = prod(map(len, self.vary.values()))
        if count > _MAX_CASES:
            yield Mistake("vary", f"gives {count} cases; must give at most {_MAX_CASES}")
            return
        known = set()
        for values in self._combinations():
            try:
                self.with_values(values)
            except ScenarioError as error:
                for mistake in error.mistakes:
                    if mistake not in known:
                        known.add(mistake)
                        yield Mistake("vary", f"{case_words(values)}{mistake}")


@cache
def scenario_schema() -> dict[str, Any]:
    """Return the JSON schema of crinoid's own tables, not to be changed: making it needs 0.1 s."""
    return Scenario.model_json_schema()
