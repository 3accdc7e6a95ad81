"""State of an arm, and the account of its energy."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from crinoid.base import Base, ServoState
from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.context import Context, Memory
from crinoid.dynamics.forces import Forces
from crinoid.dynamics.gripper import GripState
from crinoid.dynamics.newton import ReusedTangent
from crinoid.dynamics.obstacles import Touch
from crinoid.dynamics.rows import BOUNDARY_NODES, CENTRE, ROTATION, RowLayout
from crinoid.elements import WORKS, Motion, Pose, VehiclePose
from crinoid.numerics.frames import Frames, beyond, unit

Nodes = Any  # (n, d), of one state or of many at once, in JAX or NumPy


class State(eqx.Module):
    """State of arm, water, actuators and solver. SI units; positions from the base's set one.

    Node 0 is the ghost behind the root, node 1 the root. A step needs nothing else; works and
    impulses of contacts are in `crinoid.dynamics.EnergyAccount`.

    Attributes
    ----------
    motion
        Motion of the nodes, then of the obstacles and of a vehicle, and of the water there.
    auxiliary_offset
        Auxiliary acceleration of generalized-alpha less the true one, over the last step
        (m/s3).
    servo
        State of the base's servos: its channels (m or rad) and how they move.
    actuators
        States of the other actuators.
    reaction
        Force of the base on the ghost node and the root (N), torque about the ghost edge
        (N m).
    gap
        Distance of each obstacle from the surface of each edge (m).
    acceleration_history
        Accelerations of the five steps before, the last one first, for the predictor.
    predictor_accepted
        Whether Newton's method accepted the prediction of the last step unchanged.
    reused_tangent
        Last tangent of Newton's method, which the next step tries first.
    attitude
        Matrix from the axes of a floating vehicle to those of the world.
    grip
        Grip of a tool, if touches take it up or let it go.
    far_gaps
        Distances of the surfaces in each contact of far parts, or lower bounds where none
        presses (m; `crinoid.dynamics.FarContact`).
    obstacle_attitude
        Matrix from the axes of each obstacle to those of the world, where some are free.
    body_gap
        Distance of the surfaces of each pair of a free obstacle with another one (m).
    memory
        Memory of each element (`crinoid.Element`); None for those without.

    Examples
    --------
    >>> state = crinoid.system("still-water").rest()
    >>> float(state.time), state.position.shape
    (0.0, (22, 2))
    """

    motion: Motion
    auxiliary_offset: Float[Array, "rows b"]
    servo: ServoState
    actuators: tuple[Any, ...]
    reaction: Float[Array, "2 b"]
    gap: Float[Array, "m e"] | None
    acceleration_history: Float[Array, "5 rows b"]
    predictor_accepted: Bool[Array, ""]
    reused_tangent: ReusedTangent
    attitude: Float[Array, "d d"] | None = None
    grip: GripState | None = None
    far_gaps: tuple[Float[Array, " _"], ...] = ()
    obstacle_attitude: Float[Array, "m d d"] | None = None
    body_gap: Float[Array, " pair"] | None = None
    memory: Memory = ()

    @staticmethod
    def of(
        forces: ActingForces,
        motion: Motion,
        reaction: Float[Array, "2 b"],
        followers: Sequence[Any],
        memory: Memory,
    ) -> "State":
        """Return the state of a motion that is balanced by forces, after a steady motion.

        ``reaction`` has the forces on the ghost node and the root (N), ``followers`` the states of
        the base's servo and of the other actuators.
        """
        servo, *actuators = followers
        rows = motion.position
        return State(
            motion=motion,
            auxiliary_offset=jnp.zeros_like(rows),
            servo=servo,
            actuators=tuple(actuators),
            reaction=reaction,
            gap=forces.gaps(rows),
            far_gaps=forces.far_gaps(rows),
            acceleration_history=jnp.stack([motion.acceleration] * 5),
            predictor_accepted=jnp.asarray(False),
            reused_tangent=ReusedTangent.none(forces, rows),
            attitude=forces.attitude(rows),
            obstacle_attitude=forces.obstacle_attitude(motion),
            body_gap=forces.body_gaps(rows),
            grip=forces.context.grip,
            memory=memory,
        )

    @property
    def context(self) -> Context:
        """Context of the forces at the start of a step from here."""
        pose, heading, turns = None, None, self.motion.position[:, : 1 if self._axes == 2 else 3]
        if self.obstacle_attitude is not None:
            pose = Pose(self.obstacle_attitude, turns[self._rows.rotations])
        if self.attitude is not None:
            heading = VehiclePose(self.attitude, turns[ROTATION])
        drive, step = self.motion.drive, jnp.zeros(())
        return Context(drive, self.memory, step, self.grip, pose, heading)

    @property
    def time(self) -> Any:
        """Time (s)."""
        return self.motion.time

    @property
    def position(self) -> Nodes:
        """Positions of the nodes (m)."""
        return self._nodes(self.motion.position)[..., : self._axes]

    @property
    def velocity(self) -> Nodes:
        """Velocities of the nodes (m/s)."""
        return self._nodes(self.motion.velocity)[..., : self._axes]

    @property
    def acceleration(self) -> Nodes:
        """Accelerations of the nodes (m/s2)."""
        return self._nodes(self.motion.acceleration)[..., : self._axes]

    @property
    def flow_velocity(self) -> Nodes:
        """Velocity of the undisturbed water at the nodes (m/s)."""
        return self._nodes(self.motion.flow_velocity)

    @property
    def frames(self) -> Frames | None:
        """Frames of the edges, from which those of a later shape follow; None in the plane."""
        orientation = self.motion.orientation
        if orientation is None:
            return None
        return Frames.of(self._nodes(self.motion.position), orientation)

    @property
    def base_force(self) -> Float[Array, "*many d"]:
        """Force of the arm on the submarine (N)."""
        return Base.wrench(self.position[..., :BOUNDARY_NODES, :], self.reaction)[0]

    @property
    def base_moment(self) -> Float[Array, "..."]:
        """Moment of the arm on the submarine about the root (N m); one number in the plane."""
        return Base.wrench(self.position[..., :BOUNDARY_NODES, :], self.reaction)[1]

    @property
    def obstacle_position(self) -> Any:
        """Positions of the obstacles (m), if there are any."""
        return self._obstacles(self.motion.position)

    @property
    def obstacle_velocity(self) -> Any:
        """Velocities of the obstacles (m/s), if there are any."""
        return self._obstacles(self.motion.velocity)

    @property
    def obstacle_spin(self) -> Any:
        """Angular velocities of the obstacles (rad/s), if some are free."""
        if self.obstacle_attitude is None:
            return None
        turns = 1 if self._axes == 2 else 3
        return self.motion.velocity[..., self._rows.rotations, :turns]

    @property
    def vehicle_position(self) -> Any:
        """Position of the centre of mass of a floating vehicle (m), if there is one."""
        return None if self.attitude is None else self.motion.position[..., CENTRE, : self._axes]

    @property
    def _axes(self) -> int:
        return int(self.motion.flow_velocity.shape[-1])

    def _obstacles(self, rows: Any) -> Any:
        return None if self.gap is None else rows[..., self._rows.obstacles, : self._axes]

    def _nodes(self, rows: Nodes) -> Nodes:
        return rows[..., self._rows.nodes, :]

    @property
    def _rows(self) -> RowLayout:
        count = 0 if self.gap is None else self.gap.shape[-2]
        turning = self.obstacle_attitude is not None
        return RowLayout.of(count, turning=turning, vehicle=self.attitude is not None)


def tip_pose(position: Float[Array, "n d"]) -> Float[Array, " pose"]:
    """Return the tip's pose (m, rad; `crinoid.foundation.axes.POSE`) in the arm's coordinates.

    The last edge has the arm's direction half an edge before the tip; its turn is extrapolated.
    """
    (last, _), (before, _) = unit(position[-1] - position[-2]), unit(position[-2] - position[-3])
    direction = beyond(before, last)
    if position.shape[1] == 2:
        direction = jnp.arctan2(direction[1], direction[0])
    return jnp.append(position[-1], direction)


class EnergyAccount(eqx.Module):
    """Works and impulses since the start, and the present forces, for runs that ask for them.

    Stored energies follow from a state alone (`crinoid.System.energy`).
    """

    nonconservative_forces: dict[str, Float[Array, "n b"]]
    """Forces on the nodes whose work is not stored, by the names in `crinoid.elements.WORKS` (N),
    torques about the edges (N m). The force on the base is ``reaction`` of the state."""
    work: Float[Array, " work"]
    """Work done on the arm since the start, in the order of `crinoid.elements.WORKS` (J)."""
    contact: Touch | None
    """Forces, impulses and times of the obstacles on the arm."""
    memory_energy: dict[str, Float[Array, ""]]
    """Stored energy that the memory of elements adds, by the names of their works (J)."""

    @staticmethod
    def of(forces: Forces, state: State) -> "EnergyAccount":
        """Open the account of an arm that starts from ``state``."""
        nodes = forces.num_nodes(state.motion.position)
        acting = ActingForces.of(forces, state.context)
        known = acting.arm.nonconservative_forces(state.motion, nodes)
        contact = None
        if forces.obstacles is not None:
            contact, known["contact"] = forces.obstacles.touch(state.motion, nodes, acting.pose)
        for far in acting.far_contacts:
            pushed = far.push(state.motion, acting.heading)[:nodes]
            known["contact"] = known.get("contact", 0.0) + pushed
        held = acting.arm.memory_energy(state.motion)
        return EnergyAccount(known, jnp.zeros(len(WORKS)), contact, held)

    def after(self, forces: Forces, before: State, after: State, step: Array) -> "EnergyAccount":
        """Return the account after a step of given length (s).

        Works are forces along the path, which is known, and not powers over the time: the speed of
        a servo, or of an arm that is hit, may change much within a step.
        """
        now = EnergyAccount.of(forces, after)
        path = forces.nodes(after.motion.position - before.motion.position)
        gained = dict.fromkeys(WORKS, jnp.zeros(()))
        for name, force in now.nonconservative_forces.items():
            gained[name] += jnp.sum((self.nonconservative_forces[name] + force) * path)
        for name, energy in now.memory_energy.items():
            # twice, as the sums of both ends: what memory stores its force has not dissipated
            gained[name] += 2.0 * (energy - self.memory_energy[name])
        gained["actuation"] += jnp.sum((before.reaction + after.reaction) * path[:BOUNDARY_NODES])
        contact = now.contact
        if contact is not None and self.contact is not None:
            contact = contact.since(self.contact, step)
        work = self.work + 0.5 * jnp.stack([gained[name] for name in WORKS])
        return replace(now, work=work, contact=contact)
