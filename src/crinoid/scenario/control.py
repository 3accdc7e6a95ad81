"""The controller.

A new kind is a table of its own under the entry points ``crinoid.controllers``
(`crinoid.scenario.kinds`); its settings stand in ``[control.KIND]``.
"""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, create_model

from crinoid.scenario.channel import by_channel
from crinoid.scenario.dimension import InSpace
from crinoid.scenario.errors import Mistake, ScenarioError, one_of, shown
from crinoid.scenario.hybrid import Hybrid
from crinoid.scenario.kinds import installed, installed_table
from crinoid.scenario.lqg import Lqg
from crinoid.scenario.model import Model, unknown_key
from crinoid.scenario.mpc import Mpc
from crinoid.scenario.neural import Neural
from crinoid.scenario.quantity import AsTuple, Hertz, Quantity, Seconds
from crinoid.scenario.sensor import DEFAULT_RATE
from crinoid.space import AXES, CHANNELS

__all__ = ["Control", "ControllerTable", "Coordinate", "Pid", "PidGains"]

KINDS = ("none", "pid", "lqg", "hybrid", "mpc", "neural", "custom")
COORDINATES = {2: (*AXES[2], "angle"), 3: (*AXES[3], "direction")}
"""Coordinates of the tip that a controller can bring to the target, by the number of axes."""

# spelled out for the type checker: those of the plane and of space
Coordinate = Annotated[
    Literal["x", "y", "z", "angle", "direction"],
    Quantity(takes=one_of(COORDINATES[2]), in_space=one_of(COORDINATES[3])),
]


class PidGains(Model):
    """Gains of one input: a channel of the base, a chamber or a tendon by its name."""

    kp: float = Field(default=0.0, description="Proportional gain.")
    ki: Annotated[float, Quantity("1/s")] = Field(default=0.0, description="Integral gain.")
    kd: Annotated[float, Quantity("s")] = Field(default=0.0, description="Derivative gain.")
    derivative_filter_hz: Hertz = Field(
        default=10.0, gt=0, description="Corner frequency of the low-pass filter on the derivative."
    )
    weight: float = Field(
        default=1.0,
        ge=1e-3,
        le=1e3,
        description="How readily it is used where more inputs are driven than it takes: the sum of "
        "squared commands (m, rad, shares), each over its weight, is least.",
    )
    return_time: Seconds | None = Field(
        default=None,
        gt=0,
        description="Time in which it goes back to where it rests while others take over, so that "
        "the tip stays; it keeps what it does if left out.",
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
        """The gains there are, by input: channels in the order of `crinoid.space.CHANNELS`."""
        every = {name: getattr(self, name) for name in CHANNELS[3]} | self.__pydantic_extra__
        return {name: gains for name, gains in every.items() if gains is not None}


class ControllerTable(Model):
    """Settings of a kind of controller that an installed package brings."""

    def build(self, plan: Any) -> Any:
        """Return the `crinoid.Controller`.

        ``plan`` is a `crinoid.Plan`: the arm at its start, and what is wanted.
        """
        raise NotImplementedError


class Control(Model):
    """The controller; the settings of a kind that is not chosen are kept but not used."""

    # settings of a kind that a package brings stand beside those of the kinds below
    model_config = ConfigDict(extra="allow", json_schema_extra={"additionalProperties": False})

    kind: Annotated[str, Quantity(takes=f"{one_of(KINDS)}, or the kind of a package")] = Field(
        default="none",
        description="Kind of controller; custom: one that is passed to crinoid.simulate.",
    )
    rate_hz: Hertz | None = Field(
        default=None, gt=0, description=f"Commands a second; {DEFAULT_RATE}."
    )
    start: Seconds = Field(
        default=0.0,
        ge=0,
        description="When it is switched on; its inputs rest until then. The error at that time "
        "comes in over the first period of the arm, without a jolt.",
    )
    controlled: Annotated[
        tuple[Coordinate, ...],
        AsTuple,
        Field(min_length=1),
        Quantity(
            takes=f"a list of {one_of(COORDINATES[2], 'and')}",
            in_space=f"a list of {one_of(COORDINATES[3], 'and')}",
        ),
        InSpace(("x", "y", "z")),
    ] = Field(default=("x", "z"), description="Coordinates of the tip to bring to the target.")
    mapping: Literal["static-jacobian", "identity"] = Field(
        default="static-jacobian",
        description="From errors of the tip to inputs: through the tip's response at rest, "
        "or one to one (x to slide, z to heave, angle to tilt; in space x, y and z to slide, sway "
        "and heave).",
    )
    compare: bool = Field(
        default=True, description="Whether to run the same case with the controller off as well."
    )
    pid: Pid = Field(default=Pid(), description="Settings of kind pid: gains by input.")
    lqg: Lqg = Field(default=Lqg(), description="Settings of kind lqg.")
    hybrid: Hybrid = Field(default=Hybrid(), description="Settings of kind hybrid.")
    mpc: Mpc = Field(default=Mpc(), description="Settings of kind mpc.")
    neural: Neural = Field(default=Neural(), description="Settings of kind neural.")

    def __init__(self, /, **data: Any) -> None:
        known, brought, mistakes = type(self).model_fields, installed("controllers"), []
        kind = data.get("kind", "none")
        if isinstance(kind, str) and kind not in KINDS:
            if kind in brought:
                data.setdefault(kind, {})
            else:
                text = f"got {shown(kind)}, takes {one_of((*KINDS, *brought))}"
                mistakes.append(Mistake("kind", text))
        for name in data.keys() - known:
            if name not in brought:
                if name == kind:
                    continue  # it has been said
                mistakes.append(unknown_key(type(self), name))
                continue
            try:
                table = installed_table("controllers", name, ControllerTable)
            except ScenarioError as error:
                mistakes += error.mistakes
                continue
            given = data[name]
            if not isinstance(given, (Mapping, table)):
                mistakes.append(Mistake(name, f"got {shown(given)}, takes a table"))
                continue
            try:
                data[name] = given if isinstance(given, table) else table(**given)
            except ScenarioError as error:
                mistakes += [mistake.under(name) for mistake in error.mistakes]
        if mistakes:
            raise ScenarioError(mistakes)
        super().__init__(**data)

    @property
    def settings(self) -> Any:
        """The table of the chosen kind."""
        return getattr(self, self.kind)

    def _conflicts(self) -> Iterator[Mistake]:
        if len(set(self.controlled)) < len(self.controlled):
            yield Mistake("controlled", f"got {shown(self.controlled)}, takes each one once")
        if self.kind == "pid" and not self.pid.present:
            yield Mistake("pid", 'missing, kind = "pid" takes gains for at least one input')
        if self.kind == "neural" and self.neural.weights is None:
            text = 'missing, kind = "neural" takes a file that crinoid train wrote'
            yield Mistake("neural.weights", text)
        if self.kind == "lqg" and self.mapping == "identity":
            yield Mistake("mapping", 'got "identity", goes with kind = "pid"; takes none here')
