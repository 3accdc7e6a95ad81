"""Assembly of the tangent matrix from the Jacobians of laws."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.dynamics import windows
from crinoid.dynamics.acting import ActingForces, rows_of_motion
from crinoid.dynamics.forces import Rows
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.rows import VEHICLE_ROWS
from crinoid.dynamics.tangent import LineStiffness, Tangent
from crinoid.dynamics.vehicle import unknowns
from crinoid.dynamics.windows import Surroundings
from crinoid.elements import Element, Motion
from crinoid.numerics import banded


def assemble_tangent(
    forces: ActingForces,
    stage: StepMap,
    motion: Motion,
    around: Surroundings,
    load_factor: Array | None = None,
) -> Tangent:
    """Return d(residual)/d(correction), assembled from the elements' Jacobians."""
    size = motion.position.shape[1]
    num_nodes = forces.nodes(motion.position).shape[0]
    slopes = (around.velocity_slope, around.acceleration_slope)

    def jacobian(laws: windows.Laws, window: Motion, slopes: windows.Slopes) -> Array:
        return windows.jacobian(windows.tangent_direction(stage, slopes), laws, window, load_factor)

    jacobians = jax.vmap(jacobian)
    blocks: list[tuple[int, Array]] = []
    for first, laws in windows.groups(forces.arm.laws, forces.axes):
        element = laws[0][0]
        at = partial(
            banded.gather, first=first, count=windows.count(element), stencil=element.stencil
        )
        along = jax.tree.map(at, slopes)
        blocks.append((first, jacobians(laws, windows.motion_windows(element, motion), along)))
    obstacles = forces.obstacles
    if obstacles is not None:
        pairs = obstacles.motions(forces.obstacle_motion(motion), forces.pose)
        # contact does not depend on the water
        still = jnp.zeros((*pairs.flow_velocity.shape, forces.axes))
        touch = obstacles.each(lambda e, m, s: jacobian(((e, None),), m, (s, None)), pairs, still)
        touch = touch.reshape(obstacles.count, -1, *touch.shape[1:])
        on_edges = obstacles.on_edges(jnp.sum(touch[:, :, :2, :, :2], axis=0))
        blocks.append((obstacles.contact.first, on_edges))
    bands = banded.assemble(blocks, num_nodes, size)
    border = None
    if obstacles is not None and obstacles.bodies is not None and forces.free:

        def of_rows(element: Element, window: Motion, rows: Int[np.ndarray, "w k"]) -> Array:
            along = jax.tree.map(lambda slope: slope[num_nodes + rows], slopes)
            return jacobians(((element, None),), window, along)

        near = forces.obstacle_motion(motion)
        own = obstacles.bodies.stiffness(near, forces.pose, of_rows)
        border = obstacles.border(touch, own, num_nodes)

    def of_window(contact: Element, window: Motion) -> Array:
        still = jnp.zeros((*window.flow_velocity.shape, forces.axes))
        return jacobian(((contact, None),), window, (still, None))

    far = [
        each.stiffness(motion, forces.heading, of_window, num_nodes) for each in forces.far_contacts
    ]
    extra = forces.extra(size)
    own_unknowns = 0 if border is None else border.corner.shape[0]
    bodies = extra[:own_unknowns]
    tangent = Tangent(bands, border, bodies, far=sum(far[1:], far[0]) if far else None)
    if forces.context.clamp is not None:
        tangent = _with_vehicle(forces, tangent, stage, motion, around, load_factor)
    if forces.lines is None:
        return tangent

    def residual(line: Array | None) -> Rows:
        return forces.residual(replace(motion, line=line), load_factor)[0]

    follow = forces.lines.slopes(forces.arm, stage, motion, num_nodes)
    return tangent.coupled(LineStiffness(jax.jacfwd(residual)(motion.line), follow))


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
