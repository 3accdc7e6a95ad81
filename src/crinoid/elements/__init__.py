"""Force laws that act on the arm, each on a short run of neighbouring nodes."""

from crinoid.elements.body import Body as Body
from crinoid.elements.contact import Contact as Contact
from crinoid.elements.elastic import Bend as Bend
from crinoid.elements.elastic import Stretch as Stretch
from crinoid.elements.element import ENERGIES as ENERGIES
from crinoid.elements.element import WORKS as WORKS
from crinoid.elements.element import Course as Course
from crinoid.elements.element import Element as Element
from crinoid.elements.element import Linearised as Linearised
from crinoid.elements.element import Motion as Motion
from crinoid.elements.inertia import Inertia as Inertia
from crinoid.elements.loads import DistributedLoad as DistributedLoad
from crinoid.elements.loads import TipLoad as TipLoad
from crinoid.elements.spatial import BendTwist as BendTwist
from crinoid.elements.threads import PlanarThreads as PlanarThreads
from crinoid.elements.threads import Threads as Threads
from crinoid.elements.tool import Tool as Tool
from crinoid.elements.water import AddedMass as AddedMass
from crinoid.elements.water import Drag as Drag
from crinoid.elements.water import Weight as Weight
