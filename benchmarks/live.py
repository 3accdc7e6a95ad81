"""How soon a live session is ready, and how fast: simulated time over that of the clock, no page.

python benchmarks/live.py [SCENARIO ...]

With JAX_COMPILATION_CACHE_DIR set to an empty folder nothing was compiled before.
"""

import sys
import time

import crinoid
from crinoid.compilation import keep_programs
from crinoid.view.live.session import Session

FRAMES = 300
"""Frames of a thirtieth of a second that are measured."""


def measure(name: str) -> tuple[float, float]:
    """Return when a session is ready (s), and its real-time factor, in frames as the page shows."""
    begun = time.perf_counter()
    session = Session(crinoid.load(name))
    steps = max(1, round(1 / 30 / session.scenario.simulation.time_step))
    session.advance(steps)
    ready = time.perf_counter() - begun
    begun, at = time.perf_counter(), session.time
    for _ in range(FRAMES):
        session.advance(steps)
        session.look()
    return ready, (session.time - at) / (time.perf_counter() - begun)


if __name__ == "__main__":
    keep_programs()
    for each in sys.argv[1:] or ["station-keeping", "station-keeping-3d"]:
        ready, factor = measure(each)
        print(f"{each}: ready after {ready:.1f} s, {factor:.1f} x real time")
