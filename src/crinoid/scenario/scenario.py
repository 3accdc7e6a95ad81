"""A whole scenario: the tables together, to and from TOML."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from math import prod
from typing import Annotated, Any

import tomli_w
from pydantic import BeforeValidator, Field

from crinoid.scenario.actuator import Actuator, actuator_conflicts
from crinoid.scenario.arm import Arm
from crinoid.scenario.base import Base
from crinoid.scenario.chamber import Chamber, Tendon, thread_conflicts, thread_names
from crinoid.scenario.consistency import (
    channel_conflicts,
    contact_conflicts,
    control_conflicts,
    depth_conflicts,
    joint_conflicts,
    measured_conflicts,
    motion_conflicts,
    output_conflicts,
    rate_conflicts,
    record_conflicts,
    shape_conflicts,
    vehicle_conflicts,
    wave_conflicts,
)
from crinoid.scenario.control import Control
from crinoid.scenario.dimension import dimension_conflicts, fitted, unwritten
from crinoid.scenario.document import assign, parse
from crinoid.scenario.errors import Mistake, ScenarioError, shown
from crinoid.scenario.flow import Flow
from crinoid.scenario.hybrid import hybrid_conflicts
from crinoid.scenario.keys import all_keys
from crinoid.scenario.load import Load
from crinoid.scenario.model import Model
from crinoid.scenario.obstacle import Obstacle
from crinoid.scenario.quantity import AsTuple, Quantity
from crinoid.scenario.sensor import Sensor, Sensors, sensor_conflicts
from crinoid.scenario.simulation import Output, Simulation
from crinoid.scenario.target import Target
from crinoid.scenario.tool import Tool, tool_conflicts
from crinoid.scenario.variation import combination
from crinoid.scenario.vehicle import Vehicle
from crinoid.scenario.water import Water

__all__ = ["Scenario"]

_DEFAULT_RATE_HZ = 100.0
_DEFAULT_INTERVAL = 0.02
_MAX_CASES = 10_000
_MOST_HINTS = 3
_DIMENSION = {"arm", "arm.dimension"}
"""Keys that a change of dimension goes by."""


def _plain(value: Any) -> Any:
    """Return a value as TOML gives it back, so that reading what was written changes nothing."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if not isinstance(value, (bool, int, float, str)):
        raise ValueError(f"{value!r} is not a TOML value")
    return value


def _without_empty(table: dict[str, Any]) -> dict[str, Any]:
    full = {
        key: _without_empty(value) if isinstance(value, dict) else value
        for key, value in table.items()
    }
    return {key: value for key, value in full.items() if value not in ({}, [])}


def _placed(mistake: Mistake, scenario: type[Scenario]) -> Mistake:
    """Say where a key that is not taken here belongs."""
    table, _, name = mistake.key.partition(".")
    if table == "vary" and name in scenario.model_fields:
        text = f"{mistake.text}; {name} itself stands above the first table"
        return replace(mistake, text=text)
    if not mistake.text.startswith("unknown key"):
        return mistake
    name = mistake.key.rpartition(".")[2]
    keys = all_keys(scenario.model_json_schema())
    found = [key for key in keys if key.rpartition(".")[2] == name]
    if not found or mistake.key in found:  # another kind of the same table takes it
        return mistake
    near = [mistake.instead] if name in mistake.instead else []
    *others, last = dict.fromkeys([*near, *found[:_MOST_HINTS]])
    instead = f"{', '.join(others)} or {last}" if others else last
    return replace(mistake, text="unknown key", instead=instead)


_Values = Annotated[
    list[Any],
    Field(min_length=1),
    Quantity(takes="a list of one value or more"),
]

Variations = Annotated[
    dict[str, _Values],
    BeforeValidator(_plain),
    Quantity(takes='keys such as "arm.length", each with a list of one value or more'),
]


class Scenario(Model):
    """An arm, the water around it, what acts on it and what is wanted of it.

    Every argument is a table of the TOML file, as a dictionary or as its class, and may be
    left out.

    Raises
    ------
    ScenarioError
        If anything is wrong, naming every key at fault.
    """

    title: str = Field(default="", description="What the scenario shows.")
    seed: int = Field(default=0, ge=0, lt=2**63, description="Seed of everything random.")
    arm: Arm = Field(default=Arm(), description="The arm.")
    base: Base = Field(default=Base(), description="The base, which holds the arm.")
    vehicle: Vehicle | None = Field(default=None, description="The submarine, if it floats.")
    water: Water = Field(default=Water(), description="The water.")
    flow: Annotated[tuple[Flow, ...], AsTuple] = Field(
        default=(), description="How the water moves; flows add up."
    )
    load: Annotated[tuple[Load, ...], AsTuple] = Field(
        default=(), description="Other forces on the arm."
    )
    obstacle: Annotated[tuple[Obstacle, ...], AsTuple] = Field(
        default=(), description="Rigid bodies that the arm meets."
    )
    tool: Tool | None = Field(default=None, description="What the tip carries.")
    chamber: Annotated[tuple[Chamber, ...], AsTuple] = Field(
        default=(), description="Chambers of fluid along the arm."
    )
    tendon: Annotated[tuple[Tendon, ...], AsTuple] = Field(
        default=(), description="Tendons along the arm."
    )
    actuator: Annotated[tuple[Actuator, ...], AsTuple] = Field(
        default=(), description="Actuators beside the base's channels."
    )
    target: Target = Field(default=Target(), description="Where the tip is wanted.")
    sensor: Sensor = Field(default=Sensor(), description="Sensor of the tip.")
    sensors: Annotated[tuple[Sensors, ...], AsTuple] = Field(
        default=(), description="Further sensors, for controllers that use them."
    )
    control: Control = Field(default=Control(), description="The controller.")
    simulation: Simulation = Field(default=Simulation(), description="How the motion is computed.")
    output: Output = Field(default=Output(), description="Instants of the motion that are saved.")
    vary: Variations = Field(
        default={},
        description="Dotted keys, each with a list of values to run; several keys: every "
        "combination.",
    )

    # Only here is it known in which words to speak of a mistake, and which defaults hold.
    def __init__(self, /, **data: Any) -> None:
        try:
            super().__init__(**data)
        except ScenarioError as error:
            arm = data.get("arm")
            given = arm if isinstance(arm, Mapping) else dict(arm) if isinstance(arm, Arm) else {}
            in_space = given.get("dimension") == 3
            told = (mistake.told(in_space=in_space) for mistake in error.mistakes)
            raise ScenarioError(_placed(mistake, type(self)) for mistake in told) from None

    def model_post_init(self, context: Any, /) -> None:
        """Settle the defaults that follow `arm.dimension`, and refuse what does not go together."""
        self.__dict__.update(fitted(self, self.arm.dimension))
        super().model_post_init(context)

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Scenario:
        """Make a scenario from tables, as ``tomllib`` gives them.

        Raises
        ------
        ScenarioError
            If anything is wrong, with one line per mistake.
        """
        return cls(**data)

    @classmethod
    def from_toml(cls, text: str) -> Scenario:
        """Make a scenario from the text of a TOML file.

        Raises
        ------
        ScenarioError
            If anything is wrong, with one line per mistake.
        """
        return cls(**parse(text))

    def to_dict(self) -> dict[str, Any]:
        """Return the tables as plain dictionaries and lists, without what is empty."""
        # a case with another dimension has other defaults
        varied = not _DIMENSION.isdisjoint(self.vary)
        document = self._tables(lambda key: varied)
        return {**document, **({"vary": self.vary} if self.vary else {})}

    def to_toml(self) -> str:
        """Return the scenario as TOML, defaults included; `from_toml` gives it back."""
        return tomli_w.dumps(self.to_dict())

    def cases(self) -> list[tuple[dict[str, Any], Scenario]]:
        """Return what the scenario stands for: every combination of the values in ``vary``.

        Returns
        -------
        list of (values, scenario)
            The values by dotted key, in the order of ``vary``, the last key changing fastest;
            without ``vary`` one empty dictionary with the scenario itself.
        """
        if not self.vary:
            return [({}, self)]
        return [(values, self.with_values(values)) for values in self._combinations()]

    def with_values(self, values: Mapping[str, Any]) -> Scenario:
        """Return this scenario with other values, given by dotted key, and without ``vary``.

        Raises
        ------
        ScenarioError
            If anything is wrong, with one line per mistake.
        """
        # what follows the dimension goes on following it, but for what is changed in part
        document = self._tables(lambda key: not any(part.startswith(f"{key}.") for part in values))
        for key, value in values.items():
            assign(document, key, value)
        return Scenario(**document)

    def _tables(self, left_open: Callable[[str], bool]) -> dict[str, Any]:
        """Return all tables but ``vary``, plain, without what is empty or follows the dimension."""
        excluded = unwritten(self, self.arm.dimension, left_open) | {"vary": True}
        return _without_empty(
            self.model_dump(mode="json", by_alias=True, exclude_none=True, exclude=excluded)
        )

    @property
    def sensor_rate_hz(self) -> float:
        """Readings of the tip a second."""
        return self.rate_hz(self.sensor.rate_hz)

    @property
    def control_rate_hz(self) -> float:
        """Commands a second."""
        return self.rate_hz(self.control.rate_hz)

    def rate_hz(self, given: float | None) -> float:
        """Return a rate, or the default of one that is left out (Hz)."""
        return given or min(_DEFAULT_RATE_HZ, 1 / self.simulation.time_step)

    @property
    def thread_names(self) -> tuple[str, ...]:
        """Names of the inputs of chambers and tendons."""
        return thread_names(self.chamber, self.tendon)

    @property
    def driven(self) -> tuple[str, ...]:
        """The inputs that the controller drives: channels of the base, chambers and tendons."""
        inputs = (*self.base.channels.present, *self.thread_names)
        match self.control.kind:
            case "none":
                return ()
            case "pid":
                present = self.control.pid.present
                known = [name for name in inputs if name in present]
                return (*known, *(name for name in present if name not in inputs))
            case "lqg":
                return self.control.lqg.inputs or inputs
            case "hybrid":
                return ("slide",)
            case "mpc":
                return self.control.mpc.inputs or inputs
            case _:
                return inputs

    @property
    def output_interval(self) -> float:
        """Time between saved states, in s."""
        return self.output_steps * self.simulation.time_step

    @property
    def output_steps(self) -> int:
        """Number of time steps between saved states."""
        interval = self.output.interval or min(_DEFAULT_INTERVAL, self.simulation.duration)
        return max(1, round(interval / self.simulation.time_step))

    @property
    def _count(self) -> int:
        return prod(map(len, self.vary.values()))

    def _combinations(self) -> list[dict[str, Any]]:
        return [combination(self.vary, number) for number in range(self._count)]

    def _conflicts(self) -> Iterator[Mistake]:
        dimension = self.arm.dimension
        mistakes = list(dimension_conflicts(self, dimension))
        if mistakes:  # the others take vectors as they should be
            yield from mistakes
            return
        yield from shape_conflicts(self.arm)
        yield from joint_conflicts(self.base, dimension)
        yield from depth_conflicts(self.water, self.base, self.flow)
        yield from wave_conflicts(self.water, self.base, self.flow)
        yield from measured_conflicts(self.flow, dimension)
        yield from record_conflicts(self.flow, self.simulation)
        yield from motion_conflicts(self.base, self.simulation, dimension)
        yield from vehicle_conflicts(self.vehicle, self.base, self.target)
        yield from channel_conflicts(
            self.control, self.base, self.thread_names, dimension, others=bool(self.actuator)
        )
        yield from control_conflicts(self.control, self.target, dimension)
        yield from hybrid_conflicts(self)
        rates = {"sensor": self.sensor} | {
            f"sensors.{index}": sensor for index, sensor in enumerate(self.sensors)
        }
        yield from rate_conflicts(rates, self.rate_hz(None), self.control, self.simulation)
        yield from sensor_conflicts(self.sensors, self.obstacle)
        yield from actuator_conflicts(self.actuator, self.thread_names)
        yield from thread_conflicts(self.chamber, self.tendon, self.arm)
        yield from contact_conflicts(self.arm, self.obstacle)
        yield from tool_conflicts(self.tool, len(self.obstacle))
        yield from output_conflicts(self.output, self.simulation, dimension)
        if self.vary:
            yield from self._case_conflicts()

    def _case_conflicts(self) -> Iterator[Mistake]:
        if self._count > _MAX_CASES:
            yield Mistake("vary", f"makes {self._count} cases, takes {_MAX_CASES} or fewer")
            return
        told = set()
        for values in self._combinations():
            try:
                self.with_values(values)
            except ScenarioError as error:
                case = ", ".join(f"{key} = {shown(value)}" for key, value in values.items())
                for mistake in error.mistakes:
                    if mistake not in told:
                        told.add(mistake)
                        yield Mistake("vary", f"case {case}: {mistake}")
