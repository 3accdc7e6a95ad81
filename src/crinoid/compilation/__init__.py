"""Compiled programs and their store on disk; no physics.

May import ``numerics`` and lower folders.
"""

from crinoid.compilation.message import about as about
from crinoid.compilation.program import OFTEN as OFTEN
from crinoid.compilation.program import ONCE as ONCE
from crinoid.compilation.program import SOMETIMES as SOMETIMES
from crinoid.compilation.program import Program as Program
from crinoid.compilation.program import compiled as compiled
from crinoid.compilation.program import free_memory as free_memory
from crinoid.compilation.program import make_room as make_room
from crinoid.compilation.program import require_own_process as require_own_process
