"""All forces on the arm: their balance, its tangent matrix, and their energies."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.integrator import Stage
from crinoid.elements import ENERGIES, WORKS, Element, Motion
from crinoid.flow import Water

Nodes = Float[Array, "n b"]


class Forces(eqx.Module):
    """The elements of an arm, and the water that they stand in.

    ``origin`` (m) is where in the world the arm's coordinates start: keeping them small keeps
    their round-off small, however deep the arm works.
    """

    elements: tuple[Element, ...]
    water: Water
    origin: Float[Array, " b"]

    def motion(self, stage: Stage, correction: Nodes) -> Motion:
        """Return the motion of all nodes and of the water at them, at a stage of the step."""
        position = stage.position + stage.by_position * correction
        velocity = stage.velocity + stage.by_velocity * correction
        acceleration = stage.acceleration + stage.by_acceleration * correction
        flow_velocity, flow_acceleration = self._flow(position, stage.time)
        return Motion(
            position, velocity, acceleration, flow_velocity, flow_acceleration, stage.time
        )

    def residual(
        self, motion: Motion, load_factor: Array | None = None
    ) -> tuple[Nodes, Float[Array, ""]]:
        """Return the imbalance of each node and the largest single force in it (N)."""
        num_nodes = motion.position.shape[0]
        total = jnp.zeros_like(motion.position)
        largest = jnp.zeros(())
        for element in self.elements:
            local = jax.vmap(_residual)(element, _windows(element, motion))
            if element.external and load_factor is not None:
                local = load_factor * local
            total += chain.scatter(local, element.first, num_nodes)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(local)))
        return total, largest

    def tangent(
        self, stage: Stage, motion: Motion, load_factor: Array | None = None
    ) -> chain.Bands:
        """Return d(residual)/d(correction): each element's Jacobian along the stage's motion."""
        position = motion.position
        num_nodes, size = position.shape
        if self.water.flows:
            flow_slopes = jax.vmap(jax.jacfwd(self._flow_at_node), (0, None))(position, stage.time)
        else:
            flow_slopes = (jnp.zeros((num_nodes, size, size)),) * 2

        def jacobian(element: Element, window: Motion, slopes: list[Array]) -> Array:
            def along(direction: Float[Array, "k b"]) -> Array:
                velocity_slope, acceleration_slope = (
                    jnp.einsum("kij,kj->ki", slope, direction) for slope in slopes
                )
                tangent = Motion(
                    stage.by_position * direction,
                    stage.by_velocity * direction,
                    stage.by_acceleration * direction,
                    stage.by_position * velocity_slope,
                    stage.by_position * acceleration_slope,
                    jnp.zeros_like(window.time),
                )
                return jax.jvp(element.residual, (window,), (tangent,))[1]

            shape = window.position.shape
            basis = jnp.eye(shape[0] * shape[1]).reshape(-1, *shape)
            return jax.vmap(along, out_axes=-1)(basis).reshape(*shape, *shape)

        blocks = []
        for element in self.elements:
            count = _count(element)
            slopes = [
                jnp.stack([s[element.first + i :][:count] for i in range(element.stencil)], 1)
                for s in flow_slopes
            ]
            block = jax.vmap(jacobian)(element, _windows(element, motion), slopes)
            if element.external and load_factor is not None:
                block = load_factor * block
            blocks.append((element.first, block))
        return chain.assemble(blocks, num_nodes)

    def audit(self, motion: Motion) -> tuple[Float[Array, " energy"], Float[Array, " work"]]:
        """Return the stored energies (J) and the powers that flow in from outside (W)."""
        energy = dict.fromkeys(ENERGIES, jnp.zeros(()))
        power = dict.fromkeys(WORKS, jnp.zeros(()))
        for element in self.elements:
            windows = _windows(element, motion)
            energy[element.stored] += jnp.sum(jax.vmap(_energy)(element, windows))
            power[element.worked] += jnp.sum(jax.vmap(_power)(element, windows))
        return jnp.stack(list(energy.values())), jnp.stack(list(power.values()))

    def _flow_at_node(self, position: Float[Array, " b"], time: Array) -> tuple[Array, Array]:
        return self.water.velocity_and_acceleration(self.origin + position, time)

    def _flow(self, position: Nodes, time: Array) -> tuple[Nodes, Nodes]:
        if not self.water.flows:
            return jnp.zeros_like(position), jnp.zeros_like(position)
        return jax.vmap(self._flow_at_node, (0, None))(position, time)


def _count(element: Element) -> int:
    return int(jax.tree.leaves(element)[0].shape[0])


def _windows(element: Element, motion: Motion) -> Motion:
    count = _count(element)

    def gather(nodes: Nodes) -> Array:
        return chain.gather(nodes, element.first, count, element.stencil)

    return Motion(
        gather(motion.position),
        gather(motion.velocity),
        gather(motion.acceleration),
        gather(motion.flow_velocity),
        gather(motion.flow_acceleration),
        jnp.broadcast_to(motion.time, (count,)),
    )


def _residual(element: Element, window: Motion) -> Array:
    return element.residual(window)


def _energy(element: Element, window: Motion) -> Array:
    return element.energy(window)


def _power(element: Element, window: Motion) -> Array:
    return element.power(window)
