"""A cantilever that vibrates across a current, locked in to its vortices."""

from matplotlib.axes import Axes

from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.lock_in import (
    DIAMETER,
    DURATION,
    JUDGED,
    NODES,
    STEP,
    integrated,
    scenario,
    simulated,
)
from crinoid.view.figures.style import BLUE, INK, key

_SHARES = (0.22, 0.14)
"""Natural frequency, 1 Hz, times D/U."""


def _run() -> Evidence:
    checks, scenarios, pairs = [], {}, []
    for share in _SHARES:
        speed = DIAMETER / share
        scenarios[f"{share:g}"] = scenario(speed)
        exact, found = integrated(speed), simulated(scenarios[f"{share:g}"])
        pairs.append((speed, exact, found))
        text = f"{speed:.4f} m/s"
        checks += [
            Check(f"A/D, {text}", exact.amplitude, found.amplitude, 0.05, relative=True),
            Check(f"frequency, {text}", exact.frequency, found.frequency, 0.01, "Hz", True),
            Check(f"mean drift, {text}", exact.drift, found.drift, 0.05, "m", True),
        ]

    def draw(axes: Axes) -> None:
        speed, exact, found = pairs[0]
        for motion, colour, line, label in (
            (found, BLUE, "-", "crinoid"),
            (exact, INK, "--", "three modes"),
        ):
            y = motion.across / DIAMETER
            axes.plot(motion.time - motion.rises[0], y, line, color=colour, label=label)
        axes.set(xlabel=f"time (s), at {speed:.3f} m/s", ylabel="tip across the current, y/D")
        axes.set_xlim(0.0, 6.0)
        key(axes)

    return Evidence(checks, None, scenarios, draw)


CASE = Case(
    name="vortex-lock-in",
    title="A neutral cantilever in a current locks in to its vortices, by synchronisation.",
    source="Thorsen, Saevik and Larsen 2014, J. Fluids Struct. 51, eq. 12 and 13: the phase of the "
    "lift. The case integrates three modes of a linear beam by DOP853 to 1e-9.",
    method=f"{NODES} nodes in space, time step {STEP:g} s, 25 diameters long, at natural "
    f"frequencies of {' and '.join(f'{share:g}' for share in _SHARES)} U/D; the last {JUDGED:g} s "
    f"of {DURATION:g} s.",
    reason="The random phases at the start change the amplitude by up to 1 %. The beam is linear, "
    "the arm with slopes of up to 0.07 is not: 0.5 %. Mesh and step add about 1 % each.",
    kind="exact",
    run=_run,
)
