"""Kinds of controllers: what each drives and observes, its settings, and what builds it.

A new kind is one class here and one entry in `crinoid.scenario.control`; or a table of an installed
package (`crinoid.scenario.kinds`). No other module compares kinds.
"""
# ruff: noqa: D102  # the base class documents its methods

import math
from collections.abc import Iterator
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import ConfigDict, Field, create_model

from crinoid.foundation.axes import CHANNELS
from crinoid.scenario.base import by_channel
from crinoid.scenario.document import FileName
from crinoid.scenario.errors import Mistake, got, missing, refusal
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import AsTuple, Degrees, Hertz, ListOf, Metres, Quantity, Seconds
from crinoid.scenario.sensor import inclination_sensor

if TYPE_CHECKING:
    from crinoid.scenario.scenario import Scenario


class ControllerTable(Model):
    """A kind of controller with its settings."""

    builder: ClassVar[str] = ""
    """Function of crinoid that builds it of a plan, as ``module:function``."""
    feeds_back: ClassVar[bool] = True
    """Whether its commands answer to the error of the tip."""
    feeds_forward: ClassVar[bool] = True
    """Whether the feed-forward of a moving target adds to its commands."""
    observes: ClassVar[bool] = True
    """Whether results can have the estimate of an observer."""
    balances: ClassVar[bool] = False
    """Whether it holds an arm upright that buckles under its weight."""

    def drives(self, inputs: tuple[str, ...]) -> tuple[str, ...]:
        """Return the names of the inputs that it drives, of all those that the arm has."""
        return inputs

    def conflicts(self, scenario: "Scenario") -> Iterator[Mistake]:
        """Yield the mistakes of other tables in a scenario under this kind."""
        yield from ()

    def build(self, plan: Any) -> Any:
        """Return the `crinoid.Controller`.

        ``plan`` is a `crinoid.AssembledScenario`: the arm at its start, and the target.
        """
        if self.builder:
            return resolve_name(self.builder)(plan)
        text = 'got "custom", which requires a controller. Pass one to crinoid.simulate.'
        raise refusal("control.kind", text)


class Idle(ControllerTable):
    """No controller."""

    feeds_back = feeds_forward = observes = False

    def drives(self, inputs: tuple[str, ...]) -> tuple[str, ...]:
        return ()

    def conflicts(self, scenario: "Scenario") -> Iterator[Mistake]:
        if scenario.target.feed_forward:
            must = 'be left out with control.kind = "none"'
            yield scenario.mistake("target.feed_forward", must, 'Set control.kind = "pid".')

    def build(self, plan: Any) -> Any:
        return resolve_name("crinoid.control:Idle")()


class PidGains(Model):
    """Gains of one input: a channel of the base, a chamber or a tendon by its name."""

    kp: float = entry(0.0, "Proportional gain.")
    ki: Annotated[float, Quantity("1/s")] = entry(0.0, "Integral gain.")
    kd: Annotated[float, Quantity("s")] = entry(0.0, "Derivative gain.")
    derivative_filter_hz: Hertz = entry(
        10.0, "Corner frequency of the low-pass filter on the derivative.", gt=0
    )
    weight: float = entry(
        1.0,
        "Preference of this input where there are more than needed: the sum of squared commands"
        " (m, rad, shares), each over its weight, is least.",
        ge=1e-3,
        le=1e3,
    )
    return_time: Seconds | None = entry(
        None,
        "Time in which it returns to rest while others take over, so that the tip stays; by "
        "default it does not return.",
        gt=0,
    )


_Fields: Any = create_model(
    "_Fields",
    __base__=ControllerTable,
    **by_channel(lambda _: PidGains, lambda channel: f"Gains of {channel.name}."),
)


class Pid(_Fields):
    """A PID controller: gains for each input it drives; chambers and tendons by their names."""

    builder = "crinoid.assembly.control_loop:build_pid"
    observes = False
    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, PidGains]

    @property
    def present(self) -> dict[str, PidGains]:
        """The gains by input: channels in the order of `crinoid.foundation.axes.CHANNELS`."""
        every = {name: getattr(self, name) for name in CHANNELS[3]} | self.__pydantic_extra__
        return {name: gains for name, gains in every.items() if gains is not None}

    def drives(self, inputs: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(n for n in (*inputs, *self.present) if n in self.present))


_SMOOTHNESS, _AMONG_VORTICES = 0.01, 0.04
"""Default smoothness over the arm's length: faster control would feed the lock-in of vortices."""

_Inputs = Annotated[
    tuple[str, ...], AsTuple, Field(min_length=1), Quantity(expects="a list of names of inputs")
]


class ModelBased(ControllerTable):
    """Settings of controllers with a linear model of the arm."""

    inputs: _Inputs | None = entry(
        None, "Inputs that it drives: channels of the base, chambers, tendons; all by default."
    )
    smoothness: Metres | None = entry(
        None,
        "Error of the tip that costs as much as an input at its greatest speed, by default "
        "a hundredth of the arm's length, with vortices in space four; lower it for a faster "
        "response.",
        gt=0,
    )
    integral_time: Seconds = entry(5.0, "Time in which it removes a lasting error.", gt=0)

    def smoothness_in(self, scenario: "Scenario") -> float:
        """Return the smoothness (m) in a scenario."""
        lift = scenario.water.vortices is not None and scenario.arm.dimension == 3
        return self.smoothness or (_AMONG_VORTICES if lift else _SMOOTHNESS) * scenario.arm.length

    def drives(self, inputs: tuple[str, ...]) -> tuple[str, ...]:
        return self.inputs or inputs

    def conflicts(self, scenario: "Scenario") -> Iterator[Mistake]:
        if not (scenario.driven or scenario.actuator):
            yield scenario.mistake("control.kind", "have an input", "Add base.channels.slide.")


class Lqg(ModelBased):
    """LQG control: linear quadratic regulator on the estimate of a Kalman filter."""

    builder = "crinoid.assembly.optimal_control:build_lqg"


class Mpc(ModelBased):
    """Model predictive control: a receding horizon within the limits of the inputs."""

    horizon: Seconds = entry(1.0, "Time ahead for which it plans commands.", gt=0, le=10)
    current: Literal["unknown", "measured", "known"] = entry(
        "unknown",
        "Knowledge of the water besides the observer's: none; readings of the first sensor of "
        "kind current, extended in time by the statistics of the flows; or the flows of the "
        "scenario ahead of time, as no controller in the sea has.",
    )
    model: Literal["frozen", "scheduled"] = entry(
        "frozen",
        "Linear model of the arm: at the start; or at several poses of the base on the way of "
        "the target, weighted by distance, for arms that turn far.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.model == "scheduled" and self.current != "unknown":
            yield Mistake("model", got("scheduled", 'be "frozen" without current = "unknown"'))

    @property
    def observes(self) -> bool:  # type: ignore[override]
        return self.model == "frozen"

    def build(self, plan: Any) -> Any:
        if self.model == "scheduled":
            return resolve_name("crinoid.assembly.scheduled:build_scheduled")(plan)
        return resolve_name("crinoid.assembly.optimal_control:design_mpc")(plan)[0]


class Hybrid(ControllerTable):
    """A controller that swings a hanging arm up, catches it and balances it upright."""

    builder = "crinoid.assembly.hybrid:build_hybrid"
    observes = False
    balances = True

    modes: int = entry(
        5,
        "Slowest modes of the upright arm in its model, at most as many as stations of the "
        "inclination sensor; those above a quarter of control.rate_hz are omitted.",
        ge=2,
        le=20,
    )
    catch_deg: Degrees = entry(60.0, "Largest lean at which it catches the arm.", gt=0, lt=90)
    release_deg: Degrees = entry(
        80.0, "Lean beyond which it releases the arm and swings it up again.", gt=0, le=180
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.release_deg <= self.catch_deg:
            yield self.mistake("release_deg", f"be above catch_deg = {self.catch_deg} (degrees)")

    def drives(self, inputs: tuple[str, ...]) -> tuple[str, ...]:
        return ("slide",)

    def conflicts(self, scenario: "Scenario") -> Iterator[Mistake]:
        arm, base = scenario.arm, scenario.base
        hybrid = 'with control.kind = "hybrid"'
        if arm.dimension == 3:
            yield scenario.mistake("arm.dimension", f"be 2 {hybrid}")
            return
        if base.channels.slide is None:
            yield Mistake("base.channels.slide", missing(f"be a table {hybrid}"))
        elif 0 in base.channels.slide.range:
            must = f"reach to both sides of 0 {hybrid}"
            yield scenario.mistake("base.channels.slide.range", must)
        if base.mount != "clamped":
            yield scenario.mistake("base.mount", f'be "clamped" {hybrid}')
        if not math.isclose(base.tilt_deg, 90.0):
            yield scenario.mistake("base.tilt_deg", f"be 90 {hybrid}, for an upright arm")
        if arm.rest_curvature != 0.0:
            yield scenario.mistake("arm.rest_curvature", f"be 0 {hybrid}")
        for name in ("vehicle", "tool", "chamber", "tendon"):
            if getattr(scenario, name):
                yield scenario.mistake(name, f"be left out {hybrid}")
        sensor = inclination_sensor(scenario.sensors)
        if sensor is None:
            yield Mistake("sensors", missing(f'have an entry with kind = "inclination" {hybrid}'))
            return
        key, modes = f"sensors.{scenario.sensors.index(sensor)}", self.modes
        if len(sensor.stations) < modes:
            must = f"have at least control.hybrid.modes = {modes} entries"
            yield scenario.mistake(f"{key}.stations", must)
        if modes >= arm.nodes:
            yield scenario.mistake("control.hybrid.modes", f"be below arm.nodes = {arm.nodes}")
        rate, commands = scenario.rate_hz(sensor.rate_hz), scenario.control_rate_hz
        if rate < commands * (1 - 1e-9):
            must = f"be at least control.rate_hz = {commands:g} (Hz) {hybrid}"
            yield Mistake(f"{key}.rate_hz", got(rate, must))


_Weights = Annotated[FileName, Quantity(expects="the path of a file that crinoid train wrote")]


class Neural(ControllerTable):
    """Neural control: a network that was trained in simulation."""

    builder = "crinoid.assembly.neural:build_neural"
    observes = feeds_forward = False  # it knows the target itself

    weights: _Weights | None = entry(
        None, "File of the policy from `crinoid train`; required with kind neural."
    )


class Phase(Model):
    """A phase of a sequence."""

    inputs: Annotated[
        dict[str, float],
        Quantity(expects="a table of numbers, such as {heave = 0.1, pan_deg = 30}"),
    ] = entry(
        {},
        "Values that inputs move to, along half a cosine: shifts in m, turns in degrees (NAME_deg),"
        " chambers and tendons in shares; others keep their command.",
    )
    duration: Seconds = Field(gt=0, description="Time in which they move there.")
    until: Annotated[
        dict[str, Annotated[float, Field(gt=0)]],
        Quantity(expects="a table of positive numbers, such as {fingertip = 0.2}"),
    ] = entry(
        {},
        "Forces of contact sensors (N) that end it, all of them, at any time: inputs stop where "
        "they are. By default it ends after its duration.",
    )


class Sequence(ControllerTable):
    """Phases in which inputs move to given values."""

    builder = "crinoid.assembly.sequence:build_sequence"
    feeds_back = feeds_forward = observes = False
    phases: ListOf[Phase] = ()
