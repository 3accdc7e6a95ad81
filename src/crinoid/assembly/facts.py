"""Quantities that follow from a scenario without a run: sizes, stiffness, speeds, periods."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from crinoid.recording.recording import base_travel
from crinoid.scenario import (
    GaussMarkovFlow,
    GustFlow,
    MeasuredFlow,
    SeaState,
    ShearFlow,
    SineFlow,
    SurfaceWaves,
    TurbulenceFlow,
    UniformFlow,
)
from crinoid.scenario.flow import Flow

if TYPE_CHECKING:
    from crinoid.assembly.prepared import Prepared

_AIR = (1.1, 1.4)  # densities of air, from a hot day to a cold one (kg/m3)
_NO_END = 0.54  # mass ratio up to which lock-in has no end
_RARE = 2.0  # standard deviations that a random quantity seldom exceeds


class Facts:
    """Derived quantities of a scenario, each computed once. SI units and radians."""

    def __init__(self, prepared: Prepared) -> None:
        self.prepared, self.scenario = prepared, prepared.scenario
        arm, water = self.scenario.arm, self.scenario.water
        self.length = arm.length
        self.edge = arm.length / (arm.nodes - 1)
        given = arm.radius
        self.radii = given if isinstance(given, tuple) else (given, given)  # at root and tip (m)
        self.wet = water.density > 0 and not _AIR[0] <= water.density <= _AIR[1]
        """Whether the arm is in water rather than in air or nothing."""

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
            given = np.array(section.EI)
            if given.ndim == self.scenario.arm.dimension - 1:
                ends = given.reshape(2, -1).min(axis=1)
                bending = np.interp(at, [0.0, 1.0], ends)
            else:
                bending = np.full(at.shape, np.min(given))
        if section.EA is not None:
            stretching = np.interp(at, [0.0, 1.0], np.broadcast_to(section.EA, 2))
        return bending, stretching

    @cached_property
    def mass(self) -> Float[np.ndarray, " ends"]:
        """Mass per length at root and tip, without the water (kg/m)."""
        given, density = self.scenario.arm.section.mass_per_length, self.scenario.arm.density
        round_mass = density * math.pi * np.array(self.radii) ** 2
        return round_mass if given is None else np.full(2, given)

    @cached_property
    def displaced(self) -> Float[np.ndarray, " ends"]:
        """Mass of the water displaced per length at root and tip (kg/m)."""
        given, density = self.scenario.arm.section.displaced_area, self.scenario.water.density
        round_mass = density * math.pi * np.array(self.radii) ** 2
        return round_mass if given is None else np.full(2, density * given)

    @property
    def lock_in(self) -> tuple[float, float]:
        """Reduced velocities between which shedding follows a vibration.

        Those of synchronisation, where the scenario has it; else from 4 (Williamson and Govardhan
        2004) to ``9.25 sqrt((m + 1) / (m - 0.54))`` at a mass ratio ``m`` (Govardhan and Williamson
        2000, Journal of Fluid Mechanics 420, eq. 5.4 and 5.5).
        """
        vortices = self.scenario.water.vortices
        if vortices is not None and (numbers := vortices.numbers).get("range"):
            ends = (numbers["centre"] + sign * numbers["range"] for sign in (1, -1))
            return 1 / next(ends), 1 / next(ends)
        mass, displaced = float(self.mass.mean()), float(self.displaced.mean())
        if mass <= _NO_END * displaced:
            return 4.0, math.inf
        return 4.0, 9.25 * math.sqrt((mass + displaced) / (mass - _NO_END * displaced))

    @cached_property
    def diameter(self) -> float:
        """Largest diameter that the water sees (m)."""
        given = self.scenario.arm.section.diameter
        return 2 * max(self.radii) if given is None else given

    def limpness(self, load: float, power: int) -> float:
        """Return a load times a power of the length over the bending stiffness."""
        return load * self.length**power / float(self.bending.max())

    @cached_property
    def swung(self) -> Float[np.ndarray, " ends"]:
        """Mass per length with the added mass of the water, at root and tip (kg/m)."""
        return self.mass + self.scenario.water.added_mass_normal * self.displaced

    @cached_property
    def frequencies(self) -> Float[np.ndarray, " mode"]:
        """Natural frequencies of bending in water, slowest first (Hz); an estimate."""
        return bending_frequencies(
            self.length,
            self.bending,
            self.swung,
            taper=self.radii[1] / self.radii[0],
            linear=self.scenario.arm.section.EI is not None,
            clamped=self.scenario.base.mount == "clamped",
            tip=self.tip,
        )

    @cached_property
    def tip(self) -> Float[np.ndarray, "2 2"] | None:
        """Inertia of the tool, with added mass, if the tip has it from the start."""
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

    def modulus(self, rate: float) -> complex:
        """Return the complex modulus of the material at a rate (rad/s), over the relaxed one."""
        arm, found = self.scenario.arm, 1.0 + 1j * rate * self.scenario.arm.damping_time
        if arm.loss_factor is not None:
            found += 1j * arm.loss_factor.value
        for branch in arm.relaxation:
            found += branch.ratio * 1j * rate * branch.time / (1 + 1j * rate * branch.time)
        return found

    @cached_property
    def damping_ratio(self) -> float:
        """Damping ratio of the slowest vibration by the material."""
        found = self.modulus(2 * math.pi / self.period)
        return 0.5 * found.imag / found.real

    @cached_property
    def direction(self) -> tuple[float, ...]:
        """Unit vector along which the base points the arm."""
        pan, tilt, _ = self.scenario.base.angles
        x, y, z = math.cos(tilt) * math.cos(pan), math.cos(tilt) * math.sin(pan), math.sin(tilt)
        return (math.cos(tilt), z) if self.scenario.arm.dimension == 2 else (x, y, z)

    @cached_property
    def travel(self) -> float:
        """How far channels and prescribed motions may shift the base (m)."""
        return base_travel(self.scenario, self.prepared.series)

    @cached_property
    def speeds(self) -> dict[int, float]:
        """Speed that each flow hardly exceeds, by its index (m/s)."""
        sampled = {
            index: float(np.linalg.norm(velocity, axis=-1).max(initial=0.0))
            for index, velocity in self.sampled.items()
        }
        return self._known_speeds | sampled

    @cached_property
    def _known_speeds(self) -> dict[int, float]:
        known = {i: self._fastest(i, flow) for i, flow in enumerate(self.scenario.flow)}
        return {index: speed for index, speed in known.items() if speed is not None}

    def sea_state(self, index: int, waves: SurfaceWaves) -> SeaState:
        """Return the size of the surface waves at ``index`` of the flows."""
        return waves.state or waves.state_of(self.prepared.system.forces.water.flows[index])

    @property
    def current(self) -> float:
        """Speed that all flows together do not exceed for long (m/s)."""
        return math.fsum(self.speeds.values())

    @cached_property
    def mean_current(self) -> tuple[float, ...]:
        """Mean velocity of all flows together at full strength (m/s); gusts and waves have none."""
        total = np.zeros(self.scenario.arm.dimension)
        total += sum(velocity.mean(axis=0) for velocity in self.sampled.values() if velocity.size)
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
    def sampled(self) -> dict[int, Float[np.ndarray, "s d"]]:
        """Velocities near the arm of each flow without a known speed, by its index (m/s)."""
        if self.prepared.parts is None and len(self._known_speeds) == len(self.scenario.flow):
            return {}
        from crinoid.assembly.system import sampled_velocities  # JAX: slow to load, few need it

        flows = enumerate(self.prepared.system.forces.water.flows)
        return {
            index: np.concatenate(sampled_velocities(flow, self.scenario))
            for index, flow in flows
            if index not in self._known_speeds
        }

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

    def _fastest(self, index: int, flow: Flow) -> float | None:
        """Return the speed that a flow hardly exceeds (m/s); None if only samples show it."""
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
            case SurfaceWaves() if (state := flow.state) is not None:
                depth = max(0.0, -self.scenario.base.position[-1] - self.length)
                rate = 2 * math.pi / state.period
                number = rate**2 / max(self.scenario.water.gravity, 1e-9)
                return state.height / 2 * rate * math.exp(-number * depth)
            case MeasuredFlow():
                velocity = self.prepared.recordings[index].velocity
                return float(np.nanmax(np.linalg.norm(velocity, axis=-1)))
        return None


_PARTS = 24


def bending_frequencies(
    length: float,
    bending: Float[np.ndarray, " ends"],
    mass: Float[np.ndarray, " ends"],
    *,
    taper: float = 1.0,
    linear: bool = False,
    clamped: bool = True,
    tip: Float[np.ndarray, "2 2"] | None = None,
) -> Float[np.ndarray, " mode"]:
    """Return the natural frequencies of a straight cantilever, slowest first (Hz).

    An Euler beam in `_PARTS` finite elements with cubic shapes (Petyt 2010, Introduction to Finite
    Element Vibration Analysis, section 3.5). Weight, tension and curvature at rest are left out. A
    root that turns freely has no stiffness: its first frequency is 0 and not returned.

    Bending stiffness (N m2) and mass per length with added mass (kg/m) are those at root and tip;
    where they differ, they run as the fourth and second power of the radius, a stiffness that is
    ``linear`` as that. ``tip`` is the inertia
    of what the tip carries against shifts and turns: kg, kg m, kg m, kg m2.
    """
    size = length / _PARTS
    middle = (np.arange(_PARTS) + 0.5) / _PARTS
    radius = 1 + (taper - 1) * middle
    EI = bending[0] * (radius**4 if bending[0] != bending[1] else np.ones(_PARTS))
    if linear:
        EI = bending[0] + (bending[1] - bending[0]) * middle
    line = mass[0] * (radius**2 if mass[0] != mass[1] else np.ones(_PARTS))
    # of deflections and slopes times the element's length, at both its ends
    stiff = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    heavy = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    K, M = np.zeros((2, 2 * _PARTS + 2, 2 * _PARTS + 2))
    for part in range(_PARTS):
        at = slice(2 * part, 2 * part + 4)
        K[at, at] += EI[part] / size**3 * stiff
        M[at, at] += line[part] * size / 420 * heavy
    if tip is not None:
        lengths = np.array([1.0, size])
        M[-2:, -2:] += tip / np.outer(lengths, lengths)
    held = 2 if clamped else 1
    half = np.linalg.inv(np.linalg.cholesky(M[held:, held:]))
    squared = np.linalg.eigvalsh(half @ K[held:, held:] @ half.T)[2 - held :]
    return np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi)
