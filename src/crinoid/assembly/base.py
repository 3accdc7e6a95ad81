"""From the description of a base to its channels, their servos and its prescribed motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array
from crinoid.base import Base, BaseMotion, Servo, SineMotion, TableMotion, VelocityMotion
from crinoid.onset import Onset
from crinoid.reference import Reference
from crinoid.scenario import Scenario
from crinoid.scenario import motion as motions
from crinoid.space import CHANNELS
from crinoid.spline import PiecewisePolynomial, between, shape_preserving

if TYPE_CHECKING:
    from crinoid.recording import Series  # xarray, slow to load


class BaseParameters(eqx.Module):
    """The numbers of ``[base]``, its channels and its prescribed motion."""

    position: Float[Array, " d"]
    angles: Float[Array, " angle"]
    """``tilt_deg``, in space ``pan_deg``, ``tilt_deg`` and ``roll_deg`` (rad)."""
    servo: Servo
    """Limits and bandwidths, one a channel."""
    motion: tuple[BaseMotion, ...]
    mount: str = eqx.field(static=True)

    @staticmethod
    def of(scenario: Scenario, series: Mapping[str, Series]) -> BaseParameters:
        """Return the numbers of a scenario's base; ``series`` by table, from its files."""
        base, duration = scenario.base, scenario.simulation.duration
        axes = scenario.arm.dimension
        channels = CHANNELS[axes]
        return BaseParameters(
            position=array(base.position),
            angles=array(base.angles if axes == 3 else [np.deg2rad(base.tilt_deg)]),
            servo=_servo(scenario),
            motion=tuple(
                _motion(motion, channels, series.get(f"base.motion.{index}"), duration)
                for index, motion in enumerate(base.motion)
            ),
            mount=base.mount,
        )

    def base(self, reference: Reference) -> Base:
        """Build the base that holds an arm; traceable."""
        return Base(
            angles=self.angles,
            ghost_length=reference.rest_length[0],
            servo=self.servo,
            motions=self.motion,
        )


def _servo(scenario: Scenario) -> Servo:
    # a channel that nobody drives has no room to move and any limits
    channels = CHANNELS[scenario.arm.dimension]
    lower, upper, speed, acceleration, bandwidth = np.array(
        [[number] * len(channels) for number in (0.0, 0.0, 1.0, 1.0, 1.0)]
    )
    for name, channel in scenario.base.channels.present.items():
        index = channels.index(name)
        limits = channel.limits
        lower[index], upper[index] = limits.low, limits.high
        speed[index], acceleration[index] = limits.speed, limits.acceleration
        bandwidth[index] = limits.bandwidth_hz
    return Servo(*map(array, (lower, upper, speed, acceleration, bandwidth)))


def _motion(
    motion: motions.Motion, channels: tuple[str, ...], series: Series | None, duration: float
) -> BaseMotion:
    channel = channels.index(motion.channel)
    if isinstance(motion, motions.SineMotion):
        return SineMotion(
            channel,
            array(motion.amplitude_si),
            array(motion.frequency_hz),
            array(np.deg2rad(motion.phase_deg)),
        )
    if isinstance(motion, motions.VelocityMotion):
        onset = Onset(*map(array, (motion.start, motion.ramp_time, np.inf)))
        return VelocityMotion(channel, onset, array(motion.velocity_si))
    if series is not None:
        times, values = series.time, series.values[:, 0]
    else:
        assert isinstance(motion, motions.TableMotion)
        times, values = np.asarray(motion.time), np.asarray(motion.value_si)
    if motion.interpolation == "monotone":
        curve = shape_preserving(times, values)
    else:
        from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

        curve = CubicSpline(times, values)
    if series is not None:
        curve = between(curve, 0.0, duration)  # of a long record
    return TableMotion(channel, PiecewisePolynomial(curve))
