"""Compiled programs, and where they are kept between runs; knows no physics."""

from crinoid.programs.program import OFTEN as OFTEN
from crinoid.programs.program import ONCE as ONCE
from crinoid.programs.program import Program as Program
from crinoid.programs.program import compiled as compiled
from crinoid.programs.room import make_room as make_room
from crinoid.programs.store import Store as Store
from crinoid.programs.store import keep_programs as keep_programs
