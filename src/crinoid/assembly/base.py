"""Base: its numbers, and the arrays that follow from these."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.arrays import array
from crinoid.assembly.response import ResponseParameters
from crinoid.base import BaseMotion, Servo, SineMotion, TableMotion, VelocityMotion
from crinoid.flow import Flow
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.piecewise import PiecewisePolynomial, between, shape_preserving
from crinoid.numerics.ramp import Onset
from crinoid.scenario import Scenario
from crinoid.scenario import base_motion as motions
from crinoid.scenario.base import ChannelLimits
from crinoid.scenario.errors import gathered

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

    from crinoid.recording import Series, VesselResponse


class BaseParameters(eqx.Module):
    """The numbers of ``[base]``, its channels and its prescribed motion."""

    position: Float[Array, " d"]
    angles: Float[Array, " angle"]
    """``tilt_deg``, in space ``pan_deg``, ``tilt_deg`` and ``roll_deg`` (rad)."""
    servo: Servo
    """Limits and bandwidths, one a channel."""
    motion: tuple[BaseMotion | ResponseParameters, ...]
    mount: str = eqx.field(static=True)

    @staticmethod
    def of(
        scenario: Scenario, series: Mapping[str, Series | VesselResponse], flows: Sequence[Flow]
    ) -> BaseParameters:
        """Return the numbers of a scenario's base; ``series`` by table, from its files."""
        base, axes = scenario.base, scenario.arm.dimension
        return BaseParameters(
            position=array(base.position),
            angles=array(base.angles if axes == 3 else [np.deg2rad(base.tilt_deg)]),
            servo=_servo(scenario),
            motion=tuple(
                each
                for key, motion in ((f"base.motion.{i}", m) for i, m in enumerate(base.motion))
                for each in _motions(motion, scenario, flows, key, series.get(key))
            ),
            mount=base.mount,
        )

    def motions(self, flows: Sequence[Flow]) -> tuple[BaseMotion, ...]:
        """Return the prescribed motions, those of vessels in waves on their currents; traceable."""
        given = (
            each.motions(flows, self.position, self.angles)
            if isinstance(each, ResponseParameters)
            else (each,)
            for each in self.motion
        )
        return tuple(chain.from_iterable(given))


def _servo(scenario: Scenario) -> Servo:
    # a channel that nobody drives has no room to move and any limits
    still, present = ChannelLimits(0.0, 0.0, 1.0, 1.0, 1.0), scenario.base.channels.present
    channels = CHANNELS[scenario.arm.dimension]
    limits = [present[name].limits if name in present else still for name in channels]
    return Servo(*map(array, np.transpose(limits)))


def _motions(
    motion: motions.Motion, scenario: Scenario, flows: Sequence[Flow], key: str, read: Any
) -> Iterator[BaseMotion | ResponseParameters]:
    axes, duration = scenario.arm.dimension, scenario.simulation.duration
    channels = CHANNELS[axes]
    if isinstance(motion, motions.ResponseMotion):
        made = partial(ResponseParameters.of, motion, read, scenario.base.angles, flows)
        yield gathered({key: made})[key]
        return
    if isinstance(motion, motions.InFile):
        for name, values in zip(motion.moved(axes), read.values.T, strict=True):
            # of a long record
            curve = between(_curve(read.time, values, motion.interpolation), 0.0, duration)
            yield TableMotion(channels.index(name), PiecewisePolynomial(curve))
        return
    channel = channels.index(motion.channel)
    match motion:
        case motions.SineMotion():
            phase = array(np.deg2rad(motion.phase_deg))
            yield SineMotion(channel, array(motion.size_si), array(motion.frequency_hz), phase)
        case motions.VelocityMotion():
            onset = Onset(*map(array, (motion.start, motion.ramp_time, np.inf)))
            yield VelocityMotion(channel, onset, array(motion.size_si))
        case motions.TableMotion():
            time, value = np.asarray(motion.time), np.asarray(motion.size_si)
            curve = _curve(time, value, motion.interpolation)
            yield TableMotion(channel, PiecewisePolynomial(curve))


def _curve(
    time: Float[np.ndarray, " point"], value: Float[np.ndarray, " point"], interpolation: str
) -> PPoly:
    if interpolation == "monotone":
        return shape_preserving(time, value)
    from scipy.interpolate import CubicSpline  # slow to load, and few scenarios need it

    return CubicSpline(time, value)
