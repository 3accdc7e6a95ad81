"""A clamped line that hangs in a current, by MoorDyn."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import moordyn
import numpy as np
from jaxtyping import Float

_DECK = """--- MoorDyn input file ---
a clamped line that hangs
--- LINE TYPES ---
Name Diam Mass EA BA EI Cd Ca CdAx CaAx Cl dF cF
(-) (m) (kg/m) (N) (N-s) (N-m^2) (-) (-) (-) (-) (-) (-) (-)
arm {diameter} {mass} {EA} -0.5 {EI} {drag} 1 0 0 {lift} {range} {centre}
--- ROD TYPES ---
Name Diam Mass Cd Ca CdEnd CaEnd
(-) (m) (kg/m) (-) (-) (-) (-)
clamp {diameter} 1 0 0 0 0
--- RODS ---
ID Type Attachment Xa Ya Za Xb Yb Zb NumSegs Outputs
(-) (-) (-) (m) (m) (m) (m) (m) (m) (-) (-)
1 clamp Fixed 0 0 -9 0 0 -10 1 -
--- POINTS ---
ID Type X Y Z Mass Volume CdA Ca
(-) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Free 0 0 {tip} 0 0 0 0
--- LINES ---
ID Type AttachA AttachB Length NumSegs Outputs
(-) (-) (-) (-) (m) (-) (-)
1 arm R1B 1 {length} {edges} -
--- OPTIONS ---
0 writeLog
{time_step} dtM
RK4 tScheme
{gravity} g
{density} WtrDnsty
100 WtrDpth
0 TmaxIC
1 Currents
--- need this line ---
"""
_CURRENT = "--- current ---\nz ux uy uz\n(m) (m/s) (m/s) (m/s)\n-100 {0} 0 0\n0 {0} 0 0\n"


class HangingLine(NamedTuple):
    """A line that is clamped at its upper end; SI units."""

    length: float
    edges: int
    diameter: float
    mass: float
    """Per length."""
    EA: float
    EI: float
    drag: float
    density: float
    """Of the water."""
    gravity: float
    lift: float = 0.0
    """Lift coefficient of vortices; 0: none."""
    range: float = 0.08
    centre: float = 0.18


def moordyn_tips(
    line: HangingLine, speed: float, *, time_step: float, interval: float, duration: float
) -> Float[np.ndarray, "t axis=3"]:
    """Return the tip below the clamp (m) at each interval, from the straight line on.

    Parameters
    ----------
    line
        With added mass of 1 across it.
    speed
        Of a steady current along x (m/s).
    time_step, interval, duration
        In s; the step is that of RK4.

    Raises
    ------
    RuntimeError
        If MoorDyn stops, as at a step that is not finite.
    """
    numbers = {**line._asdict(), "time_step": time_step, "tip": -10.0 - line.length}
    tips = np.empty((round(duration / interval), 3))
    with tempfile.TemporaryDirectory() as folder, _silent():
        deck = Path(folder) / "arm.txt"
        deck.write_text(_DECK.format(**numbers), "ascii")
        deck.with_name("current_profile.txt").write_text(_CURRENT.format(speed), "ascii")
        system = moordyn.Create(str(deck))
        try:
            moordyn.SetVerbosity(system, moordyn.LEVEL_NONE)
            moordyn.Init_NoIC(system, [], [])
            point = moordyn.GetPoint(system, 1)
            for number, tip in enumerate(tips):
                moordyn.Step(system, [], [], number * interval, interval)
                tip[:] = moordyn.GetPointPos(point)
        finally:
            moordyn.Close(system)
    tips[:, 2] += 10.0
    return tips


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Discard what the library in C++ prints."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
