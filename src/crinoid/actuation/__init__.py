"""Inputs of a controller, and the interface of actuators.

May import ``numerics`` and lower folders.
"""

from crinoid.actuation.actuator import Actuator as Actuator
from crinoid.actuation.actuator import Follower as Follower
from crinoid.actuation.actuator import FollowerState as FollowerState
from crinoid.actuation.actuator import Input as Input
from crinoid.actuation.actuator import InputKind as InputKind
from crinoid.actuation.actuator import drives as drives
from crinoid.actuation.actuator import followed as followed
from crinoid.actuation.actuator import for_small_commands as for_small_commands
