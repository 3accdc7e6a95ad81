"""An arm in a current as a cable of CableDyn, with a body at its tip."""

import tempfile
import time
from pathlib import Path

import cabledyn
import numpy as np

from crinoid.scenario import Scenario
from validation.peers.swing import Swing, Tips, line_numbers

_DECK = """--- CableDyn input file ---
an arm that is let go
--- LINE TYPES ---
Name Diam Mass EA BA EI Cdn Cdt Can Cat
(-) (m) (kg/m) (N) (N-s) (N-m^2) (-) (-) (-) (-)
arm {diameter} {mass} {EA} 0.0 {EI} {drag} 0.0 {added} 0.0
--- BODIES ---
ID Type X Y Z Roll Pitch Yaw Mass Vol C33 C44 C55 CdA Ca Ixx Iyy Izz
(-) (-) (m) (m) (m) (deg) (deg) (deg) (kg) (m3) (-) (-) (-) (m2) (-) (kgm2) (kgm2) (kgm2)
1 Rigid6 {tip_x} 0 {tip_z} 0 0 0 {load} {volume} 0 0 0 0 0 1e-3 1e-3 1e-3
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
1 B Rigid {to_x} 0 {to_z}
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
_LOAD, _ASIDE = 0.2, 0.02
"""Body at a tip without tool, as heavy as water (kg); x of the tip of an upright cable (m)."""


def prepare(scenario: Scenario, time_step: float, interval: float, samples: int) -> Swing:
    """Return a run by the driver without start and statics, which a run of one step measures."""
    driver = cabledyn.CableDynDriver()
    numbers = line_numbers(scenario, time_step)
    x, z = numbers["along_x"], numbers["along_z"]
    # its statics accept no upright cable, and none that is slack by more than a little
    reach = numbers["length"] * (1 + 1e-6)
    tip = (_ASIDE, z * np.sqrt(reach**2 - _ASIDE**2)) if x == 0 else (x * reach, z * reach)
    numbers |= {"tip_x": tip[0], "tip_z": tip[1] + numbers["z"], "to_x": -x, "to_z": -z}
    if scenario.tool is None:
        numbers |= {"load": _LOAD, "volume": _LOAD / numbers["density"]}

    def run(folder: Path, duration: float) -> tuple[Tips, float]:
        deck = folder / "arm.dat"
        deck.write_text(_DECK.format(**numbers, duration=duration), "ascii")
        start = time.perf_counter()
        try:
            written = driver.run(deck, folder / "arm", overwrite=True)
        except cabledyn.DriverExecutionError:
            return np.full((samples, 2), np.nan), time.perf_counter() - start
        spent = time.perf_counter() - start
        tips = written.read_main().values[:: round(interval / time_step), 1:]
        return tips[1:] - [0.0, numbers["z"]], spent

    def swing() -> tuple[Tips, float]:
        with tempfile.TemporaryDirectory() as name:
            _, start = run(Path(name), time_step)
            tips, whole = run(Path(name), samples * interval)
        return tips, whole - start

    return swing
