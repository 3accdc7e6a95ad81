"""Estimates by an observer: tip, shape and current, each with its standard deviation."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.control.target import SubmarineFrame
from crinoid.numerics.small_matrices import product


class Estimated(eqx.Module):
    """Estimated quantity with its standard deviation, both in its unit and of one shape."""

    value: Float[Array, "*any"]
    std: Float[Array, "*any"]
    """Standard deviation of the error of each number."""


class Estimate(eqx.Module):
    """Filtered estimate at the newest command. SI units, in the frame of the target.

    It is from all readings known when the command was given.
    """

    tip: Estimated
    """Pose of the tip (`crinoid.foundation.axes.POSE`)."""
    position: Estimated | None = None
    """Positions of the nodes (node, axis); None if the observer has none."""
    flow_velocity: Estimated | None = None
    """Velocity of the undisturbed water, its mean along the arm (axis); None likewise."""

    def in_world(self, carrier: SubmarineFrame, time: Float[Array, ""]) -> Estimate:
        """Return it in the world, from the frame of a submarine at ``time`` (s).

        Standard deviations turn as those of independent errors along the axes of the frame.
        """
        axes = carrier.origin.size
        turn = carrier.rotation(time)

        def turned(std: Float[Array, " d"]) -> Float[Array, " d"]:
            return jnp.sqrt(product(turn**2, std**2))

        pose, std = carrier.to_world(self.tip.value, time), self.tip.std
        pointing = std[axes:] if axes == 2 else turned(std[axes:])
        tip = Estimated(pose, jnp.concatenate([turned(std[:axes]), pointing]))
        position, flow = self.position, self.flow_velocity
        if position is not None:
            poses = jnp.pad(position.value, ((0, 0), (0, pose.size - axes)))
            poses = jax.vmap(lambda each: carrier.to_world(each, time))(poses)
            position = Estimated(poses[:, :axes], jax.vmap(turned)(position.std))
        if flow is not None:
            flow = Estimated(product(turn, flow.value), turned(flow.std))
        return Estimate(tip, position, flow)


class LinearOutput(eqx.Module):
    """Output of a linear observer, with its stationary standard deviation."""

    by_state: Float[Array, "o z"]
    by_actuators: Float[Array, "o s"]
    at_rest: Float[Array, "*any"]
    """Its value where the model is linear about; its ``o`` numbers in their shape."""
    std: Float[Array, "*any"]

    def of(self, state: Float[Array, " z"], actuators: Float[Array, " s"]) -> Estimated:
        """Return it for a state and states of the actuators, both as differences."""
        moved = product(self.by_state, state) + product(self.by_actuators, actuators)
        return Estimated(self.at_rest + moved.reshape(self.at_rest.shape), self.std)


class ObserverOutputs(eqx.Module):
    """Outputs of a linear observer."""

    tip: LinearOutput
    position: LinearOutput
    flow_velocity: LinearOutput | None
    """None where a forecast has a part of the current."""

    def of(self, state: Float[Array, " z"], actuators: Float[Array, " s"]) -> Estimate:
        """Return the estimate for a state and states of the actuators, both as differences."""
        flow = self.flow_velocity
        return Estimate(
            self.tip.of(state, actuators),
            self.position.of(state, actuators),
            None if flow is None else flow.of(state, actuators),
        )
