"""From the description of a target to where the tip should be at any time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array
from crinoid.control import Carrier, Line, Orbit, Target
from crinoid.dynamics import System
from crinoid.onset import Onset
from crinoid.scenario import Scenario
from crinoid.scenario import Target as TargetTable
from crinoid.scenario.quantity import unit_vector
from crinoid.spline import PiecewisePolynomial, between, shape_preserving

if TYPE_CHECKING:
    from crinoid.recording import Series  # xarray, slow to load

_RAMP_TIME = 1.0
_ALONG = 1e-6
"""Sine of an angle below which two directions are one."""

Vector = Float[np.ndarray, " d"]


def build_target(
    scenario: Scenario, path: Series | None, system: System, tip: Float[Array, " pose"]
) -> Target:
    """Return the target of a scenario for an arm whose tip has a pose at t = 0.

    ``path`` is what its file holds, if it names one.
    """
    target, axes = scenario.target, scenario.arm.dimension
    carrier = None
    if target.frame == "base":
        carrier = Carrier(system.base, system.forces.origin)
        tip = carrier.seen(tip, jnp.zeros(()))
    fixed = np.array(tip)
    if isinstance(target.tip, tuple) and target.tip_path is None:
        fixed[:axes] = target.tip
    turns, steady = _pointing(target, axes)
    if steady is not None:
        fixed[axes:] = steady
    places, pointing = tuple(range(axes)), tuple(range(axes, fixed.size))
    if target.path in ("circle", "sine", "line"):
        return Target(array(fixed), _formula(target, fixed[:axes]), places, carrier)
    if path is not None:
        times, points = path.time, path.values
        moving = (places + pointing)[: points.shape[1]]
    else:
        given = [(places, target.tip_path), (pointing, turns)]
        listed = [(where, points) for where, points in given if points is not None]
        if not listed:
            return Target(array(fixed), None, (), carrier)
        moving = tuple(index for where, _ in listed for index in where)
        times = np.asarray(target.time)
        points = np.concatenate([points for _, points in listed], axis=1)
    # whole at its end: the feed-forward looks ahead
    curve = between(shape_preserving(times, points), 0.0, np.inf)
    return Target(array(fixed), PiecewisePolynomial(curve), moving, carrier)


def _pointing(
    target: TargetTable, axes: int
) -> tuple[Float[np.ndarray, "time angle"] | None, Float[np.ndarray, " angle"] | None]:
    """Return where the tip should point, along a path or steadily, where the scenario says it."""
    if axes == 2:
        if target.angle_path_deg is not None:
            return np.deg2rad(target.angle_path_deg)[:, None], None
        if isinstance(target.angle_deg, str):
            return None, None
        return None, np.deg2rad([target.angle_deg])
    if target.direction_path is not None:
        return np.asarray(target.direction_path), None
    steady = target.steady_direction
    return None, None if steady is None else np.asarray(steady)


def _formula(target: TargetTable, begin: Vector) -> PiecewisePolynomial | Orbit | Line:
    start = target.start or 0.0
    if target.to is not None:
        from scipy.interpolate import BPoly, PPoly  # slow to load, and often not needed

        # the least jerk from rest to rest (Flash and Hogan, J. Neurosci. 5 (1985) 1688-1703)
        still = np.zeros_like(begin)
        ends = [[begin, still, still], [np.asarray(target.to), still, still]]
        times = [start, start + (target.travel_time or 0.0)]
        return PiecewisePolynomial(PPoly.from_bernstein_basis(BPoly.from_derivatives(times, ends)))
    onset = Onset.of(start, _RAMP_TIME if target.ramp_time is None else target.ramp_time)
    if target.velocity is not None:
        return Line(array(begin), array(target.velocity), onset)
    if target.amplitude is not None:
        cosine, sine = np.zeros_like(begin), np.asarray(target.amplitude)
        rate = 2 * np.pi * (target.frequency_hz or 0.0)
    else:
        cosine, sine = (target.radius or 0.0) * _plane_of(target, begin.size)
        rate = 2 * np.pi / (target.period or np.inf)
    phase = np.deg2rad(target.phase_deg or 0.0)
    centre = begin - np.cos(phase) * cosine - np.sin(phase) * sine
    if target.centre is not None:
        centre = np.asarray(target.centre)
    return Orbit(
        array(centre),
        array(cosine),
        array(sine),
        array(rate),
        array(phase),
        onset,
    )


def _plane_of(target: TargetTable, axes: int) -> Float[np.ndarray, "2 d"]:
    """Return unit vectors from a circle's centre to its beginning, and a quarter of a turn on."""
    if axes == 2:
        return np.eye(2)
    normal = np.asarray(unit_vector(target.normal or (0.0, -1.0, 0.0)))
    for axis in np.eye(3):  # x, or y where the normal is along x
        first = axis - (axis @ normal) * normal
        length = np.linalg.norm(first)
        if length > _ALONG:
            return np.stack([first / length, np.cross(normal, first / length)])
    raise AssertionError("no vector is along both x and y")
