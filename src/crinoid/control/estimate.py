"""Estimates by an observer: tip, shape and current, each with its standard deviation."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
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

    def in_world(self, carrier: SubmarineFrame, time: Float[Array, ""]) -> "Estimate":
        """Return it in the world, from the frame of a submarine at ``time`` (s).

        The velocity of the water is that in the frame plus that of the frame. Standard deviations
        turn as those of independent errors along the axes of the frame.
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
            points = jax.vmap(lambda each: carrier.to_world(each, time))(poses)[:, :axes]
            position = Estimated(points, jax.vmap(turned)(position.std))
        if flow is not None:
            place = self.tip.value if self.position is None else jnp.mean(poses, axis=0)
            drift = jax.jvp(lambda at: carrier.to_world(place, at), (time,), (jnp.ones(()),))[1]
            flow = Estimated(product(turn, flow.value) + drift[:axes], turned(flow.std))
        return Estimate(tip, position, flow)


class LinearOutput(eqx.Module):
    """Output of a linear observer, with its stationary standard deviation."""

    by_state: Float[Array, "o z"]
    by_actuators: Float[Array, "o s"]
    at_rest: Float[Array, "*any"]
    """Its value where the model is linear about; its ``o`` numbers in their shape."""
    std: Float[Array, "*any"]
    apart: Float[Array, "*any"]
    """Standard deviation of what no state contains."""

    def std_of(self, covariance: Float[np.ndarray, "z z"]) -> Float[np.ndarray, "*any"]:
        """Return the standard deviation for the covariance of the states."""
        by_state, apart = np.asarray(self.by_state), np.asarray(self.apart)
        variance = np.sum((by_state @ covariance) * by_state, axis=1)
        return np.sqrt(variance.reshape(apart.shape) + apart**2)

    def of(self, state: Float[Array, " z"], actuators: Float[Array, " s"]) -> Estimated:
        """Return it for a state and states of the actuators, both as differences."""
        moved = product(self.by_state, state) + product(self.by_actuators, actuators)
        return Estimated(self.at_rest + moved.reshape(self.at_rest.shape), self.std)


class CurrentOutput(eqx.Module):
    """Current by the state of a linear observer: the velocity with the drag of the linear model.

    Drag grows with ``|w| w`` of the velocity ``w`` across the arm, and a linear model has one
    slope. So its drag is inverted, as that of `crinoid.control.Along` is made.
    """

    by_state: Float[Array, "d z"]
    spread: Float[Array, "d d"]
    """Square root of the stationary covariance of the errors in the linear model."""
    apart: Float[Array, "d d"]
    """Covariance of the part of these errors that no state contains."""
    begin: Float[Array, " d"]
    """Velocity where the model is linear about (m/s)."""
    tangent: Float[Array, " d"]
    """Direction of the arm there."""
    direction: Float[Array, " d"]
    """Direction across the arm of the current in which the drag was linearised."""
    slope: Float[Array, ""]
    """Mean slope of ``|w| w`` across that direction (m/s), half of that along it."""

    def spread_of(self, covariance: Float[np.ndarray, "z z"]) -> Float[np.ndarray, "d d"]:
        """Return the square root of the covariance of the errors, for that of the states."""
        by_state = np.asarray(self.by_state)
        total = by_state @ covariance @ by_state.T + np.asarray(self.apart)
        variance, ways = np.linalg.eigh(total)
        return np.asarray(ways * np.sqrt(np.maximum(variance, 0.0)))

    def of(self, state: Float[Array, " z"]) -> Estimated:
        """Return it for a state.

        Standard deviations are differences of the inverted drag over one standard deviation, as its
        slope is infinite in still water.
        """
        change = product(self.by_state, state)
        ends = [jax.vmap(self._velocity)(change + sign * self.spread.T) for sign in (1, -1)]
        std = jnp.sqrt(jnp.sum((0.5 * (ends[0] - ends[1])) ** 2, axis=0))
        return Estimated(self._velocity(change), std)

    def _velocity(self, change: Float[Array, " d"]) -> Float[Array, " d"]:
        inline, across = self._parts(change)
        inline_begin, across_begin = self._parts(self.begin)
        main = product(across, self.direction) * self.direction
        drag_begin = jnp.sqrt(jnp.sum(across_begin**2)) * across_begin
        drag = self.slope * (across + main) + drag_begin
        size = jnp.sqrt(jnp.sum(drag**2))
        return inline_begin + inline + drag / jnp.sqrt(jnp.where(size > 0, size, 1.0))

    def _parts(self, velocity: Float[Array, " d"]) -> tuple[Float[Array, " d"], Float[Array, " d"]]:
        inline = product(velocity, self.tangent) * self.tangent
        return inline, velocity - inline


class ObserverOutputs(eqx.Module):
    """Outputs of a linear observer."""

    tip: LinearOutput
    position: LinearOutput
    flow_velocity: CurrentOutput | None
    """None where a forecast has a part of the current."""

    def of(self, state: Float[Array, " z"], actuators: Float[Array, " s"]) -> Estimate:
        """Return the estimate for a state and states of the actuators, both as differences."""
        flow = self.flow_velocity
        return Estimate(
            self.tip.of(state, actuators),
            self.position.of(state, actuators),
            None if flow is None else flow.of(state),
        )
