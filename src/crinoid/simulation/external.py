"""Commands, current and motion of the base that come from outside of the loop."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike

from crinoid.actuation import Input
from crinoid.assembly.arrays import array
from crinoid.base import Base, BaseMotion
from crinoid.control import Controller, ControllerInput
from crinoid.control.controller import Command
from crinoid.flow.flow import Everywhere
from crinoid.foundation.axes import CHANNELS
from crinoid.foundation.representation import with_units
from crinoid.numerics.ramp import Onset
from crinoid.scenario import Scenario, counted, got, one_of, refusal
from crinoid.simulation.loop import Loop

__all__ = ["ExternalCommand", "ExternalSignals", "moved_channels"]

Time = Float[Array, ""]


class ExternalCommand(Controller):
    """Controller whose commands come from outside of the loop."""

    value: Command
    """Commands, in the units of the inputs (`crinoid.System.inputs`)."""

    def start(self, seen: ControllerInput) -> None:
        """Return no memory."""

    def command(self, memory: None, seen: ControllerInput) -> tuple[Command, None]:
        """Return the command from outside."""
        return self.value, None


CommandLike = ArrayLike | Mapping[str, Any]
"""Commands in the order of the inputs, or by name."""


def checked_command(
    command: CommandLike, inputs: Sequence[Input], last: ArrayLike
) -> Float[np.ndarray, " input"]:
    """Return a command as numbers, or refuse it; inputs without a name in it keep the last one."""
    names = [each.name for each in inputs]
    if isinstance(command, Mapping):
        found = np.array(last)
        for name, value in command.items():
            if name not in names:
                must = f"be {one_of(names)}" if names else "be left out, as no input can move"
                add = f"Add a table base.channels.{name}." if name in CHANNELS[3] else ""
                raise ValueError(f"command: {got(name, must, add)}")
            found[names.index(name)] = numbers(f"command.{name}", value, ())
        return found
    return numbers("command", command, (len(names),), inputs_in_words(inputs))


def inputs_in_words(inputs: Sequence[Input]) -> list[str]:
    """Return names and units of inputs, such as ``tilt (rad)`` and ``chamber_0 (share)``."""
    names, units = [each.name for each in inputs], [each.unit for each in inputs]
    return with_units(names, units, "share")


class ExternalCurrent(Everywhere):
    """Uniform current from outside of the loop: linear in time from one velocity to another."""

    steady: ClassVar[bool] = False
    onset: Onset
    begin: Time  # start of the interval (s)
    initial: Float[Array, " d"]  # velocity at its start (m/s)
    change: Float[Array, " d"]  # rate of the velocity during it (m/s2)
    moved: Float[Array, " d"]  # displacement of the water until its start (m)

    def at(self, time: Time) -> Float[Array, " d"]:
        return self.initial + (time - self.begin) * self.change

    def displacement(self, time: Time) -> Float[Array, " d"]:
        since = time - self.begin
        return self.moved + since * (self.initial + 0.5 * since * self.change)


class ExternalMotion(BaseMotion):
    """Displacement of a channel from outside of the loop: cubic between points in time."""

    channel: int = eqx.field(static=True)
    times: Float[Array, " point"]  # times of the points (s), increasing
    values: Float[Array, " point"]  # displacements there (m or rad)
    rates: Float[Array, " point"]  # velocities there (m/s or rad/s)

    def displacement(self, time: Time) -> Float[Array, ""]:
        last = self.times.shape[0] - 1
        after = jnp.clip(jnp.searchsorted(self.times, time, side="right"), 1, last)
        before = after - 1
        step = self.times[after] - self.times[before]
        share = (time - self.times[before]) / step
        rise = self.values[after] - self.values[before]
        first, second = step * self.rates[before] - rise, step * self.rates[after] - rise
        bend = (1 - share) * first - share * second
        return self.values[before] + share * rise + share * (1 - share) * bend


def moved_channels(scenario: Scenario) -> tuple[str, ...]:
    """Return the channels of the base that the arm feels: a pinned root turns freely."""
    names = CHANNELS[scenario.arm.dimension]
    return names[:-1] if len(names) == 3 and scenario.base.mount == "pinned" else names


_KINDS = ("current", "base")
Displacement = float | tuple[float, float]


class ExternalSignals:
    """Current and motion of the base from outside: their values, in steps from the start on.

    Raises a `ScenarioError` for kinds other than "current" and "base", and for a base that floats.
    """

    def __init__(self, kinds: Iterable[str], scenario: Scenario) -> None:
        given = [kinds] if isinstance(kinds, str) else list(kinds)
        for kind in given:
            if kind not in _KINDS:
                raise refusal("external", got(kind, f"be {one_of(_KINDS)}"))
        self.kinds = tuple(kind for kind in _KINDS if kind in given)
        """What comes from outside."""
        if "base" in given and scenario.floats:
            text = got("base", "be left out with vehicle.mass", "A vehicle floats.")
            raise refusal("external", text)
        axes, period = scenario.arm.dimension, 1 / scenario.control_rate_hz
        self._channels = moved_channels(scenario)
        # readings of the past count from where the base was then
        sensors = (scenario.sensor, *scenario.sensors)
        oldest = max(each.delay + 1 / scenario.rate_hz(each.rate_hz) for each in sensors)
        points = 2 + math.ceil(oldest / period)
        self._begin = 0.0
        self._velocity, self._acceleration, self._moved = np.zeros((3, axes))
        self._times = period * np.arange(1.0 - points, 1.0)
        self._values, self._rates = np.zeros((2, points, len(self._channels)))

    @property
    def flows(self) -> tuple[ExternalCurrent, ...]:
        """The current, if it comes from outside."""
        if "current" not in self.kinds:
            return ()
        numbers = self._begin, self._velocity, self._acceleration, self._moved
        return (ExternalCurrent(Onset.of(), *map(array, numbers)),)

    @property
    def motions(self) -> tuple[ExternalMotion, ...]:
        """The motion of each channel of the base, if they come from outside."""
        if "base" not in self.kinds:
            return ()
        columns = zip(self._values.T, self._rates.T, strict=True)
        return tuple(
            ExternalMotion(index, *map(array, (self._times, *each)))
            for index, each in enumerate(columns)
        )

    def advance(
        self,
        begin: float,
        end: float,
        current: Sequence[float] | None,
        base: Mapping[str, Displacement] | None,
    ) -> None:
        """Go on from one time to another (s), where they have the given values; None: the last.

        Raises
        ------
        ValueError
            If a value is not finite, has another shape, or does not come from outside.
        """
        moved, values, rates = self._checked(begin, end, current, base)
        # before the first command all are still
        self._times = self._times + max(0.0, begin - self._times[-1])
        since = begin - self._begin
        self._moved = self._moved + since * (self._velocity + 0.5 * since * self._acceleration)
        self._velocity = self._velocity + since * self._acceleration
        self._begin = begin
        self._acceleration = (moved - self._velocity) / (end - begin)
        self._times = np.append(self._times[1:], end)
        self._values = np.vstack([self._values[1:], values])
        self._rates = np.vstack([self._rates[1:], rates])

    def fed(self, loop: Loop) -> Loop:
        """Return a loop with them."""
        flows, motions = self.flows, self.motions
        if flows:
            loop = eqx.tree_at(lambda of: of.system.forces.water.flows[-1], loop, flows[0])
        if motions:
            loop = eqx.tree_at(lambda of: _last(of.system.base, motions), loop, motions)
        if motions and loop.target.carrier is not None:
            loop = eqx.tree_at(lambda of: _last(of.target.carrier.base, motions), loop, motions)
        return loop

    def to_json(self) -> str:
        """Return the numbers as text, for `from_json` of signals of the same kinds."""
        numbers = {name: value for name, value in vars(self).items() if name in _NUMBERS}
        kept = {name: np.asarray(value).tolist() for name, value in numbers.items()}
        return json.dumps({"kinds": self.kinds, **kept})

    def from_json(self, text: str) -> None:
        """Set the numbers from text of `to_json`.

        Raises
        ------
        ValueError
            If it is no such text, or of signals of other kinds.
        """
        try:
            found = json.loads(text)
            read = {name: np.asarray(found[name], float) for name in _NUMBERS}
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError("no signals from outside") from error
        alike = all(read[name].shape == np.shape(getattr(self, name)) for name in _NUMBERS)
        if not alike or found.get("kinds") != list(self.kinds):
            raise ValueError("signals of other kinds")
        vars(self).update(read)

    def _checked(
        self,
        begin: float,
        end: float,
        current: Sequence[float] | None,
        base: Mapping[str, Displacement] | None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        sources: tuple[tuple[str, Any], ...] = (("current", current), ("base", base))
        for kind, source in sources:
            if source is not None and kind not in self.kinds:
                text = got(source, "be named in external of the session")
                raise ValueError(f"{kind}: {text}")
        water = self._velocity + (begin - self._begin) * self._acceleration
        if current is not None:
            water = numbers("current", current, water.shape)
        base = {} if base is None else base
        if not isinstance(base, Mapping):
            raise ValueError(f"base: {got(base, 'be numbers by the names of channels')}")
        values, rates = self._values[-1].copy(), np.zeros(len(self._channels))
        for name, given in base.items():
            if name not in self._channels:
                raise ValueError(f"base: {got(name, f'be {one_of(self._channels)}')}")
            index = self._channels.index(name)
            pair = isinstance(given, Sequence) or np.ndim(given) > 0
            found = numbers(f"base.{name}", given, (2,) if pair else ())
            value = float(found[0]) if pair else float(found)
            straight = (value - values[index]) / (end - begin)
            values[index], rates[index] = value, float(found[1]) if pair else straight
        return water, values, rates


def _last(base: Base, motions: Sequence[BaseMotion]) -> tuple[BaseMotion, ...]:
    return base.motions[-len(motions) :]


_NUMBERS = ("_begin", "_velocity", "_acceleration", "_moved", "_times", "_values", "_rates")


def numbers(key: str, given: Any, shape: tuple[int, ...], words: Sequence[str] = ()) -> np.ndarray:
    """Return finite numbers of a shape, or raise ValueError with one line.

    ``words`` are names and units of the numbers of a vector.
    """
    try:
        found = np.asarray(given)
    except ValueError:  # rows of several lengths
        found = np.array(None)
    if found.dtype.kind not in "iuf":
        raise ValueError(f"{key}: {got(given, 'be numbers')}")
    if found.shape != shape:
        size, must = f"the shape {found.shape}", f"{shape}"
        if words:
            size = counted(found.size, "number") if found.ndim == 1 else size
            must = f"{shape[-1]}: {', '.join(words)}"
        raise ValueError(f"{key}: got {size}; must be {must}")
    if not np.isfinite(found).all():
        raise ValueError(f"{key}: {got(found.tolist(), 'be finite')}")
    return found.astype(float)
