"""Parts for tables of other packages: bases, quantities with units, mistakes.

May import ``recording`` and lower folders.
"""

from crinoid.scenario.actuator import ActuatorTable as ActuatorTable
from crinoid.scenario.controller import ControllerTable as ControllerTable
from crinoid.scenario.errors import Mistake as Mistake
from crinoid.scenario.errors import got as got
from crinoid.scenario.flow_table import FlowTable as FlowTable
from crinoid.scenario.load import LoadTable as LoadTable
from crinoid.scenario.model import Model as Model
from crinoid.scenario.quantity import AsTuple as AsTuple
from crinoid.scenario.quantity import Count as Count
from crinoid.scenario.quantity import Degrees as Degrees
from crinoid.scenario.quantity import Force as Force
from crinoid.scenario.quantity import Hertz as Hertz
from crinoid.scenario.quantity import InSpace as InSpace
from crinoid.scenario.quantity import Metres as Metres
from crinoid.scenario.quantity import MetresPerSecond as MetresPerSecond
from crinoid.scenario.quantity import Newtons as Newtons
from crinoid.scenario.quantity import Only as Only
from crinoid.scenario.quantity import Position as Position
from crinoid.scenario.quantity import Quantity as Quantity
from crinoid.scenario.quantity import Seconds as Seconds
from crinoid.scenario.quantity import Vector as Vector
from crinoid.scenario.quantity import Velocity as Velocity
from crinoid.scenario.sensor import SensorTable as SensorTable
