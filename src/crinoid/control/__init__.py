"""Parts that close the loop: sensor, target and controllers."""

from crinoid.control.clock import Clock as Clock
from crinoid.control.controller import Controller as Controller
from crinoid.control.controller import Idle as Idle
from crinoid.control.feed_forward import FeedForward as FeedForward
from crinoid.control.least_squares import damped_inverse as damped_inverse
from crinoid.control.path import Line as Line
from crinoid.control.path import Orbit as Orbit
from crinoid.control.pid import Pid as Pid
from crinoid.control.sensor import Sensor as Sensor
from crinoid.control.target import Carrier as Carrier
from crinoid.control.target import Target as Target
