"""The arm of a release as a line of MoorDyn."""

import contextlib
import os
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

import moordyn
import numpy as np

from crinoid.benchmarks.peers import Engine, Swing, Tips, clocked
from crinoid.benchmarks.releases import IN_A_CURRENT, Release

_DECK = """--- MoorDyn input file ---
an arm that is let go
--- LINE TYPES ---
Name Diam Mass EA BA EI Cd Ca CdAx CaAx
(-) (m) (kg/m) (N) (N-s) (N-m^2) (-) (-) (-) (-)
arm {diameter} {mass} {EA} 0 {EI} {drag} {added} 0 0
--- ROD TYPES ---
Name Diam Mass Cd Ca CdEnd CaEnd
(-) (m) (kg/m) (-) (-) (-) (-)
clamp {diameter} 1 0 0 0 0
--- RODS ---
ID Type Attachment Xa Ya Za Xb Yb Zb NumSegs Outputs
(-) (-) (-) (m) (m) (m) (m) (m) (m) (-) (-)
1 clamp Fixed -1 0 {z} 0 0 {z} 1 -
--- POINTS ---
ID Type X Y Z Mass Volume CdA Ca
(-) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Free {length} 0 {z} {load} {volume} 0 0
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


def _prepare(release: Release, nodes: int, time_step: float) -> Swing:
    numbers = release.numbers(nodes, time_step)

    def swing() -> tuple[Tips, float]:
        with tempfile.TemporaryDirectory() as folder, _silent():
            deck = Path(folder) / "arm.txt"
            deck.write_text(_DECK.format(**numbers), "ascii")
            deck.with_name("current_profile.txt").write_text(_CURRENT.format(numbers["current"]))
            system = moordyn.Create(str(deck))
            try:
                moordyn.SetVerbosity(system, moordyn.LEVEL_NONE)
                moordyn.Init_NoIC(system, [], [])
                return clocked(lambda: _tips(system, release, numbers["z"]))()
            finally:
                moordyn.Close(system)

    return swing


def _tips(system: object, release: Release, z: float) -> Tips:
    tips = np.full((release.samples, 2), np.nan)
    point = moordyn.GetPoint(system, 1)
    for number, tip in enumerate(tips):
        try:
            moordyn.Step(system, [], [], number * release.interval, release.interval)
        except RuntimeError:  # a step that is no number
            break
        tip[:] = np.array(moordyn.GetPointPos(point))[[0, 2]] - [0.0, z]
    return tips


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Discard what a library in C prints."""
    kept = os.dup(1)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


ENGINE = Engine(
    f"MoorDyn {version('moordyn')}",
    (IN_A_CURRENT.name,),
    "compression, twist, curvature at rest and damping in bending",
    order=4,
    meshes=(11, 21, 41, 81),
    steps=(0.002, 0.00005),
    prepare=_prepare,
)
