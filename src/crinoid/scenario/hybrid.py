"""Settings of the hybrid controller, and what it takes of the rest of a scenario."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from pydantic import Field

from crinoid.scenario.errors import Mistake, shown
from crinoid.scenario.model import Model
from crinoid.scenario.quantity import Degrees
from crinoid.scenario.sensor import InclinationSensor

if TYPE_CHECKING:
    from crinoid.scenario.scenario import Scenario

__all__ = ["Hybrid", "hybrid_conflicts"]


class Hybrid(Model):
    """A controller that swings a hanging arm up, catches it and balances it upright."""

    modes: int = Field(
        default=5,
        ge=2,
        le=20,
        description="Slowest modes of the upright arm that it knows, up to as many as the "
        "inclination sensor has stations; those above a quarter of control.rate_hz are left out.",
    )
    catch_deg: Degrees = Field(
        default=60.0, gt=0, lt=90, description="Lean of the arm up to which it is caught."
    )
    release_deg: Degrees = Field(
        default=80.0,
        gt=0,
        le=180,
        description="Lean of the arm beyond which it is given up and swung up again.",
    )

    def _conflicts(self) -> Iterator[Mistake]:
        if self.release_deg <= self.catch_deg:
            text = f"got {self.release_deg}, takes more than catch_deg = {self.catch_deg} (degrees)"
            yield Mistake("release_deg", text)


def hybrid_conflicts(scenario: Scenario) -> Iterator[Mistake]:
    """Yield what does not go with a hybrid controller, where one is chosen."""
    if scenario.control.kind != "hybrid":
        return
    arm, base = scenario.arm, scenario.base
    goes = 'goes with another control.kind: "hybrid" takes'
    if arm.dimension == 3:
        yield Mistake("arm.dimension", f"got 3, {goes} an arm in the plane")
        return
    if base.channels.slide is None:
        text = 'missing, takes a table: control.kind = "hybrid" drives this channel'
        yield Mistake("base.channels.slide", text)
    elif base.channels.slide.range[0] == 0 or base.channels.slide.range[1] == 0:
        text = f"got {shown(base.channels.slide.range)}, {goes} travel to both sides of 0"
        yield Mistake("base.channels.slide.range", text)
    if base.mount != "clamped":
        yield Mistake("base.mount", f'got {shown(base.mount)}, {goes} "clamped"')
    if not math.isclose(base.tilt_deg, 90.0):
        yield Mistake("base.tilt_deg", f"got {base.tilt_deg}, {goes} 90: an arm held upright")
    if arm.rest_curvature != 0.0:
        yield Mistake("arm.rest_curvature", f"got {shown(arm.rest_curvature)}, {goes} 0")
    for name, there in (
        ("vehicle", scenario.vehicle is not None),
        ("tool", scenario.tool is not None),
        ("chamber", bool(scenario.chamber)),
        ("tendon", bool(scenario.tendon)),
    ):
        if there:
            yield Mistake(name, f"{goes} none")
    sensor = inclinations(scenario)
    if sensor is None:
        text = 'missing an entry of kind = "inclination", by which control.kind = "hybrid" sees'
        yield Mistake("sensors", text)
        return
    index, modes = scenario.sensors.index(sensor), scenario.control.hybrid.modes
    if len(sensor.stations) < modes:
        text = f"got {len(sensor.stations)} of them, takes {modes} or more: control.hybrid.modes"
        yield Mistake(f"sensors.{index}.stations", text)
    if modes > arm.nodes - 1:
        text = f"got {modes}, takes up to {arm.nodes - 1}: less than arm.nodes"
        yield Mistake("control.hybrid.modes", text)
    rate = scenario.rate_hz(sensor.rate_hz)
    if rate < scenario.control_rate_hz * (1 - 1e-9):
        text = f"got {rate:g}, takes {scenario.control_rate_hz:g} or more (Hz): a reading for each "
        yield Mistake(f"sensors.{index}.rate_hz", f"{text}command of the hybrid controller")


def inclinations(scenario: Scenario) -> InclinationSensor | None:
    """Return the sensor that a hybrid controller sees by: the first of inclinations."""
    return next((each for each in scenario.sensors if isinstance(each, InclinationSensor)), None)
