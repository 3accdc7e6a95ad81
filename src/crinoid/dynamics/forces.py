"""All forces on the arm: residual, tangent matrix and energies.

Arrays have a row for each node, obstacle and vehicle (`crinoid.dynamics.rows`). A row has ``b``
entries: ``d`` coordinates and, in space, the spin of the edge that ends at the node.
"""

from dataclasses import replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics import windows
from crinoid.dynamics.arm import Memory
from crinoid.dynamics.arm_with_bodies import ArmWithBodies
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import (
    BOUNDARY_NODES,
    CENTRE,
    ROTATION,
    VEHICLE_ROWS,
)
from crinoid.dynamics.tangent import LineStiffness, Tangent
from crinoid.dynamics.vehicle import Mount, unknowns, vehicle_rows
from crinoid.dynamics.windows import Surroundings
from crinoid.elements import Element, Motion, Pose
from crinoid.flow import Current, Water
from crinoid.numerics import banded

Rows = Float[Array, "rows b"]
Points = Float[Array, "rows d"]


class Forces(ArmWithBodies):
    """All forces on an arm and on the bodies around it.

    The larger methods are compiled functions, traced once and not at each call in a program.
    """

    def frozen(self, time: Float[Array, ""]) -> "Forces":
        """Return the forces in the flow frozen at ``time``, obstacles and vehicle held still."""
        water = Water(self.water.flows, time)
        held = None if self.obstacles is None else self.obstacles.held()
        return replace(self, water=water, obstacles=held, mount=None)

    def driven(self, drive: Float[Array, " drive"] | None) -> "Forces":
        """Return a copy of the forces with given drives; None without actuators."""
        return replace(self, drive=drive)

    def mounted(self, mount: Mount | None) -> "Forces":
        """Return the forces with the arm clamped on a vehicle."""
        return replace(self, mount=mount)

    def remembering(self, memory: Memory, step: Array | float) -> "Forces":
        """Return the forces with the memory of elements at the start of a step of given length."""
        elements = tuple(
            element
            if held is None
            else element.remembering(held, jnp.full(windows.count(element), step))
            for element, held in zip(self.elements, memory, strict=True)
        )
        return replace(self, elements=elements)

    def turned(
        self,
        attitude: Float[Array, "d d"] | None,
        of_obstacles: Float[Array, "m d d"] | None,
        position: Rows,
    ) -> "Forces":
        """Return the forces with a vehicle held still at an attitude, and that of the obstacles.

        A step starts with the latter.
        """
        far = tuple(each.turned(attitude) for each in self.far_contacts)
        obstacles = self.obstacles
        if of_obstacles is not None and obstacles is not None and obstacles.bodies is not None:
            bodies = obstacles.bodies
            turn = position[self.rows.rotations, : bodies.spin.shape[1]]
            pose = Pose(of_obstacles, turn)
            obstacles = replace(obstacles, bodies=replace(bodies, pose=pose))
        return replace(self, far_contacts=far, obstacles=obstacles)

    @eqx.filter_jit
    def surroundings(self, stage: StepMap, correction: Rows) -> Surroundings:
        """Return the water around the rows for a correction."""
        position = self._points(stage.position + stage.by_position * correction)

        def current(point: Float[Array, " d"]) -> Current:
            return self.water.current(self.origin + point, stage.time)

        water, slope = jax.vmap(current)(position), None
        # needed for an equilibrium only
        if self.water.frozen_at is not None:
            slope = jax.vmap(jax.jacfwd(lambda point: current(point).acceleration))(position)
        velocity, acceleration = water.velocity, water.acceleration
        return Surroundings(position, velocity, acceleration, water.velocity_slope, slope)

    @eqx.filter_jit
    def motion(self, stage: StepMap, correction: Rows, around: Surroundings) -> Motion:
        """Return the motion of all rows and of the water there, for a correction."""
        rows = (
            stage.position + stage.by_position * correction,
            stage.velocity + stage.by_velocity * correction,
            stage.acceleration + stage.by_acceleration * correction,
        )
        return self._moving(stage, rows, around)

    def _moving(self, stage: StepMap, rows: tuple[Rows, ...], around: Surroundings) -> Motion:
        """Return the motion from all rows except those clamped on a vehicle."""
        position, velocity, acceleration = rows
        frames = stage.frames
        if self.mount is not None:
            held = self.mount.kinematics(*rows).to_world(self.mount.held, frames)
            position, velocity, acceleration = (
                banded.with_first_rows(first, row) for row, first in zip(rows, held, strict=True)
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
        """Return the residual of each row, and the largest single force in it of each column (N).

        The column of spins has torques (N m).
        """
        size = motion.position.shape[1]
        num_nodes = self.nodes(motion.position).shape[0]
        total, largest = jnp.zeros((num_nodes, size)), jnp.zeros(size)
        for first, elements in windows.groups(self.elements, self.axes):
            local = jax.vmap(lambda e, m: windows.residuals(e, m, load_factor))
            forces = local(elements, windows.motion_windows(elements[0], motion))
            width = forces.shape[-1]
            nodal = banded.scatter(jnp.sum(forces, axis=1), first, num_nodes)
            total += banded.pad_columns(nodal, size)
            most = jnp.max(jnp.abs(forces), axis=(0, 1, 2))
            largest = jnp.maximum(largest, jnp.pad(most, (0, size - width)))
        for far in self.far_contacts_at(motion.position):
            pushed = far.push(motion)[:num_nodes]
            largest = jnp.maximum(largest, jnp.max(jnp.abs(pushed[far.first_row :]), axis=0))
            total -= pushed
        rows = total
        if self.obstacles is not None:
            near = self.obstacle_motion(motion)
            _, pushed = self.obstacles.push(near)
            forces = pushed[: num_nodes + self.obstacles.count]  # without moments
            largest = jnp.maximum(largest, jnp.max(jnp.abs(forces), axis=0))
            rows = jnp.pad(total, ((0, self.obstacles.rows), (0, 0))) - pushed
            if self.free and self.obstacles.bodies is not None:
                bodies, most = self.obstacles.bodies.residual(near)
                rows = rows.at[num_nodes:].add(bodies)
                largest = jnp.maximum(largest, most)
        if self.vehicle is None:
            return rows, largest
        pushed = jnp.zeros((VEHICLE_ROWS, size))
        if self.mount is not None:
            pushed = self._on_vehicle(motion, rows[:BOUNDARY_NODES])
        return jnp.concatenate([rows, pushed]), largest

    def tangent(
        self,
        stage: StepMap,
        motion: Motion,
        around: Surroundings,
        load_factor: Array | None = None,
    ) -> Tangent:
        """Return d(residual)/d(correction), assembled from the elements' Jacobians."""
        size = motion.position.shape[1]
        num_nodes = self.nodes(motion.position).shape[0]
        slopes = (around.velocity_slope, around.acceleration_slope)

        def jacobian(elements: windows.Elements, window: Motion, slopes: windows.Slopes) -> Array:
            return windows.jacobian(
                windows.tangent_direction(stage, slopes), elements, window, load_factor
            )

        jacobians = jax.vmap(jacobian)
        blocks: list[tuple[int, Array]] = []
        for first, elements in windows.groups(self.elements, self.axes):
            count, stencil = windows.count(elements[0]), elements[0].stencil
            window = windows.motion_windows(elements[0], motion)
            along = jax.tree.map(
                partial(banded.gather, first=first, count=count, stencil=stencil), slopes
            )
            blocks.append((first, jacobians(elements, window, along)))
        obstacles = self.obstacles
        if obstacles is not None:
            pairs = obstacles.motions(self.obstacle_motion(motion))
            # contact does not depend on the water
            still = jnp.zeros((*pairs.flow_velocity.shape, self.axes))
            touch = obstacles.each(lambda c, m, s: jacobian((c,), m, (s, None)), pairs, still)
            touch = touch.reshape(obstacles.count, -1, *touch.shape[1:])
            on_edges = obstacles.on_edges(jnp.sum(touch[:, :, :2, :, :2], axis=0))
            blocks.append((obstacles.contact.first, on_edges))
        bands = banded.assemble(blocks, num_nodes, size)
        border = None
        if obstacles is not None and obstacles.bodies is not None and self.free:

            def of_rows(element: Element, window: Motion, rows: Int[np.ndarray, "w k"]) -> Array:
                along = jax.tree.map(lambda slope: slope[num_nodes + rows], slopes)
                return jacobians((element,), window, along)

            own = obstacles.bodies.stiffness(self.obstacle_motion(motion), of_rows)
            border = obstacles.border(touch, own, num_nodes)
        far_contacts = self.far_contacts_at(motion.position)

        def of_window(contact: Element, window: Motion) -> Array:
            still = jnp.zeros((*window.flow_velocity.shape, self.axes))
            return jacobian((contact,), window, (still, None))

        far = [each.stiffness(motion, of_window, num_nodes) for each in far_contacts]
        extra = self.extra(size)
        own_unknowns = 0 if border is None else border.corner.shape[0]
        bodies = extra[:own_unknowns]
        tangent = Tangent(bands, border, bodies, far=sum(far[1:], far[0]) if far else None)
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
        stage: StepMap,
        motion: Motion,
        around: Surroundings,
        load_factor: Array | None,
    ) -> Tangent:
        """Border a tangent by the unknowns of the vehicle, which move the clamp."""
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
        ways[np.arange(own.size), (rows - VEHICLE_ROWS) * size + own] = 1.0
        columns = jax.vmap(along, out_axes=-1)(jnp.asarray(ways.reshape(-1, rows, size)))
        return tangent.bordered(columns, push, self.extra(size)[len(tangent.extra) :])

    def _on_vehicle(
        self, motion: Motion, held: Float[Array, "held b"], *, alone: bool = True
    ) -> Float[Array, "2 b"]:
        """Return the residual of the vehicle's rows for forces on the clamp.

        Without the forces on the vehicle ``alone`` it is linear in these.
        """
        vehicle, mount = self.vehicle, self.mount
        assert vehicle is not None
        assert mount is not None
        kinematics = mount.kinematics(*_rows(motion))
        force, moment = kinematics.resultant(mount.held, held)
        if alone:
            own = vehicle.residual(
                kinematics, motion.flow_velocity[CENTRE], motion.flow_acceleration[CENTRE]
            )
            force, moment = force + own[0], moment + own[1]
        return vehicle_rows(force, moment, held.shape[1])

    def _points(self, rows: Rows) -> Points:
        """Return the position of each row; that of a rotation is the centre of mass."""
        points = rows[:, : self.axes]
        if self.turns:
            points = points.at[self.rows.rotations].set(points[self.rows.obstacles])
        return points if self.vehicle is None else points.at[ROTATION].set(points[CENTRE])

    def obstacle_motion(self, motion: Motion) -> Motion:
        """Return the motion of nodes and obstacles."""
        if self.vehicle is None:
            return motion
        parts = (*_rows(motion), motion.flow_velocity, motion.flow_acceleration)
        return eqx.tree_at(
            lambda m: (*_rows(m), m.flow_velocity, m.flow_acceleration),
            motion,
            tuple(part[self.rows.arm_and_obstacles] for part in parts),
        )


def _rows(motion: Motion) -> tuple[Any, Any, Any]:
    return motion.position, motion.velocity, motion.acceleration
