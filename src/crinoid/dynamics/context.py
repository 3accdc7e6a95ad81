"""Context of the forces: drives, memory, grip and attitudes of a time step."""

from dataclasses import replace
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from crinoid.base import Prescribed
from crinoid.dynamics.gripper import GripState
from crinoid.elements import Pose, VehiclePose

Memory = tuple[Any, ...]
"""Memory of each element; None for those without."""


class Context(eqx.Module):
    """Context of the forces, the same throughout a time step or a search of an equilibrium."""

    drive: Float[Array, " drive"] | None = None
    """Drives of the actuators, if there are any."""
    memory: Memory = ()
    """Memory of the elements at the start of the step; empty where all have relaxed."""
    step: Float[Array, ""] | None = None
    """Length of the step (s); required with a memory."""
    grip: GripState | None = None
    """Grip of a tool, if touches change it."""
    pose: Pose | None = None
    """Attitude of the obstacles at the start of the step; None for that of a run."""
    heading: VehiclePose | None = None
    """Attitude of a floating vehicle at the start of the step; None for that of a run."""
    clamp: Prescribed | None = None
    """Motion of ghost node and root from the centre of mass of a floating vehicle, in its axes;
    None while it is held still."""
    frozen_at: Float[Array, ""] | None = None
    """Time at which the flow is frozen (s), and obstacles and vehicle are held still."""

    def at_rest(self, time: Float[Array, ""]) -> "Context":
        """Return the context of an equilibrium in the flow at a time (s), all laws relaxed."""
        return replace(self, frozen_at=time, clamp=None, memory=(), step=None)

    def remembering(self, memory: Memory, step: Float[Array, ""]) -> "Context":
        """Return the context of a step of given length (s) from a memory."""
        return replace(self, memory=memory, step=step)
