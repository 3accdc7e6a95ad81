"""The assembled arm, and how it is brought to rest and moved in time."""

from crinoid.dynamics.books import Books as Books
from crinoid.dynamics.forces import Forces as Forces
from crinoid.dynamics.grasp import Grasp as Grasp
from crinoid.dynamics.grip import Grip as Grip
from crinoid.dynamics.grip import carried as carried
from crinoid.dynamics.halving import Progress as Progress
from crinoid.dynamics.influence import Influence as Influence
from crinoid.dynamics.integrator import Integrator as Integrator
from crinoid.dynamics.lines import Lines as Lines
from crinoid.dynamics.modes import Modes as Modes
from crinoid.dynamics.modes import ModesError as ModesError
from crinoid.dynamics.modes import SmallMotions as SmallMotions
from crinoid.dynamics.modes import find_modes as find_modes
from crinoid.dynamics.newton import Outcome as Outcome
from crinoid.dynamics.newton import Reason as Reason
from crinoid.dynamics.newton import Settings as Settings
from crinoid.dynamics.obstacles import Obstacles as Obstacles
from crinoid.dynamics.obstacles import Touch as Touch
from crinoid.dynamics.state import State as State
from crinoid.dynamics.system import System as System
from crinoid.dynamics.transition import Chart as Chart
from crinoid.dynamics.transition import Transition as Transition
from crinoid.dynamics.vehicle import Thrusters as Thrusters
from crinoid.dynamics.vehicle import Vehicle as Vehicle
from crinoid.dynamics.vehicle import Voyage as Voyage
