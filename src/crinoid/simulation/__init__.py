"""The closed loop in time: from a scenario to a result."""

from crinoid.simulation.loop import Loop as Loop
from crinoid.simulation.loop import LoopState as LoopState
from crinoid.simulation.run import Progress as Progress
from crinoid.simulation.run import SimulationError as SimulationError
from crinoid.simulation.run import Tell as Tell
from crinoid.simulation.run import at_rest as at_rest
from crinoid.simulation.run import equilibrium as equilibrium
from crinoid.simulation.run import play as play
from crinoid.simulation.run import settle as settle
from crinoid.simulation.run import simulate as simulate
from crinoid.simulation.setup import closed_loop as closed_loop
from crinoid.simulation.setup import with_parameters as with_parameters
from crinoid.simulation.unrolled import Glance as Glance
from crinoid.simulation.unrolled import Rollout as Rollout
from crinoid.simulation.unrolled import glance as glance
from crinoid.simulation.unrolled import rollout as rollout
from crinoid.simulation.vibrations import MODES as MODES
from crinoid.simulation.vibrations import find_vibrations as find_vibrations
from crinoid.simulation.vibrations import modes as modes
