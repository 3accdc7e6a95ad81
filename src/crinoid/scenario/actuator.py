"""Actuators along the arm: chambers, tendons, and kinds of installed packages."""

import math
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from crinoid.foundation.axes import CHANNELS
from crinoid.scenario.arm import Arm
from crinoid.scenario.errors import Mistake, got, missing, shown
from crinoid.scenario.kinds import KindOf
from crinoid.scenario.model import Model, entry
from crinoid.scenario.quantity import (
    AsTuple,
    CubicMetres,
    Degrees,
    Metres,
    MetresPerSecond,
    Name,
    Newtons,
    Only,
    Pair,
    Pascals,
    PerMetre,
    Quantity,
    Seconds,
    SquareMetres,
    Times,
    length_conflicts,
    name_conflicts,
    span_conflicts,
    time_conflicts,
)


class ActuatorTable(Model):
    """Keys that every actuator has."""

    kind: str = Field(description="Kind of actuator, of an installed package.")
    name: Name = entry(None, "Name of its inputs; by default its kind.")

    @property
    def called(self) -> str:
        """Name of its inputs."""
        return self.name or self.kind

    def build(self, scenario: Any) -> Any:
        """Return the numbers of the actuator, `crinoid.ActuatorParameters`.

        ``scenario`` is the `crinoid.Scenario`.
        """
        raise NotImplementedError


Actuator = Annotated[ActuatorTable, KindOf("actuators", ActuatorTable)]


def actuator_conflicts(
    actuators: tuple[ActuatorTable, ...], threads: Iterable[str]
) -> Iterator[Mistake]:
    """Yield names that two actuators share, or that chambers, tendons or channels have."""
    names = {f"actuator.{index}": each.called for index, each in enumerate(actuators)}
    others = dict.fromkeys((*threads, *CHANNELS[3]), "a chamber, tendon or channel")
    yield from name_conflicts(names, others)


Shares = Annotated[tuple[float, ...], AsTuple, Quantity(expects="a list of numbers from -1 to 1")]
Offset = Annotated[
    float | Pair, Quantity("m", "a number, or a pair [at the root end, at the tip end]")
]


class Schedule(Model):
    """Shares of the largest drive over time, joined by straight lines."""

    time: Times = Field(
        description="Times; the share is constant before the first and after the last."
    )
    share: Shares = Field(description="Share of the largest, below 0 only of a pair.")

    def _conflicts(self) -> Iterator[Mistake]:
        yield from time_conflicts(self.time)
        yield from length_conflicts("share", self.share, self.time)
        for index, share in enumerate(self.share):
            if not -1 <= share <= 1:
                yield Mistake(f"share.{index}", got(share, "be a number from -1 to 1"))


_ADDED = "to which the schedule and the commands of a controller add"


class Thread(Model):
    """Keys that chambers and tendons share."""

    _ways: ClassVar[dict[str, dict[str, str]]]
    """Keys of each `drive`, with their values in words where they are required.

    The first is the drive at a share of 1, the second the drive that is always on, the last its
    greatest rate.
    """

    name: Name = entry(None, "Name of its input; by default chamber_0, tendon_0 and so on.")
    drive: str
    span: Pair = entry((0.0, 1.0), "Start and end, over the arm's length.")
    offset: Offset | None = entry(None, "Distance from the axis; a pair tapers along the span.")
    angle_deg: Degrees = entry(
        0.0,
        "Side of the axis: in the plane 0 above or 180 below an arm along x; in space the angle"
        " from m_1, to port, toward m_2, up.",
    )
    pair: bool = entry(
        False, "Whether it has a partner on the other side, driven by shares below 0."
    )
    time_constant: Seconds = entry(0.0, "Lag of first order.", ge=0)
    dead_band: float = entry(
        0.0, "Largest change of its share that it does not follow.", ge=0, lt=1
    )
    schedule: Schedule | None = entry(
        None, "Shares over time; the commands of a controller add to them."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        for drive, keys in self._ways.items():
            for key, needed in keys.items():
                value = getattr(self, key)
                if drive == self.drive and needed and value is None:
                    yield Mistake(key, missing(f"be {needed} with drive = {shown(drive)}"))
                if drive != self.drive and value != type(self).model_fields[key].default:
                    must = f"be left out with drive = {shown(self.drive)}"
                    yield Mistake(key, got(value, must, f"Set drive = {shown(drive)} to use it."))
        yield from span_conflicts("span", self.span)
        offsets = self.offset if isinstance(self.offset, tuple) else (self.offset or 0.0,)
        if min(offsets) < 0:
            yield self.mistake("offset", "be 0 or more (m)", "Choose the side by angle_deg.")
        constant, low = getattr(self, self.constant_key), getattr(self, "min_pressure", 0.0)
        most = getattr(self, self.largest_key) or math.inf
        low = -most if self.pair else low
        if constant is not None and not low <= constant <= most:
            must = f"be {low:g} to {self.largest_key} = {most:g}"
            yield Mistake(self.constant_key, got(constant, must))
        shares = self.schedule.share if self.schedule is not None and not self.pair else ()
        for index, share in enumerate(shares):
            if share < 0:
                hint = "Set pair = true for shares below 0."
                text = got(share, "be a number from 0 to 1", hint)
                yield Mistake(f"schedule.share.{index}", text)

    @property
    def lined(self) -> bool:
        """Whether its share sets a length or volume, from which its load follows."""
        return self.drive in ("length", "volume")

    @property
    def largest_key(self) -> str:
        """Key of the drive at a share of 1."""
        return next(iter(self._ways[self.drive]))

    @property
    def constant_key(self) -> str:
        """Key of the drive to which the schedule and commands add."""
        return list(self._ways[self.drive])[1]

    @property
    def constant(self) -> float:
        """That drive: Pa, m3, N or m."""
        return getattr(self, self.constant_key) or 0.0

    @property
    def largest(self) -> float:
        """Drive at a share of 1: Pa, m3, N or m."""
        return float(getattr(self, self.largest_key))

    @property
    def largest_rate(self) -> float | None:
        """Greatest rate of the drive (per second), if there is one."""
        rate: float | None = getattr(self, list(self._ways[self.drive])[-1])
        return rate


class Chamber(Thread):
    """A chamber whose fluid pushes along the arm: hydraulic or pneumatic."""

    _ways: ClassVar[dict[str, dict[str, str]]] = {
        "pressure": dict.fromkeys(
            ("max_pressure", "pressure", "min_pressure", "max_curvature", "stiffening", "max_rate"),
            "",
        ),
        "volume": {
            "max_volume": "a number above 0 (m3)",
            "volume": "",
            "bulk_modulus": "a number above 0 (Pa)",
            "max_flow": "",
        },
    }

    drive: Literal["pressure", "volume"] = entry(
        "pressure",
        "The quantity that its share scales: the pressure, or the volume of closed fluid, whose"
        " pressure follows from the arm's shape.",
    )
    area: SquareMetres | None = entry(None, "Area of its section.", gt=0)
    max_pressure: Pascals = entry(1e5, "Largest pressure above ambient.", gt=0)
    pressure: Pascals | None = entry(None, f"Constant pressure above ambient, {_ADDED}.")
    min_pressure: Pascals = entry(0.0, "Smallest pressure.", ge=0)
    max_rate: Annotated[float, Quantity("Pa/s")] | None = entry(
        None, "Greatest rate of the pressure.", gt=0
    )
    max_curvature: PerMetre | None = entry(
        None, "Curvature of a free arm at the largest pressure, instead of area and offset.", gt=0
    )
    stiffening: float = entry(
        0.0,
        "Bending stiffness that the largest pressure adds over the span, as a share of the arm's.",
        ge=0,
    )
    max_volume: CubicMetres | None = entry(None, "Volume of fluid that a share of 1 adds.", gt=0)
    volume: CubicMetres | None = entry(None, f"Constant volume of fluid, {_ADDED}.")
    bulk_modulus: Pascals | None = entry(
        None,
        "Stiffness of the closed fluid with its hoses: 2.2e9 of water alone; of a gas its "
        "absolute pressure at rest.",
        gt=0,
    )
    max_flow: Annotated[float, Quantity("m3/s")] | None = entry(
        None, "Greatest flow of the pump.", gt=0
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        for key, value in {"area": self.area, "offset": self.offset}.items():
            if self.max_curvature is None and value is None:
                yield Mistake(key, missing("be given without max_curvature"))
            if self.max_curvature is not None and value is not None:
                yield Mistake(key, got(value, "be left out with max_curvature"))
        if self.min_pressure >= self.max_pressure:
            yield self.mistake("min_pressure", f"be below max_pressure = {self.max_pressure} (Pa)")
        if self.pair and self.min_pressure:
            yield self.mistake("min_pressure", "be 0 with pair = true")


class Tendon(Thread):
    """A tendon that pulls along the arm."""

    _ways: ClassVar[dict[str, dict[str, str]]] = {
        "tension": {
            "max_tension": "a number above 0 (N)",
            "tension": "",
            "pretension": "",
            "max_rate": "",
        },
        "length": {
            "max_shortening": "a number above 0 (m)",
            "shortening": "",
            "stiffness": "a number above 0 (N)",
            "max_speed": "",
        },
    }

    drive: Literal["tension", "length"] = entry(
        "tension",
        "The quantity that its share scales: the tension, or the length that a winch pulls in; "
        "the tension then follows from the arm's shape, and is 0 where it is slack.",
    )
    max_tension: Newtons | None = entry(None, "Largest tension.", gt=0)
    tension: Newtons | None = entry(None, f"Constant tension, {_ADDED}.")
    pretension: Newtons = entry(
        0.0, "Tension at a share of 0, to which shares add; of a pair that of either tendon.", ge=0
    )
    max_rate: Annotated[float, Quantity("N/s")] | None = entry(
        None, "Greatest rate of the tension.", gt=0
    )
    max_shortening: Metres | None = entry(
        None,
        "Length that a share of 1 pulls in, of the path along the arm at rest; with pair = true"
        " the partner lengthens as much.",
        gt=0,
    )
    shortening: Metres | None = entry(None, f"Constant length that is pulled in, {_ADDED}.")
    stiffness: Newtons | None = entry(None, "Axial stiffness EA of the tendon.", gt=0)
    max_speed: MetresPerSecond | None = entry(None, "Greatest speed of the winch.", gt=0)
    friction: float = entry(
        0.0,
        "Coefficient of Coulomb friction in its channel: round a bend of an angle a the tension"
        " falls by exp(-friction a) while it is pulled, and rises while it is paid out.",
        ge=0,
    )
    twist_deg: Annotated[Degrees, Only(3)] = entry(
        0.0, "Turn about the axis over its span, from m_1 toward m_2."
    )

    def _conflicts(self) -> Iterator[Mistake]:
        yield from super()._conflicts()
        if self.offset is None:
            yield Mistake("offset", missing("be a number (m)"))


def keyed_threads(
    chambers: tuple[Chamber, ...], tendons: tuple[Tendon, ...]
) -> dict[str, Chamber | Tendon]:
    """Return chambers and tendons by their dotted keys."""
    keyed: dict[str, Chamber | Tendon] = {f"chamber.{i}": each for i, each in enumerate(chambers)}
    return keyed | {f"tendon.{i}": each for i, each in enumerate(tendons)}


def thread_name(key: str, thread: Thread) -> str:
    """Return the name of the input of a chamber or tendon with a dotted key."""
    return thread.name or key.replace(".", "_")


def thread_conflicts(
    chambers: tuple[Chamber, ...], tendons: tuple[Tendon, ...], arm: Arm
) -> Iterator[Mistake]:
    """Yield threads that the arm cannot have, and names that two inputs share.

    Their span needs a node that bends, their side must be in the plane of a planar arm, and their
    length or volume must fit.
    """
    bends = 1 - 0.5 / (arm.nodes - 1)
    threads = keyed_threads(chambers, tendons)
    for key, thread in threads.items():
        if thread.span[0] >= bends:
            must = f"begin below {bends:.6g}, half an edge before the tip, where the arm bends"
            yield Mistake(f"{key}.span", got(thread.span, must, "Try more arm.nodes"))
        if arm.dimension == 2 and thread.angle_deg % 180:
            hint = "Set arm.dimension = 3 for other sides."
            yield Mistake(f"{key}.angle_deg", got(thread.angle_deg, "be 0 or 180 (degrees)", hint))
        yield from (each.under(key) for each in _content_conflicts(thread, arm.length))
    channels = {name: f"base.channels.{name}" for name in CHANNELS[3]}
    names = {key: thread_name(key, thread) for key, thread in threads.items()}
    yield from name_conflicts(names, channels)


def _content_conflicts(thread: Chamber | Tendon, length: float) -> Iterator[Mistake]:
    """Yield more length or volume than the part of the arm along a thread can give."""
    most = (thread.span[1] - thread.span[0]) * length
    if isinstance(thread, Tendon):
        key, value, limit = "max_shortening", thread.max_shortening, "(m), the path of the tendon"
    else:
        key, limit = "max_volume", "(m3), the volume of the other chamber"
        value, most = thread.max_volume if thread.pair else None, most * (thread.area or math.inf)
    if value is not None and value >= most:
        yield Mistake(key, got(value, f"be below {most:g} {limit}"))
