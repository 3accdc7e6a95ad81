"""Base of the arm at the submarine: channels, servos, prescribed motion.

May import ``rod`` and ``compilation`` and ``actuation`` and lower folders.
"""

from crinoid.base.base import Base as Base
from crinoid.base.base import BaseMotion as BaseMotion
from crinoid.base.base import Prescribed as Prescribed
from crinoid.base.base import SineMotion as SineMotion
from crinoid.base.base import TableMotion as TableMotion
from crinoid.base.base import VelocityMotion as VelocityMotion
from crinoid.base.base import WaveMotion as WaveMotion
from crinoid.base.servo import Servo as Servo
from crinoid.base.servo import ServoState as ServoState
