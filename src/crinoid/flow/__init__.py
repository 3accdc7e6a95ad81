"""Flow models: velocity and material acceleration of the water.

May import ``rod`` and ``compilation`` and ``actuation`` and lower folders.
"""

from crinoid.flow.currents import Gust as Gust
from crinoid.flow.currents import LogarithmicShear as LogarithmicShear
from crinoid.flow.currents import MeasuredPoint as MeasuredPoint
from crinoid.flow.currents import MeasuredProfile as MeasuredProfile
from crinoid.flow.currents import PowerShear as PowerShear
from crinoid.flow.currents import Sine as Sine
from crinoid.flow.currents import Uniform as Uniform
from crinoid.flow.flow import Current as Current
from crinoid.flow.flow import Flow as Flow
from crinoid.flow.flow import Jet as Jet
from crinoid.flow.flow import Water as Water
from crinoid.flow.ship_wake import ShipWake as ShipWake
from crinoid.flow.turbulence import GaussMarkov as GaussMarkov
from crinoid.flow.turbulence import Turbulence as Turbulence
from crinoid.flow.waves import Waves as Waves
from crinoid.flow.waves import on_currents as on_currents
