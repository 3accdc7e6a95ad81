"""Parts that close the loop: sensor, target and controllers."""

from crinoid.control.allocation import Allocation as Allocation
from crinoid.control.clock import Clock as Clock
from crinoid.control.controller import Controller as Controller
from crinoid.control.controller import Idle as Idle
from crinoid.control.feed_forward import FeedForward as FeedForward
from crinoid.control.least_squares import damped_inverse as damped_inverse
from crinoid.control.lqg import Lqg as Lqg
from crinoid.control.measurand import BaseWrench as BaseWrench
from crinoid.control.measurand import ContactForce as ContactForce
from crinoid.control.measurand import Inclination as Inclination
from crinoid.control.measurand import Measurand as Measurand
from crinoid.control.measurand import Shape as Shape
from crinoid.control.measurand import TipPose as TipPose
from crinoid.control.measurand import WaterVelocity as WaterVelocity
from crinoid.control.observer import Observer as Observer
from crinoid.control.path import Line as Line
from crinoid.control.path import Orbit as Orbit
from crinoid.control.pid import Pid as Pid
from crinoid.control.seen import Reading as Reading
from crinoid.control.seen import Seen as Seen
from crinoid.control.sensor import Sensor as Sensor
from crinoid.control.sensor import SensorState as SensorState
from crinoid.control.target import Carrier as Carrier
from crinoid.control.target import Target as Target
from crinoid.control.target import pose_error as pose_error
