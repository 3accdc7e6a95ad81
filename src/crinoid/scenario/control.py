"""The controller of a scenario: its kind, rate and controlled coordinates."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from crinoid.foundation.axes import AXES
from crinoid.scenario import controller
from crinoid.scenario.controller import ControllerTable
from crinoid.scenario.errors import Mistake, ScenarioError, got, missing, one_of
from crinoid.scenario.kinds import installed, installed_table
from crinoid.scenario.model import Model, entry, unknown_key
from crinoid.scenario.quantity import AsTuple, Hertz, InSpace, ListOf, Quantity, Seconds
from crinoid.scenario.sensor import DEFAULT_RATE

KINDS = ("none", "pid", "lqg", "hybrid", "mpc", "neural", "sequence", "custom")
COORDINATES = {2: (*AXES[2], "angle"), 3: (*AXES[3], "direction")}
"""Coordinates of the tip that a controller can control, by the number of axes."""

# spelled out for the type checker: those of the plane and of space
Coordinate = Annotated[
    Literal["x", "y", "z", "angle", "direction"],
    Quantity(expects=one_of(COORDINATES[2]), in_space=one_of(COORDINATES[3])),
]


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
    pid: controller.Pid = entry(controller.Pid(), "Settings of kind pid: gains by input.")
    lqg: controller.Lqg = entry(controller.Lqg(), "Settings of kind lqg.")
    hybrid: controller.Hybrid = entry(controller.Hybrid(), "Settings of kind hybrid.")
    mpc: controller.Mpc = entry(controller.Mpc(), "Settings of kind mpc.")
    neural: controller.Neural = entry(controller.Neural(), "Settings of kind neural.")
    sequence: ListOf[controller.Phase] = entry((), "Phases of kind sequence.")

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
    def settings(self) -> ControllerTable:
        """The chosen kind, with its settings."""
        apart = {"none": controller.Idle(), "sequence": controller.Sequence(phases=self.sequence)}
        # a custom one has no table
        return apart.get(self.kind, getattr(self, self.kind, ControllerTable()))

    @property
    def acts(self) -> bool:
        """Whether there is a controller."""
        return self.kind != "none"

    @property
    def compared(self) -> bool:
        """Whether the same case also runs with the controller off."""
        return self.acts and self.compare

    @property
    def gains(self) -> dict[str, controller.PidGains]:
        """Gains of a PID controller by input; none under another kind."""
        return self.pid.present if self.kind == "pid" else {}

    @property
    def policy(self) -> str | None:
        """File of the policy of a neural controller; None under another kind."""
        return self.neural.weights if self.kind == "neural" else None

    def _conflicts(self) -> Iterator[Mistake]:
        if len(set(self.controlled)) < len(self.controlled):
            yield self.mistake("controlled", "have each coordinate once")
        if self.kind == "pid" and not self.pid.present:
            hint = "Add control.pid.slide.kp and base.channels.slide, or control.pid.NAME.kp with "
            hint += "the name of a chamber or tendon."
            yield Mistake("pid", missing('have gains of an input with kind = "pid"', hint))
        if self.kind == "neural" and self.neural.weights is None:
            text = missing('be a file of crinoid train with kind = "neural"')
            yield Mistake("neural.weights", text)
        if self.kind == "sequence" and not self.sequence:
            yield Mistake("sequence", missing('have a phase with kind = "sequence"'))
        if self.kind == "lqg" and self.mapping == "identity":
            yield Mistake("mapping", got("identity", 'be left out with kind = "lqg"'))
