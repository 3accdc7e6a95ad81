"""Dynamics of the assembled arm: state, forces, time integration, statics, modes.

May import ``elements`` and ``flow`` and ``base`` and lower folders.
"""

from crinoid.dynamics.acting import ActingForces as ActingForces
from crinoid.dynamics.context import Context as Context
from crinoid.dynamics.damped_modes import DampedModes as DampedModes
from crinoid.dynamics.damped_modes import Relaxing as Relaxing
from crinoid.dynamics.damped_modes import find_damped_modes as find_damped_modes
from crinoid.dynamics.damped_modes import find_relaxing_modes as find_relaxing_modes
from crinoid.dynamics.far_contact import FarContact as FarContact
from crinoid.dynamics.forces import Forces as Forces
from crinoid.dynamics.free_bodies import FreeBodies as FreeBodies
from crinoid.dynamics.gripper import GripState as GripState
from crinoid.dynamics.gripper import GripTriggers as GripTriggers
from crinoid.dynamics.hull import Hull as Hull
from crinoid.dynamics.hull import HullTouch as HullTouch
from crinoid.dynamics.hull import first_far_edge as first_far_edge
from crinoid.dynamics.integrator import Integrator as Integrator
from crinoid.dynamics.lines import LengthControlledThreads as LengthControlledThreads
from crinoid.dynamics.modes import Modes as Modes
from crinoid.dynamics.modes import ModesError as ModesError
from crinoid.dynamics.modes import find_modes as find_modes
from crinoid.dynamics.newton import SOLVED as SOLVED
from crinoid.dynamics.newton import Settings as Settings
from crinoid.dynamics.obstacles import Obstacles as Obstacles
from crinoid.dynamics.obstacles import Touch as Touch
from crinoid.dynamics.outcome import Outcome as Outcome
from crinoid.dynamics.outcome import Reason as Reason
from crinoid.dynamics.outcome import StepStatistics as StepStatistics
from crinoid.dynamics.outcome import round_off_note as round_off_note
from crinoid.dynamics.self_contact import FarEdges as FarEdges
from crinoid.dynamics.self_contact import SelfTouch as SelfTouch
from crinoid.dynamics.self_contact import far_edges as far_edges
from crinoid.dynamics.small_motions import Influence as Influence
from crinoid.dynamics.small_motions import SmallMotions as SmallMotions
from crinoid.dynamics.state import EnergyAccount as EnergyAccount
from crinoid.dynamics.state import State as State
from crinoid.dynamics.system import System as System
from crinoid.dynamics.transition import LocalCoordinates as LocalCoordinates
from crinoid.dynamics.transition import Transition as Transition
from crinoid.dynamics.transition import numbers_of as numbers_of
from crinoid.dynamics.vehicle import Thrusters as Thrusters
from crinoid.dynamics.vehicle import Vehicle as Vehicle
from crinoid.dynamics.vehicle import VehicleOutput as VehicleOutput
