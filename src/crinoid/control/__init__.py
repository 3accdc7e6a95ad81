"""Controllers, observers, targets and sensors of the closed loop.

May import ``dynamics`` and lower folders.
"""

from crinoid.control.braking import Braking as Braking
from crinoid.control.controller import Controller as Controller
from crinoid.control.controller import ControllerInput as ControllerInput
from crinoid.control.controller import FeedForward as FeedForward
from crinoid.control.controller import Idle as Idle
from crinoid.control.controller import Playback as Playback
from crinoid.control.controller import Reading as Reading
from crinoid.control.forecast import Along as Along
from crinoid.control.forecast import Forecast as Forecast
from crinoid.control.forecast import FrozenTurbulenceForecast as FrozenTurbulenceForecast
from crinoid.control.forecast import KnownWater as KnownWater
from crinoid.control.hybrid import Balance as Balance
from crinoid.control.hybrid import Filter as Filter
from crinoid.control.hybrid import Hybrid as Hybrid
from crinoid.control.hybrid import Pendulum as Pendulum
from crinoid.control.lqg import Lqg as Lqg
from crinoid.control.lqg import Observer as Observer
from crinoid.control.mpc import Mpc as Mpc
from crinoid.control.mpc import RigidRotationCorrection as RigidRotationCorrection
from crinoid.control.mpc import ScheduledMpc as ScheduledMpc
from crinoid.control.mpc import commands_at as commands_at
from crinoid.control.neural import Neural as Neural
from crinoid.control.neural import Observation as Observation
from crinoid.control.pid import Allocation as Allocation
from crinoid.control.pid import Pid as Pid
from crinoid.control.pid import damped_inverse as damped_inverse
from crinoid.control.qp import HorizonQp as HorizonQp
from crinoid.control.sensor import BaseWrench as BaseWrench
from crinoid.control.sensor import Clock as Clock
from crinoid.control.sensor import ContactForce as ContactForce
from crinoid.control.sensor import Inclination as Inclination
from crinoid.control.sensor import Measurand as Measurand
from crinoid.control.sensor import Sensor as Sensor
from crinoid.control.sensor import SensorState as SensorState
from crinoid.control.sensor import Shape as Shape
from crinoid.control.sensor import TipPose as TipPose
from crinoid.control.sensor import WaterVelocity as WaterVelocity
from crinoid.control.target import Line as Line
from crinoid.control.target import Orbit as Orbit
from crinoid.control.target import SubmarineFrame as SubmarineFrame
from crinoid.control.target import Target as Target
from crinoid.control.target import pose_error as pose_error
