"""The submarine's end of the arm: channels, their servos, and prescribed motion."""

from crinoid.base.base import Base as Base
from crinoid.base.base import Prescribed as Prescribed
from crinoid.base.motion import BaseMotion as BaseMotion
from crinoid.base.motion import SineMotion as SineMotion
from crinoid.base.motion import TableMotion as TableMotion
from crinoid.base.motion import VelocityMotion as VelocityMotion
from crinoid.base.servo import Servo as Servo
from crinoid.base.servo import ServoState as ServoState
