"""Motion of the base on a vessel in waves, by its response amplitude operators."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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

_NONE = 1e-9
"""Turn per amplitude of the waves that counts as none (rad/m)."""


class ResponseParameters(eqx.Module):
    """The numbers of a vessel that moves with the waves."""

    heading: Float[Array, ""]
    """Direction of the bow (rad)."""
    offset: Float[Array, " d"]
    """Place of the arm's root on the vessel (m)."""
    response: tuple[Float[Array, "2 m 6"], ...]
    """Of each flow of surface waves: real and imaginary parts of surge, sway, heave (m/m), roll,
    pitch and yaw (rad/m) of each wave."""
    flows: tuple[int, ...] = eqx.field(static=True)
    """Indexes of these flows."""

    @staticmethod
    def of(
        motion: ResponseMotion,
        read: VesselResponse,
        angles: tuple[float, float, float],
        flows: Sequence[Flow],
    ) -> ResponseParameters:
        """Return the numbers of a vessel, of which ``read`` has the file.

        Raises
        ------
        ScenarioError
            If the file does not cover the waves, or the root of an arm in space points so steeply
            that pan and roll are not defined.
        """
        bow = np.deg2rad(motion.heading_deg)
        found, waves = [], _waves(flows)
        for flow in waves.values():
            level, frequency = np.asarray(flow.headings), np.asarray(flow.frequencies)
            if level.shape[1] == 1:  # of a wave across the plane only the component in it is known
                heading = np.arccos(np.clip(np.cos(bow) * level[:, 0], -1.0, 1.0))
            else:
                heading = np.arctan2(level[:, 1], level[:, 0]) - bow
            values = read.at(frequency, heading)
            read.beyond(frequency, np.asarray(flow.amplitudes))
            found.append(np.stack([values.real, values.imag]))
        made = ResponseParameters(
            array(bow), array(motion.offset), tuple(map(array, found)), tuple(waves)
        )
        steep = len(motion.offset) == 3 and abs(np.cos(angles[1])) < STEEP
        if steep and any(
            jnp.any(abs(made._turns(each, angles[0])[0]) > _NONE) for each in made.response
        ):
            raise too_steep(angles[1])
        return made

    def motions(
        self, flows: Sequence[Flow], position: Float[Array, " d"], angles: Float[Array, " angle"]
    ) -> Iterator[WaveMotion]:
        """Yield the motion of the channels by each flow of waves, on its current; traceable.

        ``position`` and ``angles`` are those of the base in its set pose (m, rad). All is linear:
        the root moves by the shifts and by the turns times its lever, and pan, tilt and roll by
        the turns about the axes of the set pose.
        """
        space, lever = position.shape[0] == 3, self.offset
        if not space:
            lever = jnp.stack([lever[0], jnp.zeros(()), lever[1]])
        place = position[:-1] - jnp.stack(self._along_axes(lever[0], lever[1]))[: 2 if space else 1]
        for index, response in zip(self.flows, self.response, strict=True):
            flow = flows[index]
            assert isinstance(flow, Waves)
            x, y, z = jnp.moveaxis(response[..., :3] + jnp.cross(_vectors(response), lever), -1, 0)
            x, y = self._along_axes(x, y)
            if space:
                ahead, aside, up = self._turns(response, angles[0])
                cosine, sine = jnp.cos(angles[1]), jnp.sin(angles[1])
                roll = jnp.where(abs(cosine) < STEEP, 0.0, ahead / cosine)
                channels = [x, y, z, up - roll * sine, -aside, roll]
            else:
                channels = [x, z, -self._turns(response, jnp.zeros(()))[1]]
            cosine, sine = flow.amplitudes[:, None] * jnp.stack(channels, axis=-1)
            point = jnp.append(place, 0.0)
            phases = 2 * jnp.pi * flow.turns(point, jnp.zeros(()))
            yield WaveMotion(..., flow.onset, flow.frequencies, phases, cosine, sine)

    def _along_axes(self, forward: Array, port: Array) -> tuple[Array, Array]:
        """Return the components along x and y of a vector with parts forward and to port."""
        return _rotated(forward, port, self.heading)

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


def _waves(flows: Sequence[Flow]) -> dict[int, Waves]:
    return {index: flow for index, flow in enumerate(flows) if isinstance(flow, Waves)}


def beyond_notes(responses: Mapping[str, VesselResponse], flows: Sequence[Flow]) -> list[str]:
    """Return a note on each flow with waves outside of the frequencies of a file."""
    found = {
        f"{key}: flow.{index}": read.beyond(*map(np.asarray, (flow.frequencies, flow.amplitudes)))
        for key, read in responses.items()
        for index, flow in _waves(flows).items()
    }
    return [f"{key}: {note}" for key, note in found.items() if note]
