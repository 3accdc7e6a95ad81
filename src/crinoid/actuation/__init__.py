"""Inputs that a controller commands, and the interface of the actuators that follow them."""

from crinoid.actuation.actuator import Actuator as Actuator
from crinoid.actuation.actuator import drives as drives
from crinoid.actuation.actuator import followed as followed
from crinoid.actuation.follower import Follower as Follower
from crinoid.actuation.follower import FollowerState as FollowerState
from crinoid.actuation.input import Input as Input
from crinoid.actuation.input import InputKind as InputKind
from crinoid.actuation.small import for_small_commands as for_small_commands
