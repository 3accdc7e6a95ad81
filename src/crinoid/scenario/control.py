"""The controller.

A new kind is a table under the entry points ``crinoid.controllers``
(`crinoid.scenario.kinds`); its settings are in ``[control.KIND]``.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, create_model

from crinoid.foundation.axes import AXES, CHANNELS
from crinoid.scenario.base import by_channel
from crinoid.scenario.document import FileName
from crinoid.scenario.errors import Mistake, ScenarioError, got, missing, one_of
from crinoid.scenario.kinds import installed, installed_table
from crinoid.scenario.model import Model, entry, unknown_key
from crinoid.scenario.quantity import (
    AsTuple,
    Degrees,
    Hertz,
    InSpace,
    ListOf,
    Metres,
    Quantity,
    Seconds,
)
from crinoid.scenario.sensor import DEFAULT_RATE

_Weights = Annotated[FileName, Quantity(expects="the path of a file that crinoid train wrote")]


class Neural(Model):
    """Neural control: a network that was trained in simulation."""

    weights: _Weights | None = entry(
        None, "File of the policy from `crinoid train`; required with kind neural."
    )


_SMOOTHNESS, _AMONG_VORTICES = 0.01, 0.04
"""Default smoothness over the arm's length: faster control would feed the lock-in of vortices."""

_Inputs = Annotated[
    tuple[str, ...], AsTuple, Field(min_length=1), Quantity(expects="a list of names of inputs")
]


class ModelBased(Model):
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

    def smoothness_on(self, length: float, *, lift: bool) -> float:
        """Return the smoothness (m) for an arm of a length (m), which may feel lift of vortices."""
        return self.smoothness or (_AMONG_VORTICES if lift else _SMOOTHNESS) * length


class Lqg(ModelBased):
    """LQG control: linear quadratic regulator on the estimate of a Kalman filter."""


class Hybrid(Model):
    """A controller that swings a hanging arm up, catches it and balances it upright."""

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


KINDS = ("none", "pid", "lqg", "hybrid", "mpc", "neural", "sequence", "custom")
COORDINATES = {2: (*AXES[2], "angle"), 3: (*AXES[3], "direction")}
"""Coordinates of the tip that a controller can control, by the number of axes."""

# spelled out for the type checker: those of the plane and of space
Coordinate = Annotated[
    Literal["x", "y", "z", "angle", "direction"],
    Quantity(expects=one_of(COORDINATES[2]), in_space=one_of(COORDINATES[3])),
]


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
    __base__=Model,
    **by_channel(lambda _: PidGains, lambda channel: f"Gains of {channel.name}."),
)


class Pid(_Fields):
    """A PID controller: gains for each input it drives; chambers and tendons by their names."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, PidGains]

    @property
    def present(self) -> dict[str, PidGains]:
        """The gains by input: channels in the order of `crinoid.foundation.axes.CHANNELS`."""
        every = {name: getattr(self, name) for name in CHANNELS[3]} | self.__pydantic_extra__
        return {name: gains for name, gains in every.items() if gains is not None}


class ControllerTable(Model):
    """Settings of a kind of controller from an installed package."""

    def build(self, plan: Any) -> Any:
        """Return the `crinoid.Controller`.

        ``plan`` is a `crinoid.AssembledScenario`: the arm at its start, and the target.
        """
        raise NotImplementedError


class Control(Model):
    """The controller; the settings of other kinds are saved but not used."""

    # settings of a kind of a package are next to those of the kinds below
    model_config = ConfigDict(extra="allow", json_schema_extra={"additionalProperties": False})

    kind: Annotated[str, Quantity(expects=f"{one_of(KINDS)}, or the kind of a package")] = entry(
        "none", "Kind of controller; custom: the one that crinoid.simulate gets."
    )
    rate_hz: Hertz | None = entry(None, f"Commands a second; {DEFAULT_RATE}.", gt=0)
    start: Seconds = entry(
        0.0,
        "Time when it switches on; its inputs rest until then. The error at that time is ramped"
        " in over the first period of the arm.",
        ge=0,
    )
    controlled: Annotated[
        tuple[Coordinate, ...],
        AsTuple,
        Field(min_length=1),
        Quantity(
            expects=f"a list of {one_of(COORDINATES[2], 'and')}",
            in_space=f"a list of {one_of(COORDINATES[3], 'and')}",
        ),
        InSpace(("x", "y", "z")),
    ] = entry(("x", "z"), "Coordinates of the tip to bring to the target.")
    mapping: Literal["static-jacobian", "identity"] = entry(
        "static-jacobian",
        "From errors of the tip to inputs: through the tip's response at rest, or one to one (x"
        " to slide, z to heave, angle to tilt; in space x, y and z to slide, sway and heave).",
    )
    compare: bool = entry(True, "Whether to run the same case with the controller off as well.")
    pid: Pid = entry(Pid(), "Settings of kind pid: gains by input.")
    lqg: Lqg = entry(Lqg(), "Settings of kind lqg.")
    hybrid: Hybrid = entry(Hybrid(), "Settings of kind hybrid.")
    mpc: Mpc = entry(Mpc(), "Settings of kind mpc.")
    neural: Neural = entry(Neural(), "Settings of kind neural.")
    sequence: ListOf[Phase] = entry((), "Phases of kind sequence.")

    def __init__(self, /, **data: Any) -> None:
        known, brought, mistakes = type(self).model_fields, installed("controllers"), []
        kind = data.get("kind", "none")
        if isinstance(kind, str) and kind not in KINDS:
            if kind in brought:
                data.setdefault(kind, {})
            else:
                mistakes.append(Mistake("kind", got(kind, f"be {one_of((*KINDS, *brought))}")))
        for name in data.keys() - known:
            if name not in brought:
                if name != kind:  # else the mistake of the kind says it
                    mistakes.append(unknown_key(type(self), name))
                continue
            value = data[name]
            try:
                table = installed_table("controllers", name, ControllerTable)
                if isinstance(value, Mapping):
                    data[name] = table(**value)
                elif not isinstance(value, table):
                    mistakes.append(Mistake(name, got(value, "be a table")))
            except ScenarioError as error:
                mistakes += [mistake.under(name) for mistake in error.mistakes]
        if mistakes:
            raise ScenarioError(mistakes)
        super().__init__(**data)

    @property
    def settings(self) -> Any:
        """The table of the chosen kind."""
        return getattr(self, self.kind)

    @property
    def observes(self) -> bool:
        """Whether results can have the estimate of an observer, as those of a package's kind."""
        scheduled = self.kind == "mpc" and self.mpc.model == "scheduled"
        return self.kind not in ("none", "pid", "hybrid", "neural", "sequence") and not scheduled

    def _conflicts(self) -> Iterator[Mistake]:
        if len(set(self.controlled)) < len(self.controlled):
            yield self.mistake("controlled", "have each coordinate once")
        if self.kind == "pid" and not self.pid.present:
            hint = "Add control.pid.slide.kp and base.channels.slide."
            yield Mistake("pid", missing('have gains of an input with kind = "pid"', hint))
        if self.kind == "neural" and self.neural.weights is None:
            text = missing('be a file of crinoid train with kind = "neural"')
            yield Mistake("neural.weights", text)
        if self.kind == "sequence" and not self.sequence:
            yield Mistake("sequence", missing('have a phase with kind = "sequence"'))
        if self.kind == "lqg" and self.mapping == "identity":
            yield Mistake("mapping", got("identity", 'be left out with kind = "lqg"'))
