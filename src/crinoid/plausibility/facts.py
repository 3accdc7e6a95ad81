"""Numbers that follow from a description at once: sizes, stiffness, speeds and periods."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.assembly.prepared import Prepared
from crinoid.plausibility.vibration import bending_frequencies
from crinoid.scenario import (
    GaussMarkovFlow,
    GustFlow,
    MeasuredFlow,
    ShearFlow,
    SineFlow,
    TurbulenceFlow,
    UniformFlow,
    WavesFlow,
)
from crinoid.scenario.flow import Flow
from crinoid.scenario.kinds import is_own
from crinoid.scenario.motion import FileMotion
from crinoid.space import CHANNEL_TABLE

if TYPE_CHECKING:
    from crinoid.assembly.samples import Foreign  # JAX: slow to load

_AIR = (1.1, 1.4)
"""Densities of air, from a hot day to a cold one (kg/m3)."""
_RARE = 2.0
"""Standard deviations by which what is random is seldom exceeded."""


class Facts:
    """Numbers that several rules look at, each worked out once. SI units and radians."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared, self.scenario = prepared, prepared.scenario
        scenario = self.scenario
        arm, water = scenario.arm, scenario.water
        self.length = arm.length
        self.edge = arm.length / (arm.nodes - 1)
        given = arm.radius
        self.radii = given if isinstance(given, tuple) else (given, given)
        """At root and tip (m)."""
        self.wet = water.density > 0 and not _AIR[0] <= water.density <= _AIR[1]
        """Whether the arm is in water rather than in air or nothing."""
        self.in_air = water.density > 0 and not self.wet

    @cached_property
    def bending(self) -> Float[np.ndarray, " ends"]:
        """Bending stiffness at root and tip, the softer way (N m2)."""
        return self.stiffness(np.array([0.0, 1.0]))[0]

    @cached_property
    def stretching(self) -> float:
        """Axial stiffness where it is least (N)."""
        return float(self.stiffness(np.array([0.0, 1.0]))[1].min())

    def stiffness(
        self, at: Float[np.ndarray, " at"]
    ) -> tuple[Float[np.ndarray, " at"], Float[np.ndarray, " at"]]:
        """Return bending (N m2), the softer way, and axial stiffness (N), at ``at`` of the arm."""
        section, modulus = self.scenario.arm.section, self.scenario.arm.youngs_modulus
        radius = np.interp(at, [0.0, 1.0], self.radii)
        bending, stretching = modulus * math.pi / 4 * radius**4, modulus * math.pi * radius**2
        if section.EI is not None:
            bending = np.full(at.shape, np.min(section.EI))
        return bending, np.full(at.shape, section.EA) if section.EA else stretching

    @cached_property
    def mass(self) -> Float[np.ndarray, " ends"]:
        """Mass per length at root and tip, without the water (kg/m)."""
        given = self.scenario.arm.section.mass_per_length
        if given is not None:
            return np.full(2, given)
        return self.scenario.arm.density * math.pi * np.array(self.radii) ** 2

    @cached_property
    def displaced(self) -> Float[np.ndarray, " ends"]:
        """Mass of the water displaced per length at root and tip (kg/m)."""
        given, density = self.scenario.arm.section.displaced_area, self.scenario.water.density
        if given is not None:
            return np.full(2, density * given)
        return density * math.pi * np.array(self.radii) ** 2

    @cached_property
    def diameter(self) -> float:
        """Largest diameter that the water sees (m)."""
        given = self.scenario.arm.section.diameter
        return 2 * max(self.radii) if given is None else given

    @cached_property
    def swung(self) -> Float[np.ndarray, " ends"]:
        """Mass per length with added mass at root and tip (kg/m)."""
        return self.mass + self.scenario.water.added_mass_normal * self.displaced

    @cached_property
    def frequencies(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies of bending in water, slowest first (Hz); an estimate."""
        clamped = self.scenario.base.mount == "clamped"
        taper = self.radii[1] / self.radii[0]
        return bending_frequencies(
            self.length, self.bending, self.swung, taper=taper, clamped=clamped, tip=self.tip
        )

    @cached_property
    def tip(self) -> Float[np.ndarray, "2 2"] | None:
        """Inertia of the tool, with added mass, where the arm holds one from the start."""
        tool = self.scenario.tool
        if tool is None or tool.from_ > 0 or tool.take_at_touch is not None:
            return None
        mass, offset = tool.mass + tool.added_mass, tool.offset
        about = tool.inertia[1] if isinstance(tool.inertia, tuple) else tool.inertia
        return np.array([[mass, mass * offset], [mass * offset, about + mass * offset**2]])

    @cached_property
    def period(self) -> float:
        """Period of the slowest of them (s)."""
        return float(1 / self.frequencies[0])

    @cached_property
    def direction(self) -> tuple[float, ...]:
        """Unit vector along which the base points the arm."""
        base = self.scenario.base
        pan, tilt, _ = base.angles
        if self.scenario.arm.dimension == 2:
            return (math.cos(tilt), math.sin(tilt))
        return (
            math.cos(tilt) * math.cos(pan),
            math.cos(tilt) * math.sin(pan),
            math.sin(tilt),
        )

    @cached_property
    def travel(self) -> float:
        """How far channels and prescribed motion may shift the base (m)."""
        base = self.scenario.base
        driven = [
            max(-channel.limits.low, channel.limits.high)
            for name, channel in base.channels.present.items()
            if name in _SHIFTS
        ]
        duration = self.scenario.simulation.duration
        carried = [
            # where a file takes it is not known here
            math.inf if isinstance(motion, FileMotion) else motion.farthest(duration)
            for motion in base.motion
            if motion.channel in _SHIFTS
        ]
        return math.hypot(*driven) + math.hypot(*carried)

    @cached_property
    def current(self) -> float:
        """Speed that all flows together do not exceed for long (m/s)."""
        known = {i: self.fastest(i, flow) for i, flow in enumerate(self.scenario.flow)}
        return math.fsum((known | self.foreign_speeds).values())

    @cached_property
    def foreign_speeds(self) -> dict[int, float]:
        """Largest sampled speed of each flow of another package, by its index (m/s)."""
        velocities = self.foreign[0].items()
        return {i: float(np.linalg.norm(v, axis=-1).max(initial=0.0)) for i, v in velocities}

    @cached_property
    def mean_current(self) -> tuple[float, ...]:
        """Mean velocity of all flows together at full strength (m/s); gusts and waves have none."""
        total = np.zeros(self.scenario.arm.dimension)
        total += sum(
            velocity.mean(axis=0) for velocity in self.foreign[0].values() if velocity.size
        )
        for index, flow in enumerate(self.scenario.flow):
            match flow:
                case UniformFlow() | ShearFlow():
                    total += flow.velocity
                case GaussMarkovFlow() | TurbulenceFlow():
                    total += flow.mean
                case MeasuredFlow():
                    total += np.nanmean(self.prepared.recordings[index].velocity, axis=(0, 1))
        return tuple(map(float, total))

    @cached_property
    def foreign(self) -> Foreign:
        """Flows and elements of other packages, as ``crinoid.assembly.samples`` finds them."""
        tables = (*self.scenario.flow, *self.scenario.load, *self.scenario.actuator)
        if self.prepared.parts is None and all(map(is_own, tables)):
            return {}, {}
        from crinoid.assembly.samples import foreign  # JAX: slow to load, few need it

        return foreign(self.prepared.system, self.scenario)

    @cached_property
    def waters(self) -> dict[str, tuple[float, ...]]:
        """Steady currents that a loop is judged in, by name (m/s): drag damps each differently.

        The mean current, and still water where the current varies by as much as its mean.
        """
        mean, speed = self.mean_current, math.hypot(*self.mean_current)
        at_rest = {"still water": (0.0,) * len(mean)}
        if not speed:
            return at_rest
        return {"the mean current": mean} | (at_rest if self.current >= 2 * speed else {})

    def fastest(self, index: int, flow: Flow) -> float:
        """Return the speed that a flow hardly exceeds (m/s)."""
        match flow:
            case UniformFlow() | ShearFlow() | GustFlow():
                return math.hypot(*flow.velocity)
            case SineFlow():
                return math.hypot(*flow.amplitude)
            case GaussMarkovFlow():
                spread = flow.standard_deviation
                spread = spread if isinstance(spread, tuple) else (spread,)
                return math.hypot(*flow.mean) + _RARE * max(spread)
            case TurbulenceFlow():
                return math.hypot(*flow.mean) * (1 + _RARE * flow.intensity)
            case WavesFlow():
                depth = max(0.0, -self.scenario.base.position[-1] - self.length)
                rate = 2 * math.pi / flow.peak_period
                number = rate**2 / max(self.scenario.water.gravity, 1e-9)
                return flow.significant_height / 2 * rate * math.exp(-number * depth)
            case MeasuredFlow():
                velocity = self.prepared.recordings[index].velocity
                return float(np.nanmax(np.linalg.norm(velocity, axis=-1)))
        return 0.0


_SHIFTS = tuple(channel.name for channel in CHANNEL_TABLE if not channel.turns)
