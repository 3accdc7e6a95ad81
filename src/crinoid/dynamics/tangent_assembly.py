"""Assembly of the tangent matrix from the Jacobians of laws."""

from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics import windows
from crinoid.dynamics.acting import ActingForces, rows_of_motion
from crinoid.dynamics.bordered import Border
from crinoid.dynamics.far_contact import NODES
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import ROOT, VEHICLE_ROWS, Rows
from crinoid.dynamics.tangent import LineStiffness, Tangent
from crinoid.dynamics.vehicle import unknowns
from crinoid.dynamics.windows import Surroundings
from crinoid.elements import Motion
from crinoid.numerics import banded, index_array


def assemble_tangent(
    forces: ActingForces,
    stage: StepMap,
    motion: Motion,
    around: Surroundings,
    load_factor: Array | None = None,
) -> Tangent:
    """Return d(residual)/d(correction), assembled from the elements' Jacobians."""
    (rows, size), num_nodes = motion.position.shape, forces.num_nodes(motion.position)

    def blocks(group: windows.LawGroup) -> Float[Array, "w k b k b"]:
        return group.jacobians(stage, motion, around, load_factor)

    near, others = [], []
    for group in forces.groups(motion.position):
        found, index = blocks(group), group.index
        nodes = int(np.sum(index.reshape(-1, index.shape[-1])[0] < num_nodes))
        if nodes == index.shape[-1]:
            near.append((int(index[0, 0]), found))
            continue
        others.append((found, index, nodes))
        if nodes:
            edges = found[:, None, :nodes, :, :nodes]
            along = index_array.scatter(edges, index[..., :1], num_nodes)
            near.append((ROOT, along[ROOT : num_nodes - 1]))

    def far_blocks(group: windows.LawGroup) -> Float[Array, "n b n b"]:
        among, at = blocks(group)[:, :NODES, :, :NODES], group.index[:, :NODES]
        return index_array.scatter_blocks(among, at, at, (num_nodes, num_nodes))

    far = [each.where_pressing(motion, forces.heading, far_blocks) for each in forces.far_contacts]
    bodies = forces.body_unknowns(size)
    tangent = Tangent(
        banded.assemble(near, num_nodes, size),
        _border(others, (num_nodes, rows - num_nodes), np.array(bodies)) if bodies else None,
        bodies,
        far=sum(far[1:], far[0]) if far else None,
    )
    if forces.context.clamp is not None:
        tangent = _with_vehicle(forces, tangent, stage, motion, around, load_factor)
    if forces.lines is None:
        return tangent

    def residual(line: Array | None) -> Rows:
        return forces.residual(replace(motion, line=line), load_factor)[0]

    follow = forces.lines.slopes(forces.arm, stage, motion, num_nodes)
    return tangent.coupled(LineStiffness(jax.jacfwd(residual)(motion.line), follow))


def _border(
    others: list[tuple[Array, Any, int]], shape: tuple[int, int], at: Int[np.ndarray, " p"]
) -> Border:
    """Return the blocks that couple nodes and free bodies, from those of laws on both.

    ``others`` has blocks, index array, and the number of nodes in a window: its first rows.
    ``shape`` is the number of nodes and of other rows, ``at`` has the unknowns among the latter.
    """
    (num_nodes, count), size = shape, others[0][0].shape[2]
    of_nodes = jnp.zeros((num_nodes, size, count, size))
    of_bodies, corner = jnp.moveaxis(of_nodes, (0, 1), (2, 3)), jnp.zeros((count, size) * 2)
    for blocks, index, nodes in others:
        arm, bodies = index[..., :nodes], index[..., nodes:] - num_nodes
        if nodes:
            across, back = blocks[:, :nodes, :, nodes:], blocks[:, nodes:, :, :nodes]
            of_nodes += index_array.scatter_blocks(across, arm, bodies, shape)
            of_bodies += index_array.scatter_blocks(back, bodies, arm, shape[::-1])
        own = blocks[:, nodes:, :, nodes:]
        corner += index_array.scatter_blocks(own, bodies, bodies, (count, count))
    return Border(
        of_nodes.reshape(num_nodes, size, -1)[..., at],
        of_bodies.reshape(-1, num_nodes, size)[at],
        corner.reshape(count * size, -1)[at][:, at],
    )


def _with_vehicle(
    forces: ActingForces,
    tangent: Tangent,
    stage: StepMap,
    motion: Motion,
    around: Surroundings,
    load_factor: Array | None,
) -> Tangent:
    """Border a tangent by the unknowns of the vehicle, which move the clamp."""
    rows, size = motion.position.shape
    own = np.array(unknowns(forces.axes, size))
    rates = (stage.by_position, stage.by_velocity, stage.by_acceleration)

    def along(way: Float[Array, "rows b"]) -> Rows:
        def residual(*moving: Rows) -> Rows:
            return forces.residual(forces.moving_rows(stage, moving, around), load_factor)[0]

        return jax.jvp(residual, rows_of_motion(motion), tuple(rate * way for rate in rates))[1]

    def push(held: Float[Array, "held b"]) -> Float[Array, " p"]:
        return forces.on_vehicle(motion, held, alone=False).reshape(-1)[own]

    ways = np.zeros((own.size, rows * size))
    ways[np.arange(own.size), (rows - VEHICLE_ROWS) * size + own] = 1.0
    columns = jax.vmap(along, out_axes=-1)(jnp.asarray(ways.reshape(-1, rows, size)))
    return tangent.bordered(columns, push, forces.extra(size)[len(tangent.extra) :])
