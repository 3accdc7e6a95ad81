"""An arm in a current as a line of MoorDyn."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import moordyn
import numpy as np

from crinoid.scenario import Scenario
from validation.peers.swing import Swing, Tips, clocked, line_numbers

_DECK = """--- MoorDyn input file ---
an arm that is let go
--- LINE TYPES ---
Name Diam Mass EA BA EI Cd Ca CdAx CaAx Cl dF cF
(-) (m) (kg/m) (N) (N-s) (N-m^2) (-) (-) (-) (-) (-) (-) (-)
arm {diameter} {mass} {EA} {damping} {EI} {drag} {added} 0 0 {lift} {range} {centre}
--- ROD TYPES ---
Name Diam Mass Cd Ca CdEnd CaEnd
(-) (m) (kg/m) (-) (-) (-) (-)
clamp {diameter} 1 0 0 0 0
--- RODS ---
ID Type Attachment Xa Ya Za Xb Yb Zb NumSegs Outputs
(-) (-) (-) (m) (m) (m) (m) (m) (m) (-) (-)
1 clamp Fixed {back_x} 0 {back_z} 0 0 {z} 1 -
--- POINTS ---
ID Type X Y Z Mass Volume CdA Ca
(-) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Free {tip_x} 0 {tip_z} {load} {volume} 0 0
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


def prepare(
    scenario: Scenario, time_step: float, interval: float, samples: int, **numbers: float
) -> Swing:
    """Return a run; ``numbers`` replace those of the input file, such as ``damping``.

    ``damping`` is that of stretching (N s), below 0 its damping ratio times -1; 0 by default.
    """
    numbers = {"damping": 0.0, **line_numbers(scenario, time_step), **numbers}
    x, z, root, length = (numbers[key] for key in ("along_x", "along_z", "z", "length"))
    numbers |= {"back_x": -x, "back_z": root - z, "tip_x": x * length, "tip_z": root + z * length}
    columns = [0, 2] if scenario.arm.dimension == 2 else [0, 1, 2]

    def tips(system: object) -> Tips:
        found = np.full((samples, len(columns)), np.nan)
        point, origin = moordyn.GetPoint(system, 1), np.array([0.0, 0.0, root])
        for number, tip in enumerate(found):
            try:
                moordyn.Step(system, [], [], number * interval, interval)
            except RuntimeError:  # a step that is no number
                break
            tip[:] = (np.array(moordyn.GetPointPos(point)) - origin)[columns]
        return found

    def swing() -> tuple[Tips, float]:
        with tempfile.TemporaryDirectory() as folder, _silent():
            deck = Path(folder) / "arm.txt"
            deck.write_text(_DECK.format(**numbers), "ascii")
            deck.with_name("current_profile.txt").write_text(_CURRENT.format(numbers["current"]))
            system = moordyn.Create(str(deck))
            try:
                moordyn.SetVerbosity(system, moordyn.LEVEL_NONE)
                moordyn.Init_NoIC(system, [], [])
                return clocked(lambda: tips(system))()
            finally:
                moordyn.Close(system)

    return swing


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Discard what a library in C++ prints."""
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
