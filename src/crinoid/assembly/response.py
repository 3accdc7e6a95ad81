"""Motion of the base on a vessel in waves, by its response amplitude operators."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.arrays import array
from crinoid.base import WaveMotion
from crinoid.flow import Flow, Waves
from crinoid.foundation.axes import STEEP
from crinoid.scenario.base_motion import ResponseMotion, too_steep

if TYPE_CHECKING:
    from crinoid.recording import VesselResponse

_NONE = 1e-9  # turn per amplitude of the waves that counts as none (rad/m)


class ResponseParameters(eqx.Module):
    """The numbers of a vessel that moves with the waves."""

    heading: Float[Array, ""]  # direction of the bow (rad)
    offset: Float[Array, " d"]  # place of the arm's root on the vessel (m)
    response: dict[int, Float[Array, "2 m 6"]]
    """By the index of a flow of waves: real and imaginary parts of surge, sway, heave (m/m), roll,
    pitch and yaw (rad/m) of each wave."""

    @staticmethod
    def of(
        motion: ResponseMotion,
        read: VesselResponse,
        angles: tuple[float, float, float],
        flows: Sequence[Flow],
    ) -> ResponseParameters:
        """Return the numbers of a vessel, from its file and the waves.

        Raises
        ------
        ScenarioError
            If the file does not cover the waves, or the root of an arm in space points so steeply
            that pan and roll are not defined.
        """
        bow, response = np.deg2rad(motion.heading_deg), {}
        for index, flow in waves_of(flows):
            if flow.headings.shape[1] == 1:  # of oblique waves only the part in the plane is known
                heading = np.arccos(np.clip(np.cos(bow) * flow.headings[:, 0], -1.0, 1.0))
            else:
                heading = np.arctan2(flow.headings[:, 1], flow.headings[:, 0]) - bow
            read.beyond(flow)
            values = read.at(np.asarray(flow.frequencies), np.asarray(heading))
            response[index] = array([values.real, values.imag])
        made = ResponseParameters(array(bow), array(motion.offset), response)
        if len(motion.offset) == 3 and abs(np.cos(angles[1])) < STEEP:
            ahead = [made._turns(each, angles[0])[0] for each in response.values()]
            if any(jnp.any(abs(each) > _NONE) for each in ahead):
                raise too_steep(angles[1])
        return made

    def motions(
        self, flows: Sequence[Flow], position: Float[Array, " d"], angles: Float[Array, " angle"]
    ) -> Iterator[WaveMotion]:
        """Yield the motion of all channels with each flow of waves; traceable.

        ``position`` and ``angles`` are those of the base in its set pose (m, rad). To first order
        the root shifts by the vessel's turns times its lever, and turns about the axes of the pose.
        """
        axes = position.shape[0]
        lever = jnp.insert(self.offset, 1, 0.0) if axes == 2 else self.offset
        place = position[:-1] - jnp.stack(_rotated(lever[0], lever[1], self.heading))[: axes - 1]
        for index, response in self.response.items():
            flow = flows[index]
            assert isinstance(flow, Waves)
            shift = response[..., :3] + jnp.cross(_vectors(response), lever)
            x, y = _rotated(shift[..., 0], shift[..., 1], self.heading)
            ahead, aside, up = self._turns(response, 0.0 if axes == 2 else angles[0])
            channels = [x, shift[..., 2], -aside]
            if axes == 3:
                cosine = jnp.cos(angles[1])
                roll = jnp.where(abs(cosine) < STEEP, 0.0, ahead / cosine)
                channels = [x, y, shift[..., 2], up - roll * jnp.sin(angles[1]), -aside, roll]
            cosine, sine = flow.amplitudes[:, None] * jnp.stack(channels, axis=-1)
            turns = flow.turns(jnp.append(place, 0.0), jnp.zeros(()))
            yield WaveMotion(..., flow.onsets, flow.frequencies, 2 * jnp.pi * turns, cosine, sine)

    def _turns(self, response: Float[Array, "2 m 6"], pan: Array | float) -> tuple[Array, ...]:
        """Return the turns about the panned x and y, and about z (rad/m)."""
        about = _vectors(response)
        return *_rotated(about[..., 0], about[..., 1], self.heading - pan), about[..., 2]


def _vectors(response: Float[Array, "2 m 6"]) -> Float[Array, "2 m 3"]:
    """Return the turns as vectors along the axes of the vessel; pitch lifts the bow."""
    return response[..., 3:] * np.array([1.0, -1.0, 1.0])


def _rotated(x: Array, y: Array, angle: Array) -> tuple[Array, Array]:
    cosine, sine = jnp.cos(angle), jnp.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y


def waves_of(flows: Sequence[Flow]) -> list[tuple[int, Waves]]:
    """Return the flows of surface waves, each after its index."""
    return [(index, flow) for index, flow in enumerate(flows) if isinstance(flow, Waves)]
