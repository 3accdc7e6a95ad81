"""The arm without load, as it is held, in the water around it."""

from jaxtyping import Array, Float

from crinoid.actuation import drives
from crinoid.dynamics import start
from crinoid.dynamics.statics import still
from crinoid.dynamics.system import System
from crinoid.elements import Motion


def at_rest(system: System, time: Float[Array, ""]) -> Motion:
    """Return the motion of an arm without load that stays, with its actuators at rest."""
    drive = drives(system.actuators, [one.at_rest() for one in system.actuators])
    rows, frames = start.undeformed(system.reference, system.base, system.forces, time)
    forces, stage, none = system.forces.driven(drive), still(time, rows, frames), 0 * rows
    return forces.motion(stage, none, forces.surroundings(stage, none))
