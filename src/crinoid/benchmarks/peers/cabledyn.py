"""The arm of a release as a cable of CableDyn."""

import tempfile
import time
from importlib.metadata import version
from pathlib import Path

import cabledyn
import numpy as np

from crinoid.benchmarks.peers import Engine, Swing, Tips
from crinoid.benchmarks.releases import IN_A_CURRENT, Release

_DECK = """--- CableDyn input file ---
an arm that is let go
--- LINE TYPES ---
Name Diam Mass EA BA EI Cdn Cdt Can Cat
(-) (m) (kg/m) (N) (N-s) (N-m^2) (-) (-) (-) (-)
arm {diameter} {mass} {EA} 0.0 {EI} {drag} 0.0 {added} 0.0
--- BODIES ---
ID Type X Y Z Roll Pitch Yaw Mass Vol C33 C44 C55 CdA Ca Ixx Iyy Izz
(-) (-) (m) (m) (m) (deg) (deg) (deg) (kg) (m3) (-) (-) (-) (m2) (-) (kgm2) (kgm2) (kgm2)
1 Rigid6 {reach} 0 {z} 0 0 0 {load} {volume} 0 0 0 0 0 1e-3 1e-3 1e-3
--- POINTS ---
ID Type X Y Z Mass Vol CdA Ca
(-) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Body1 0 0 0 0 0 0 0
2 Fixed 0 0 {z} 0 0 0 0
--- LINES ---
ID NodeA NodeB Outputs
(-) (-) (-) (-)
1 1 2 -
--- SECTIONS ---
LineID Type Length NumSegs
(-) (-) (m) (-)
1 arm {length} {edges}
--- END CONNECTIONS ---
LineID End Stiffness EzX EzY EzZ
(-) (-) (-) (-) (-) (-)
1 B Rigid -1 0 0
--- OPTIONS ---
{gravity} g
{density} rhoW
100 WtrDpth
{time_step} dtM
{duration} TMax
uniform {current} 0 0 current
moordyn bodyWetting
deck bodyIC
--- OUTPUTS ---
"Body1Px"
"Body1Pz"
--- need this line ---
"""


def _prepare(release: Release, nodes: int, time_step: float) -> Swing:
    """Return a run by the driver without start and statics, which a run of one step measures."""
    driver = cabledyn.CableDynDriver()
    numbers = release.numbers(nodes, time_step)
    # its statics refuse a line without weight that is not taut
    numbers["reach"] = numbers["length"] * (1 + 1e-6)

    def run(folder: Path, duration: float) -> tuple[Tips, float]:
        deck = folder / "arm.dat"
        deck.write_text(_DECK.format(**{**numbers, "duration": duration}), "ascii")
        start = time.perf_counter()
        try:
            written = driver.run(deck, folder / "arm", overwrite=True)
        except cabledyn.DriverExecutionError:
            return np.full((release.samples, 2), np.nan), time.perf_counter() - start
        spent = time.perf_counter() - start
        tips = written.read_main().values[:: release.steps(time_step), 1:]
        return tips[1:] - [0.0, numbers["z"]], spent

    def swing() -> tuple[Tips, float]:
        with tempfile.TemporaryDirectory() as name:
            _, start = run(Path(name), time_step)
            tips, whole = run(Path(name), release.duration)
        return tips, whole - start

    return swing


ENGINE = Engine(
    f"CableDyn {version('cabledyn')}",
    (IN_A_CURRENT.name,),
    "curvature at rest and a free end: a body of some mass is at the tip",
    order=1,  # as measured
    meshes=(6, 11, 21, 41),
    steps=(0.01, 0.0005),
    prepare=_prepare,
)
