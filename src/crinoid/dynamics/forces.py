"""All forces on the arm: their balance, its tangent matrix, and their energies."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.integrator import Stage
from crinoid.elements import ENERGIES, WORKS, Element, Motion
from crinoid.flow import Current, Water

Nodes = Float[Array, "n b"]
Elements = tuple[Element, ...]


class Forces(eqx.Module):
    """The elements of an arm, and the water that they stand in.

    ``origin`` (m) is where in the world the arm's coordinates start: keeping them small keeps
    their round-off small, however deep the arm works.
    """

    elements: Elements
    water: Water
    origin: Float[Array, " b"]

    def frozen(self, time: Float[Array, ""]) -> "Forces":
        """Return the forces in the flow as it is at ``time``, for good: what statics balances."""
        water = Water(self.water.flows, time)
        return Forces(self.elements, water, self.origin)

    def motion(self, stage: Stage, correction: Nodes) -> Motion:
        """Return the motion of all nodes and of the water at them, at a stage of the step."""
        position = stage.position + stage.by_position * correction
        velocity = stage.velocity + stage.by_velocity * correction
        acceleration = stage.acceleration + stage.by_acceleration * correction
        current = self._currents(position, stage.time)
        return Motion(
            position, velocity, acceleration, current.velocity, current.acceleration, stage.time
        )

    def residual(
        self, motion: Motion, load_factor: Array | None = None
    ) -> tuple[Nodes, Float[Array, ""]]:
        """Return the imbalance of each node and the largest single force in it (N)."""
        num_nodes = motion.position.shape[0]
        total = jnp.zeros_like(motion.position)
        largest = jnp.zeros(())
        for first, elements in self._groups():
            local = jax.vmap(lambda e, m: _residuals(e, m, load_factor))
            forces = local(elements, _windows(elements[0], motion))
            total += chain.scatter(jnp.sum(forces, axis=1), first, num_nodes)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(forces)))
        return total, largest

    def tangent(
        self, stage: Stage, motion: Motion, load_factor: Array | None = None
    ) -> chain.Bands:
        """Return d(residual)/d(correction): each element's Jacobian along the stage's motion."""
        num_nodes = motion.position.shape[0]
        current = self._currents(motion.position, stage.time)
        flow_slopes = (current.velocity_slope, current.acceleration_slope)

        def jacobian(elements: Elements, window: Motion, slopes: list[Array]) -> Array:
            def residual(window: Motion) -> Array:
                return jnp.sum(_residuals(elements, window, load_factor), axis=0)

            def along(direction: Float[Array, "k b"]) -> Array:
                velocity_slope, acceleration_slope = (
                    jnp.sum(slope * direction[:, None], axis=-1) for slope in slopes
                )
                tangent = Motion(
                    stage.by_position * direction,
                    stage.by_velocity * direction,
                    stage.by_acceleration * direction,
                    stage.by_position * velocity_slope,
                    stage.by_position * acceleration_slope,
                    jnp.zeros_like(window.time),
                )
                return jax.jvp(residual, (window,), (tangent,))[1]

            shape = window.position.shape
            basis = jnp.eye(shape[0] * shape[1]).reshape(-1, *shape)
            return jax.vmap(along, out_axes=-1)(basis).reshape(*shape, *shape)

        blocks = []
        for first, elements in self._groups():
            count, stencil = _count(elements[0]), elements[0].stencil
            slopes = [
                jnp.stack([s[first + i :][:count] for i in range(stencil)], 1) for s in flow_slopes
            ]
            block = jax.vmap(jacobian)(elements, _windows(elements[0], motion), slopes)
            blocks.append((first, block))
        return chain.assemble(blocks, num_nodes)

    def audit(self, motion: Motion) -> tuple[Float[Array, " energy"], Float[Array, " work"]]:
        """Return the stored energies (J) and the powers that flow in from outside (W)."""
        energy = dict.fromkeys(ENERGIES, jnp.zeros(()))
        power = dict.fromkeys(WORKS, jnp.zeros(()))
        for _, elements in self._groups():
            accounts = jax.vmap(_accounts)(elements, _windows(elements[0], motion))
            for element, (stored, flowing) in zip(elements, accounts, strict=True):
                energy[element.stored] += jnp.sum(stored)
                power[element.worked] += jnp.sum(flowing)
        return jnp.stack(list(energy.values())), jnp.stack(list(power.values()))

    def _groups(self) -> list[tuple[int, Elements]]:
        """Return the elements that act on the same windows together, by their first node.

        One pass over the windows then serves all of them: less to compile and to run.
        """
        groups: dict[tuple[int, int, int], Elements] = {}
        for element in self.elements:
            key = (element.first, element.stencil, _count(element))
            groups[key] = (*groups.get(key, ()), element)
        return [(first, elements) for (first, _, _), elements in groups.items()]

    def _currents(self, position: Nodes, time: Array) -> Current:
        """Return the current at each node."""
        return jax.vmap(self.water.current, (0, None))(self.origin + position, time)


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


def _residuals(elements: Elements, window: Motion, load_factor: Array | None) -> Array:
    """Return the residual of each element in one window."""
    full = 1.0 if load_factor is None else load_factor
    return jnp.stack([(full if e.external else 1.0) * e.residual(window) for e in elements])


def _accounts(elements: Elements, window: Motion) -> list[tuple[Array, Array]]:
    return [(element.energy(window), element.power(window)) for element in elements]
