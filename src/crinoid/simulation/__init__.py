"""Closed loop in time: from a scenario to a result.

May import ``diagnostics`` and lower folders.
"""

from crinoid.simulation.differentiable_run import Glance as Glance
from crinoid.simulation.differentiable_run import Rollout as Rollout
from crinoid.simulation.differentiable_run import closed_loop as closed_loop
from crinoid.simulation.differentiable_run import glance as glance
from crinoid.simulation.differentiable_run import rollout as rollout
from crinoid.simulation.differentiable_run import with_parameters as with_parameters
from crinoid.simulation.equilibrium import equilibrium as equilibrium
from crinoid.simulation.equilibrium import settle as settle
from crinoid.simulation.lateness import Lateness as Lateness
from crinoid.simulation.loop import Loop as Loop
from crinoid.simulation.loop import LoopState as LoopState
from crinoid.simulation.run import Progress as Progress
from crinoid.simulation.run import SimulationError as SimulationError
from crinoid.simulation.run import Tell as Tell
from crinoid.simulation.run import play as play
from crinoid.simulation.run import simulate as simulate
from crinoid.simulation.session import Session as Session
