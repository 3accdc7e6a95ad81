"""All forces on the arm: their balance, its tangent matrix, and their energies.

Whatever moves has a row in the arrays here: first the nodes, then the obstacles. A row has ``b``
entries: ``d`` coordinates and, in space, the spin of the edge that ends at the node.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.obstacles import Obstacles
from crinoid.dynamics.surroundings import Surroundings
from crinoid.dynamics.tangent import HELD, Border, Tangent
from crinoid.elements import (
    ENERGIES,
    WORKS,
    Bend,
    BendTwist,
    Course,
    Element,
    Inertia,
    Linearised,
    Motion,
    Stretch,
)
from crinoid.flow import Current, Water
from crinoid.reference import Reference

Rows = Float[Array, "rows b"]
Points = Float[Array, "rows d"]
Elements = tuple[Element, ...]
Slopes = tuple[Array, Array | None]


class Forces(eqx.Module):
    """The elements of an arm, the water that they stand in, and the obstacles in it.

    Its larger methods are compiled functions: each is traced once, not at each place in a program
    that calls it.

    ``origin`` (m) is where in the world the arm's coordinates start: keeping them small keeps
    their round-off small, however deep the arm works.
    """

    elements: Elements
    water: Water
    origin: Float[Array, " d"]
    obstacles: Obstacles | None = None
    drive: Float[Array, " drive"] | None = None
    """Drives of the actuators, which elements find in a motion; None: there are no actuators."""

    def frozen(self, time: Float[Array, ""]) -> "Forces":
        """Return the forces in the flow as it is at ``time``, for good: what statics balances.

        Obstacles stay where they are.
        """
        water = Water(self.water.flows, time)
        held = None if self.obstacles is None else self.obstacles.held()
        return Forces(self.elements, water, self.origin, held, self.drive)

    def driven(self, drive: Float[Array, " drive"] | None) -> "Forces":
        """Return the forces where the actuators drive the arm so."""
        return Forces(self.elements, self.water, self.origin, self.obstacles, drive)

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

    @property
    def axes(self) -> int:
        """Number of axes of a position."""
        return self.origin.shape[0]

    def flow_velocity(self, points: Points, time: Array) -> Points:
        """Return the velocity of the water at points (m/s)."""
        return jax.vmap(lambda point: self.water.velocity(self.origin + point, time))(points)

    @eqx.filter_jit
    def surroundings(self, stage: Stage, correction: Rows) -> Surroundings:
        """Return the water around the rows at a stage of the step."""
        position = (stage.position + stage.by_position * correction)[:, : self.axes]

        def current(point: Float[Array, " d"]) -> Current:
            return self.water.current(self.origin + point, stage.time)

        water, slope = jax.vmap(current)(position), None
        # a time step does well without, an equilibrium moves by it
        if self.water.frozen_at is not None:
            slope = jax.vmap(jax.jacfwd(lambda point: current(point).acceleration))(position)
        return Surroundings(
            position,
            water.velocity,
            water.acceleration,
            water.velocity_slope,
            slope,
        )

    @eqx.filter_jit
    def motion(self, stage: Stage, correction: Rows, around: Surroundings) -> Motion:
        """Return the motion of everything and of the water around it, at a stage of the step."""
        position = stage.position + stage.by_position * correction
        frames = stage.frames
        return Motion(
            position,
            stage.velocity + stage.by_velocity * correction,
            stage.acceleration + stage.by_acceleration * correction,
            *around.at(position),
            stage.time,
            None if frames is None else frames.at(self.nodes(position)),
            self.drive,
        )

    @eqx.filter_jit
    def residual(
        self, motion: Motion, load_factor: Array | None = None
    ) -> tuple[Rows, Float[Array, " b"]]:
        """Return the imbalance of each row, and the largest single force in it of each column (N).

        The column of spins holds torques (N m).
        """
        size = motion.position.shape[1]
        num_nodes = self.nodes(motion.position).shape[0]
        total, largest = jnp.zeros((num_nodes, size)), jnp.zeros(size)
        for first, elements in self._groups():
            local = jax.vmap(lambda e, m: _residuals(e, m, load_factor))
            forces = local(elements, self._windows(elements[0], motion))
            width = forces.shape[-1]
            nodal = chain.scatter(jnp.sum(forces, axis=1), first, num_nodes)
            total = total.at[:, :width].add(nodal)
            largest = largest.at[:width].max(jnp.max(jnp.abs(forces), axis=(0, 1, 2)))
        if self.obstacles is None:
            return total, largest
        _, pushed = self.obstacles.push(motion)
        largest = jnp.maximum(largest, jnp.max(jnp.abs(pushed), axis=0))
        rows = (-pushed).at[:num_nodes].add(total)
        if self.free:
            own = jax.vmap(lambda e, m: _residuals((e,), m, None)[0])
            bodies = own(self.obstacles.bodies, self._bodies(motion))[:, 0]
            free = num_nodes + jnp.asarray(self.free)
            rows = rows.at[free].add(bodies, unique_indices=True)
            largest = jnp.maximum(largest, jnp.max(jnp.abs(bodies), axis=0))
        return rows, largest

    def tangent(
        self,
        stage: Stage,
        motion: Motion,
        around: Surroundings,
        load_factor: Array | None = None,
    ) -> Tangent:
        """Return d(residual)/d(correction): each element's Jacobian along the stage's motion."""
        size = motion.position.shape[1]
        num_nodes = self.nodes(motion.position).shape[0]

        slopes = (around.velocity_slope, around.acceleration_slope)

        def jacobian(elements: Elements, window: Motion, slopes: Slopes) -> Array:
            return _jacobian(_course(stage, slopes), elements, window, load_factor)

        jacobians = jax.vmap(jacobian)
        # elements that do without spins are assembled on positions only
        blocks: dict[int, list[tuple[int, Array]]] = {self.axes: [], size: []}
        for first, elements in self._groups():
            count, stencil = _count(elements[0]), elements[0].stencil
            window = self._windows(elements[0], motion)
            along = jax.tree.map(
                partial(chain.gather, first=first, count=count, stencil=stencil), slopes
            )
            block = jacobians(elements, window, along)
            blocks[block.shape[-1]].append((first, block))
        obstacles = self.obstacles
        if obstacles is not None:
            pairs = obstacles.motions(motion)
            # contact does not feel the water
            still = jnp.zeros((*pairs.flow_velocity.shape, self.axes))
            touch = jacobians((obstacles.contact,), pairs, (still, None))
            touch = touch.reshape(obstacles.count, -1, *touch.shape[1:])
            blocks[size].append((obstacles.contact.first, jnp.sum(touch[:, :, :2, :, :2], axis=0)))
        bands = sum(
            (
                jnp.pad(chain.assemble(some, num_nodes), [(0, 0)] * 2 + [(0, size - width)] * 2)
                for width, some in blocks.items()
                if some
            ),
            start=jnp.zeros((num_nodes, 5, size, size)),
        )
        if obstacles is None or not self.free:
            return Tangent(bands, None, ())

        free = jnp.asarray(self.free)
        touch = touch[free]
        of_free = jax.tree.map(lambda slope: slope[num_nodes + free][:, None], slopes)
        own = jacobians((obstacles.bodies,), self._bodies(motion), of_free)[:, 0, :, 0]
        own = own + jnp.sum(touch[:, :, 2, :, 2], axis=1)

        def scatter(edges: Float[Array, "edges 2 b"]) -> Float[Array, "n b"]:
            return chain.scatter(edges, obstacles.contact.first, num_nodes)

        by_column, by_row = jax.vmap(scatter, -1, -1), jax.vmap(scatter, 1, 0)
        border = Border(
            of_nodes=jax.vmap(by_column, 0, 2)(touch[:, :, :2, :, 2]),
            of_bodies=jax.vmap(by_row)(touch[:, :, 2, :, :2]),
            corner=jnp.einsum("fij,fg->figj", own, jnp.eye(len(self.free))),
        )
        return Tangent(bands, border, self.free)

    @property
    def bend(self) -> Bend | BendTwist | None:
        """Element that resists bending, and in space twisting."""
        return next((e for e in self.elements if isinstance(e, Bend | BendTwist)), None)

    @property
    def stretch(self) -> Stretch | None:
        """Element that resists stretching."""
        return next((e for e in self.elements if isinstance(e, Stretch)), None)

    @property
    def mass(self) -> Float[Array, ""]:
        """Mass of the arm without water (kg)."""
        own = [0.5 * jnp.sum(e.mass) for e in self.elements if isinstance(e, Inertia)]
        return sum(own, start=jnp.zeros(()))

    def bending_stiffness(self, reference: Reference) -> Float[Array, " ways"]:
        """Return the mean bending stiffness (N m2); in space toward both directors."""
        bend = self._known_bend()
        stiffness = bend.stiffness.reshape(reference.nodes - 1, -1) * reference.strain_length[:-1]
        # a pinned root resists nothing, and is not what the arm is made of
        held = stiffness > 0
        ways = jnp.sum(stiffness, axis=0) / jnp.maximum(jnp.sum(held, axis=0), 1)
        return ways[: reference.axes - 1]

    def strains(self, motion: Motion) -> Float[Array, "bent strain"]:
        """Return by how much each node but the tip is bent beyond its rest, in space also twisted.

        Zero at a root that turns freely.
        """
        bend = self._known_bend()
        owned = self._windows(bend, motion)
        strains = jax.vmap(lambda e, m: e.strains(m))(bend, owned)
        rest, free = (
            values.reshape(strains.shape) for values in (bend.rest_strain, bend.stiffness == 0)
        )
        return jnp.where(free, 0.0, strains - rest)

    def _known_bend(self) -> Bend | BendTwist:
        if self.bend is None:
            raise ValueError("nothing resists bending: elements takes a Bend, in space a BendTwist")
        return self.bend

    @eqx.filter_jit
    def audit(self, motion: Motion) -> tuple[Float[Array, " energy"], Float[Array, "work n b"]]:
        """Return the stored energies (J), and the forces on the nodes that are not stored (N, N m).

        Contacts and the base aside.
        """
        position = self.nodes(motion.position)
        energy = dict.fromkeys(ENERGIES, jnp.zeros(()))
        working = dict.fromkeys(WORKS, jnp.zeros_like(position))
        for first, elements in self._groups():
            accounts = jax.vmap(_accounts)(elements, self._windows(elements[0], motion))
            for element, (stored, forces) in zip(elements, accounts, strict=True):
                energy[element.stored] += jnp.sum(stored)
                nodal = chain.scatter(forces, first, position.shape[0])
                rows = working[element.worked]
                working[element.worked] = rows.at[:, : nodal.shape[1]].add(nodal)
        return jnp.stack(list(energy.values())), jnp.stack(list(working.values()))

    def _groups(self) -> list[tuple[int, Elements]]:
        """Return the elements that act on the same windows together, by their first node.

        One pass over the windows then serves all of them: less to compile and to run. Those that
        bring a Jacobian of their own gain nothing from that.
        """
        groups: dict[tuple[int, int, int, bool, bool], Elements] = {}
        for element in self.elements:
            spins = element.spins and self.axes == 3
            own = isinstance(element, Linearised)
            key = (element.first, element.stencil, _count(element), spins, own)
            groups[key] = (*groups.get(key, ()), element)
        return [(first, elements) for (first, *_), elements in groups.items()]

    def _windows(self, element: Element, motion: Motion) -> Motion:
        count, width = _count(element), motion.position.shape[1] if element.spins else self.axes

        def gather(rows: Array) -> Array:
            return chain.gather(rows, element.first, count, element.stencil)

        return motion.windows(gather, (count,), width, turned=element.spins)

    def _bodies(self, motion: Motion) -> Motion:
        """Return the motion of the free obstacles, a window each."""
        free = self.nodes(motion.position).shape[0] + jnp.asarray(self.free)
        width = motion.position.shape[1]
        return motion.windows(lambda rows: rows[free][:, None], (len(self.free),), width)


def _course(stage: Stage, slopes: Slopes) -> Course:
    return Course(stage.by_position, stage.by_velocity, stage.by_acceleration, *slopes)


def _jacobian(
    course: Course, elements: Elements, window: Motion, load_factor: Array | None
) -> Array:
    """Return d(residual)/d(correction) of one window: ``(k, b, k, b)``."""
    known = [e.jacobian(window, course) for e in elements if isinstance(e, Linearised)]
    if known:  # then all of the group are
        return jnp.sum(jnp.stack(known), axis=0)

    def residual(window: Motion) -> Array:
        return jnp.sum(_residuals(elements, window, load_factor), axis=0)

    def along(direction: Float[Array, "k b"]) -> Array:
        return jax.jvp(residual, (window,), (course.tangent(window, direction),))[1]

    shape = window.position.shape
    basis = jnp.eye(shape[0] * shape[1]).reshape(-1, *shape)
    return jax.vmap(along, out_axes=-1)(basis).reshape(*shape, *shape)


def _count(element: Element) -> int:
    return int(jax.tree.leaves(element)[0].shape[0])


def _residuals(elements: Elements, window: Motion, load_factor: Array | None) -> Array:
    """Return the residual of each element in one window."""
    full = 1.0 if load_factor is None else load_factor
    return jnp.stack([(full if e.external else 1.0) * e.residual(window) for e in elements])


def _accounts(elements: Elements, window: Motion) -> list[tuple[Array, Array]]:
    return [(element.energy(window), element.working(window)) for element in elements]
