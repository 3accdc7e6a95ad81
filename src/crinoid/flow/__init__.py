"""How the water moves: its velocity and material acceleration anywhere, at any time."""

from crinoid.flow.current import Current as Current
from crinoid.flow.flow import Flow as Flow
from crinoid.flow.flow import Water as Water
from crinoid.flow.gauss_markov import GaussMarkov as GaussMarkov
from crinoid.flow.gust import Gust as Gust
from crinoid.flow.jet import Jet as Jet
from crinoid.flow.measured import MeasuredPoint as MeasuredPoint
from crinoid.flow.measured import MeasuredProfile as MeasuredProfile
from crinoid.flow.shear import LogarithmicShear as LogarithmicShear
from crinoid.flow.shear import PowerShear as PowerShear
from crinoid.flow.sine import Sine as Sine
from crinoid.flow.turbulence import Turbulence as Turbulence
from crinoid.flow.uniform import Uniform as Uniform
from crinoid.flow.waves import Waves as Waves
