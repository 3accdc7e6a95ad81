"""The record of a run: the quantities saved at each instant."""

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from crinoid.control import Estimate
from crinoid.dynamics import HullTouch, SelfTouch, Touch, VehicleOutput
from crinoid.elements import VortexForces


class Record(eqx.Module):
    """One saved instant. SI units; positions are relative to the base's set position."""

    time: Float[Array, "*t"]
    position: Float[Array, "*t n d"]
    velocity: Float[Array, "*t n d"]
    acceleration: Float[Array, "*t n d"]
    flow_velocity: Float[Array, "*t n d"]
    curvature: Float[Array, "*t n"] | Float[Array, "*t n 2"]
    """At the nodes (1/m); in space kappa_1 and kappa_2."""
    moment: Float[Array, "*t n turns"]
    """Moment of the arm beyond each node on the arm before it (N m)."""
    tip: Float[Array, "*t pose"]
    reference: Float[Array, "*t pose"]
    command: Float[Array, "*t channel"]
    servo: Float[Array, "*t channel"]
    """Position of the servos; the pose adds the prescribed motions."""
    pose: Float[Array, "*t channel"]
    drive_command: Float[Array, "*t input"] | None
    """Commands of the actuators, without the base's servos."""
    drive: Float[Array, "*t input"] | None
    """Drives with which they act on the arm."""
    reading: Float[Array, "*t reading"]
    """Newest known readings of all sensors, one behind the other."""
    base_force: Float[Array, "*t d"]
    base_moment: Float[Array, "*t"] | Float[Array, "*t 3"]
    energy: Float[Array, "*t kind"]
    steps: Int[Array, "*t"]
    """Time steps since the instant before, halved ones counted each."""
    iterations: Int[Array, "*t"]
    """Newton iterations since the instant before."""
    residual: Float[Array, "*t"]
    """Largest imbalance that a step since the instant before ended with (N)."""
    error: Float[Array, "*t"]
    """Largest estimated local error of a step since the instant before (m)."""
    obstacle_position: Float[Array, "*t m d"] | None
    obstacle_velocity: Float[Array, "*t m d"] | None
    obstacle_spin: Float[Array, "*t m turns"] | None
    obstacle_axis: Float[Array, "*t m d"] | None
    """Direction of a line fixed to each obstacle, of a capsule its axis."""
    gap: Float[Array, "*t m w"] | None
    """Distance of each obstacle from the surface of each edge (m)."""
    touch: Touch | None
    director: Float[Array, "*t e 3"] | None
    """In space: the material director m_1 of the edges."""
    twist: Float[Array, "*t n"] | None
    """In space: twist at the nodes (rad/m)."""
    branch_tension: Float[Array, "*t e"] | None = None
    """Axial force of the Maxwell branches of a material that relaxes (N)."""
    line: Float[Array, "*t line"] | None = None
    """Tensions (N) and pressures (Pa) of lines (``crinoid.dynamics.lines``)."""
    vortices: VortexForces | None = None
    """Forces of shed vortices per length, and their phase."""
    self_touch: SelfTouch | None = None
    """Contact of the arm with itself."""
    hull_touch: HullTouch | None = None
    """Contact of the arm with the hull."""
    vehicle: VehicleOutput | None = None
    """Pose and thrusters of a submarine that floats."""
    estimate: Estimate | None = None
    """Estimate of an observer at the newest command, in the world; nan before the first one."""
    estimate_time: Float[Array, "*t"] | None = None
    """Time of that command (s)."""
    held: Float[Array, "*t"] | None = None
    """1 where the tip has its tool, 0 where not."""

    def first(self, count: int) -> "Record":
        """Return the first instants, in the host's memory and without the place of others."""
        return jax.tree.map(lambda x: np.asarray(x)[:count].copy(), self)
