"""How fast a live session is: simulated time over that of the clock, frame by frame, no page.

python benchmarks/live.py [SCENARIO ...]
"""

import sys
import time

import crinoid
from crinoid.live.session import Session
from crinoid.programs import keep_programs

FRAMES = 300
"""Frames of a thirtieth of a second that are measured."""


def factor(name: str) -> float:
    """Return the real-time factor of a scenario, in frames as the page shows them."""
    session = Session(crinoid.load(name))
    steps = max(1, round(1 / 30 / session.scenario.simulation.time_step))
    session.advance(steps)
    begun, at = time.perf_counter(), session.time
    for _ in range(FRAMES):
        session.advance(steps)
        session.look()
    return (session.time - at) / (time.perf_counter() - begun)


if __name__ == "__main__":
    keep_programs()
    for each in sys.argv[1:] or ["station-keeping", "station-keeping-3d"]:
        print(f"{each}: {factor(each):.1f} x real time")
