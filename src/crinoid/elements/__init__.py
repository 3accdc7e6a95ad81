"""Elements: force laws on the arm, each on a short run of neighbouring nodes.

May import ``rod`` and ``compilation`` and ``actuation`` and lower folders.
"""

from crinoid.elements.bodies import Body as Body
from crinoid.elements.body_contact import BodyContact as BodyContact
from crinoid.elements.body_contact import Pair as Pair
from crinoid.elements.contact import Ball as Ball
from crinoid.elements.contact import Contact as Contact
from crinoid.elements.elastic import Bend as Bend
from crinoid.elements.elastic import Inertia as Inertia
from crinoid.elements.elastic import Stretch as Stretch
from crinoid.elements.element import ENERGIES as ENERGIES
from crinoid.elements.element import WORKS as WORKS
from crinoid.elements.element import Element as Element
from crinoid.elements.element import Law as Law
from crinoid.elements.element import Motion as Motion
from crinoid.elements.element import TangentDirection as TangentDirection
from crinoid.elements.hull_contact import HullContact as HullContact
from crinoid.elements.loads import DistributedLoad as DistributedLoad
from crinoid.elements.loads import TipLoad as TipLoad
from crinoid.elements.material import Material as Material
from crinoid.elements.oscillators import Oscillator as Oscillator
from crinoid.elements.oscillators import Synchronisation as Synchronisation
from crinoid.elements.oscillators import WakeOscillator as WakeOscillator
from crinoid.elements.rigid import Pose as Pose
from crinoid.elements.rigid import VehiclePose as VehiclePose
from crinoid.elements.self_contact import SelfContact as SelfContact
from crinoid.elements.soft_skin import SoftSkin as SoftSkin
from crinoid.elements.surface_contact import Bed as Bed
from crinoid.elements.surface_contact import BodySurfaceContact as BodySurfaceContact
from crinoid.elements.surface_contact import SignedDistance as SignedDistance
from crinoid.elements.surface_contact import Surface as Surface
from crinoid.elements.surface_contact import SurfaceContact as SurfaceContact
from crinoid.elements.threads import Threads as Threads
from crinoid.elements.tool import Tool as Tool
from crinoid.elements.vortices import VortexForces as VortexForces
from crinoid.elements.vortices import Vortices as Vortices
from crinoid.elements.water import AddedMass as AddedMass
from crinoid.elements.water import Drag as Drag
from crinoid.elements.water import Weight as Weight
