"""All forces on the arm: their balance, its tangent matrix, and their energies.

Whatever moves has a row in the arrays here: first the nodes, then the obstacles.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.obstacles import Obstacles
from crinoid.dynamics.tangent import HELD, Border, Tangent
from crinoid.elements import ENERGIES, WORKS, Element, Motion
from crinoid.flow import Water

Rows = Float[Array, "rows b"]
Elements = tuple[Element, ...]


class Surroundings(eqx.Module):
    """The water around given places, expanded to first order from each."""

    position: Rows
    velocity: Rows
    acceleration: Rows
    """Material acceleration Du/Dt (m/s2)."""
    velocity_slope: Float[Array, "rows b b"]
    acceleration_slope: Float[Array, "rows b b"]

    def since(
        self, position: Rows, velocity: Rows, acceleration: Rows, alpha: Float[Array, ""]
    ) -> "Surroundings":
        """Return the water at a share ``alpha`` of a step back, between what it was and is now.

        Given are the places there, and velocity and acceleration at the step's start.
        """
        return Surroundings(
            position,
            (1 - alpha) * self.velocity + alpha * velocity,
            (1 - alpha) * self.acceleration + alpha * acceleration,
            self.velocity_slope,
            self.acceleration_slope,
        )

    def at(self, position: Rows) -> tuple[Rows, Rows]:
        """Return velocity and material acceleration near the places."""
        moved = (position - self.position)[:, None, :]
        return (
            self.velocity + jnp.sum(self.velocity_slope * moved, axis=-1),
            self.acceleration + jnp.sum(self.acceleration_slope * moved, axis=-1),
        )


class Forces(eqx.Module):
    """The elements of an arm, the water that they stand in, and the obstacles in it.

    ``origin`` (m) is where in the world the arm's coordinates start: keeping them small keeps
    their round-off small, however deep the arm works.
    """

    elements: Elements
    water: Water
    origin: Float[Array, " b"]
    obstacles: Obstacles | None = None

    def frozen(self, time: Float[Array, ""]) -> "Forces":
        """Return the forces in the flow as it is at ``time``, for good: what statics balances.

        Obstacles stay where they are.
        """
        water = Water(self.water.flows, time)
        held = None if self.obstacles is None else self.obstacles.held()
        return Forces(self.elements, water, self.origin, held)

    def nodes(self, rows: Rows) -> Float[Array, "n b"]:
        """Return the rows of the nodes."""
        return rows if self.obstacles is None else rows[: -self.obstacles.count]

    def unknown(self, rows: Rows) -> Float[Array, "unknown b"]:
        """Return the rows that a step solves for: the free nodes, then the free obstacles."""
        nodes = self.nodes(rows)
        if not self.free:
            return nodes[HELD:]
        return jnp.concatenate([nodes[HELD:], rows[nodes.shape[0] + jnp.asarray(self.free)]])

    @property
    def free(self) -> tuple[int, ...]:
        """Which obstacles are free."""
        return () if self.obstacles is None else self.obstacles.free

    def flow_velocity(self, places: Rows, time: Array) -> Rows:
        """Return the velocity of the water at places (m/s)."""
        return jax.vmap(lambda place: self.water.velocity(self.origin + place, time))(places)

    def surroundings(self, stage: Stage, correction: Rows) -> Surroundings:
        """Return the water around the places at a stage of the step."""
        position = stage.position + stage.by_position * correction
        current = jax.vmap(lambda place: self.water.current(self.origin + place, stage.time))
        water = current(position)
        return Surroundings(
            position,
            water.velocity,
            water.acceleration,
            water.velocity_slope,
            water.acceleration_slope,
        )

    def motion(self, stage: Stage, correction: Rows, around: Surroundings) -> Motion:
        """Return the motion of everything and of the water around it, at a stage of the step."""
        position = stage.position + stage.by_position * correction
        return Motion(
            position,
            stage.velocity + stage.by_velocity * correction,
            stage.acceleration + stage.by_acceleration * correction,
            *around.at(position),
            stage.time,
        )

    def residual(
        self, motion: Motion, load_factor: Array | None = None
    ) -> tuple[Rows, Float[Array, ""]]:
        """Return the imbalance of each row and the largest single force in it (N)."""
        num_nodes = self.nodes(motion.position).shape[0]
        total = jnp.zeros((num_nodes, motion.position.shape[1]))
        largest = jnp.zeros(())
        for first, elements in self._groups():
            local = jax.vmap(lambda e, m: _residuals(e, m, load_factor))
            forces = local(elements, _windows(elements[0], motion))
            total += chain.scatter(jnp.sum(forces, axis=1), first, num_nodes)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(forces)))
        if self.obstacles is None:
            return total, largest
        _, pushed = self.obstacles.push(motion)
        largest = jnp.maximum(largest, jnp.max(jnp.abs(pushed)))
        rows = (-pushed).at[:num_nodes].add(total)
        if self.free:
            own = jax.vmap(lambda e, m: _residuals((e,), m, None)[0])
            bodies = own(self.obstacles.bodies, self._bodies(motion))[:, 0]
            free = num_nodes + jnp.asarray(self.free)
            rows = rows.at[free].add(bodies, unique_indices=True)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(bodies)))
        return rows, largest

    def tangent(
        self,
        stage: Stage,
        motion: Motion,
        around: Surroundings,
        load_factor: Array | None = None,
    ) -> Tangent:
        """Return d(residual)/d(correction): each element's Jacobian along the stage's motion."""
        num_nodes = self.nodes(motion.position).shape[0]
        slopes = (around.velocity_slope, around.acceleration_slope)

        def jacobian(elements: Elements, window: Motion, slopes: list[Array]) -> Array:
            return _jacobian(stage, elements, window, slopes, load_factor)

        jacobians = jax.vmap(jacobian)
        blocks = []
        for first, elements in self._groups():
            count, stencil = _count(elements[0]), elements[0].stencil
            along = [chain.gather(s, first, count, stencil) for s in slopes]
            blocks.append((first, jacobians(elements, _windows(elements[0], motion), along)))
        if self.obstacles is None:
            return Tangent(chain.assemble(blocks, num_nodes), None, ())

        obstacles, size = self.obstacles, motion.position.shape[1]
        pairs = obstacles.motions(motion)
        still = jnp.zeros((*pairs.position.shape, size))  # contact does not feel the water
        touch = jacobians((obstacles.contact,), pairs, [still, still])
        touch = touch.reshape(obstacles.count, -1, *touch.shape[1:])
        blocks.append((1, jnp.sum(touch[:, :, :2, :, :2], axis=0)))
        bands = chain.assemble(blocks, num_nodes)
        if not self.free:
            return Tangent(bands, None, ())

        free = jnp.asarray(self.free)
        touch = touch[free]
        of_free = [slope[num_nodes + free][:, None] for slope in slopes]
        own = jacobians((obstacles.bodies,), self._bodies(motion), of_free)[:, 0, :, 0]
        own = own + jnp.sum(touch[:, :, 2, :, 2], axis=1)

        def scatter(edges: Float[Array, "edges 2 b"]) -> Float[Array, "n b"]:
            return chain.scatter(edges, 1, num_nodes)

        by_column, by_row = jax.vmap(scatter, -1, -1), jax.vmap(scatter, 1, 0)
        border = Border(
            of_nodes=jax.vmap(by_column, 0, 2)(touch[:, :, :2, :, 2]),
            of_bodies=jax.vmap(by_row)(touch[:, :, 2, :, :2]),
            corner=jnp.einsum("fij,fg->figj", own, jnp.eye(len(self.free))),
        )
        return Tangent(bands, border, self.free)

    def audit(self, motion: Motion) -> tuple[Float[Array, " energy"], Float[Array, " work"]]:
        """Return the stored energies (J) and the powers that flow in from outside (W).

        Contacts aside: what they do to the arm is a `Touch`.
        """
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

    def _bodies(self, motion: Motion) -> Motion:
        """Return the motion of the free obstacles, a window each."""
        free = self.nodes(motion.position).shape[0] + jnp.asarray(self.free)
        return Motion(
            motion.position[free][:, None],
            motion.velocity[free][:, None],
            motion.acceleration[free][:, None],
            motion.flow_velocity[free][:, None],
            motion.flow_acceleration[free][:, None],
            jnp.broadcast_to(motion.time, (len(self.free),)),
        )


def _jacobian(
    stage: Stage,
    elements: Elements,
    window: Motion,
    slopes: list[Array],
    load_factor: Array | None,
) -> Array:
    """Return d(residual)/d(correction) of one window: ``(k, b, k, b)``."""

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


def _count(element: Element) -> int:
    return int(jax.tree.leaves(element)[0].shape[0])


def _windows(element: Element, motion: Motion) -> Motion:
    count = _count(element)

    def gather(rows: Rows) -> Array:
        return chain.gather(rows, element.first, count, element.stencil)

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
