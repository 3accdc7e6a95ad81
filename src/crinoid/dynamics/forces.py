"""All forces on the arm: their balance, its tangent matrix, and their energies.

Whatever moves has a row in the arrays here: first the nodes, then the obstacles, then a vehicle's
two (`crinoid.dynamics.vehicle`). A row has ``b`` entries: ``d`` coordinates and, in space, the spin
of the edge that ends at the node.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid import chain
from crinoid.dynamics import windows
from crinoid.dynamics.arm import Arm
from crinoid.dynamics.integrator import Stage
from crinoid.dynamics.lines import Lines
from crinoid.dynamics.obstacles import Obstacles
from crinoid.dynamics.surroundings import Surroundings
from crinoid.dynamics.tangent import HELD, LineStiffness, Tangent
from crinoid.dynamics.vehicle import ROWS, Mount, Vehicle, paired, unknowns
from crinoid.elements import Motion
from crinoid.flow import Current, Water

Rows = Float[Array, "rows b"]
Points = Float[Array, "rows d"]


class Forces(Arm):
    """The elements of an arm, the water that they stand in, and the obstacles in it.

    Its larger methods are compiled functions: each is traced once, not at each place in a program
    that calls it.

    ``origin`` (m) is where in the world the arm's coordinates start: keeping them small keeps
    their round-off small, however deep the arm works.
    """

    water: Water
    origin: Float[Array, " d"]
    obstacles: Obstacles | None = None
    drive: Float[Array, " drive"] | None = None
    """Drives of the actuators, which elements find in a motion; None: there are no actuators."""
    vehicle: Vehicle | None = None
    """The submarine where it floats; None where the base goes where it is told."""
    lines: Lines | None = None
    """Tendons and chambers among the elements whose length or content is given."""
    mount: Mount | None = None
    """Where the vehicle holds the arm; None where it stays, and what it holds with it."""

    def frozen(self, time: Float[Array, ""]) -> "Forces":
        """Return the forces in the flow as it is at ``time``, for good: what statics balances.

        Obstacles stay where they are, and so does a vehicle.
        """
        water = Water(self.water.flows, time)
        held = None if self.obstacles is None else self.obstacles.held()
        return replace(self, water=water, obstacles=held, mount=None)

    def driven(self, drive: Float[Array, " drive"] | None) -> "Forces":
        """Return the forces where the actuators drive the arm so."""
        return replace(self, drive=drive)

    def mounted(self, mount: Mount | None) -> "Forces":
        """Return the forces where the vehicle holds the arm so."""
        return replace(self, mount=mount)

    def nodes(self, rows: Rows) -> Float[Array, "n b"]:
        """Return the rows of the nodes."""
        rows = self.without_vehicle(rows)
        return rows if self.obstacles is None else rows[: -self.obstacles.count]

    def without_vehicle(self, rows: Rows) -> Float[Array, "fewer b"]:
        """Return the rows of nodes and obstacles."""
        return rows if self.vehicle is None else rows[:-ROWS]

    def unknown(self, rows: Rows, turn: Array | float = 1.0) -> Float[Array, "unknown b"]:
        """Return the rows that a step solves for: free nodes, free obstacles, a vehicle's rows.

        Entries of its turn are multiplied by ``turn``.
        """
        nodes = self.nodes(rows)
        parts = [nodes[HELD:]]
        if self.free:
            parts.append(rows[nodes.shape[0] + jnp.asarray(self.free)])
        if self.mount is not None:
            parts += [rows[-2:-1], turn * rows[-1:]]
        return parts[0] if len(parts) == 1 else jnp.concatenate(parts)

    @property
    def reach(self) -> Float[Array, ""]:
        """How far a turn of the vehicle moves it (m); 1 where there is none."""
        return jnp.ones(()) if self.vehicle is None else self.vehicle.reach

    @property
    def free(self) -> tuple[int, ...]:
        """Which obstacles are free."""
        return () if self.obstacles is None else self.obstacles.free

    def extra(self, size: int) -> tuple[int, ...]:
        """Return which entries of the rows after the nodes are solved for; a row has ``size``."""
        free = tuple(size * body + i for body in self.free for i in range(size))
        if self.mount is None:
            return free
        first = 0 if self.obstacles is None else self.obstacles.count
        return (*free, *(first * size + i for i in unknowns(self.axes, size)))

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
        position = self._points(stage.position + stage.by_position * correction)

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
        rows = (
            stage.position + stage.by_position * correction,
            stage.velocity + stage.by_velocity * correction,
            stage.acceleration + stage.by_acceleration * correction,
        )
        return self._moving(stage, rows, around)

    def _moving(self, stage: Stage, rows: tuple[Rows, ...], around: Surroundings) -> Motion:
        """Return the motion where all but what a vehicle holds moves so."""
        position, velocity, acceleration = rows
        frames = stage.frames
        if self.mount is not None:
            held = self.mount.ride(*rows).carried(self.mount.held, frames)
            position, velocity, acceleration = (
                chain.begun_with(carried, row) for row, carried in zip(rows, held, strict=True)
            )
        motion = Motion(
            position,
            velocity,
            acceleration,
            *around.at(self._points(position)),
            stage.time,
            None if frames is None else frames.at(self.nodes(position)),
            self.drive,
        )
        if self.lines is None:
            return motion
        return replace(motion, line=self.lines.loads(self.elements, motion))

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
        for first, elements in windows.groups(self.elements, self.axes):
            local = jax.vmap(lambda e, m: windows.residuals(e, m, load_factor))
            forces = local(elements, windows.gathered(elements[0], motion))
            width = forces.shape[-1]
            nodal = chain.scatter(jnp.sum(forces, axis=1), first, num_nodes)
            total += chain.widened(nodal, size)
            most = jnp.max(jnp.abs(forces), axis=(0, 1, 2))
            largest = jnp.maximum(largest, jnp.pad(most, (0, size - width)))
        rows = total
        if self.obstacles is not None:
            _, pushed = self.obstacles.push(self.beside(motion))
            largest = jnp.maximum(largest, jnp.max(jnp.abs(pushed), axis=0))
            rows = jnp.pad(total, ((0, self.obstacles.count), (0, 0))) - pushed
            if self.free:
                own = jax.vmap(lambda e, m: windows.residuals((e,), m, None)[0])
                bodies = own(self.obstacles.bodies, self._bodies(motion))[:, 0]
                free = num_nodes + jnp.asarray(self.free)
                rows = rows.at[free].add(bodies, unique_indices=True)
                largest = jnp.maximum(largest, jnp.max(jnp.abs(bodies), axis=0))
        if self.vehicle is None:
            return rows, largest
        pushed = jnp.zeros((ROWS, size))
        if self.mount is not None:
            pushed = self._on_vehicle(motion, rows[:HELD])
        return jnp.concatenate([rows, pushed]), largest

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

        def jacobian(elements: windows.Elements, window: Motion, slopes: windows.Slopes) -> Array:
            return windows.jacobian(windows.course(stage, slopes), elements, window, load_factor)

        jacobians = jax.vmap(jacobian)
        # elements that do without spins are assembled on positions only
        blocks: dict[int, list[tuple[int, Array]]] = {self.axes: [], size: []}
        for first, elements in windows.groups(self.elements, self.axes):
            count, stencil = windows.count(elements[0]), elements[0].stencil
            window = windows.gathered(elements[0], motion)
            along = jax.tree.map(
                partial(chain.gather, first=first, count=count, stencil=stencil), slopes
            )
            block = jacobians(elements, window, along)
            blocks[block.shape[-1]].append((first, block))
        obstacles = self.obstacles
        if obstacles is not None:
            pairs = obstacles.motions(self.beside(motion))
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
        border = None
        if obstacles is not None and self.free:
            free = jnp.asarray(self.free)
            of_free = jax.tree.map(lambda slope: slope[num_nodes + free][:, None], slopes)
            own = jacobians((obstacles.bodies,), self._bodies(motion), of_free)[:, 0, :, 0]
            border = obstacles.border(touch, own, num_nodes)
        extra = self.extra(size)
        tangent = Tangent(bands, border, extra[: size * len(self.free)])
        if self.mount is not None:
            tangent = self._with_vehicle(tangent, stage, motion, around, load_factor)
        if self.lines is None:
            return tangent

        def residual(line: Array | None) -> Rows:
            return self.residual(replace(motion, line=line), load_factor)[0]

        follow = self.lines.slopes(self.elements, stage, motion, num_nodes)
        return tangent.coupled(LineStiffness(jax.jacfwd(residual)(motion.line), follow))

    def _with_vehicle(
        self,
        tangent: Tangent,
        stage: Stage,
        motion: Motion,
        around: Surroundings,
        load_factor: Array | None,
    ) -> Tangent:
        """Border a tangent by the unknowns of the vehicle, which move what it holds."""
        rows, size = motion.position.shape
        own = np.array(unknowns(self.axes, size))
        rates = (stage.by_position, stage.by_velocity, stage.by_acceleration)

        def along(way: Float[Array, "rows b"]) -> Rows:
            def residual(*moving: Rows) -> Rows:
                return self.residual(self._moving(stage, moving, around), load_factor)[0]

            return jax.jvp(residual, _rows(motion), tuple(rate * way for rate in rates))[1]

        def push(held: Float[Array, "held b"]) -> Float[Array, " p"]:
            return self._on_vehicle(motion, held, alone=False).reshape(-1)[own]

        ways = np.zeros((own.size, rows * size))
        ways[np.arange(own.size), (rows - ROWS) * size + own] = 1.0
        columns = jax.vmap(along, out_axes=-1)(jnp.asarray(ways.reshape(-1, rows, size)))
        return tangent.bordered(columns, push, self.extra(size)[len(tangent.extra) :])

    def _on_vehicle(
        self, motion: Motion, held: Float[Array, "held b"], *, alone: bool = True
    ) -> Float[Array, "2 b"]:
        """Return the imbalance of the vehicle's rows for forces on what it holds.

        Without what acts on the vehicle alone it is linear in these.
        """
        vehicle, mount = self.vehicle, self.mount
        assert vehicle is not None
        assert mount is not None
        ride = mount.ride(*_rows(motion))
        force, moment = ride.pushed(mount.held, held)
        if alone:
            own = vehicle.residual(ride, motion.flow_velocity[-2], motion.flow_acceleration[-2])
            force, moment = force + own[0], moment + own[1]
        return paired(force, moment, held.shape[1])

    def _points(self, rows: Rows) -> Points:
        """Return where each row is; of a vehicle's turn where its centre of mass is."""
        points = rows[:, : self.axes]
        return points if self.vehicle is None else points.at[-1].set(points[-2])

    def attitude(self, motion: Motion) -> Float[Array, "d d"] | None:
        """Return the attitude of the vehicle, if there is one that moves."""
        return None if self.mount is None else self.mount.ride(*_rows(motion)).attitude

    def gaps(self, rows: Rows) -> Float[Array, "m e"] | None:
        """Return how far each obstacle is from each edge (m)."""
        return None if self.obstacles is None else self.obstacles.gaps(self.without_vehicle(rows))

    def beside(self, motion: Motion) -> Motion:
        """Return the motion of nodes and obstacles."""
        if self.vehicle is None:
            return motion
        parts = (*_rows(motion), motion.flow_velocity, motion.flow_acceleration)
        return eqx.tree_at(
            lambda m: (*_rows(m), m.flow_velocity, m.flow_acceleration),
            motion,
            tuple(map(self.without_vehicle, parts)),
        )

    def _bodies(self, motion: Motion) -> Motion:
        """Return the motion of the free obstacles, a window each."""
        free = self.nodes(motion.position).shape[0] + jnp.asarray(self.free)
        width = motion.position.shape[1]
        return motion.windows(lambda rows: rows[free][:, None], (len(self.free),), width)


def _rows(motion: Motion) -> tuple[Any, Any, Any]:
    return motion.position, motion.velocity, motion.acceleration
