"""An arm that hangs in a steady current, and CableDyn's cable."""

import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from crinoid.scenario import Scenario
from crinoid.simulation import equilibrium
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.hanging_in_current import SPEEDS, scenario
from crinoid.validation.slender import MESHES, tip_of
from crinoid.view.figures.style import BLUE, VERMILLION, key

_EDGES, _TIME_STEP, _DURATION = 20, 1e-3, 16.0
_DECK = """--- CableDyn input file ---
an arm that hangs
--- LINE TYPES ---
Name Diam Mass EA BA EI Cdn Cdt Can Cat
(-) (m) (kg/m) (N) (N-s) (N-m^2) (-) (-) (-) (-)
arm {diameter} {mass} {EA} 0.0 {EI} {drag} 0.0 {added} 0.0
--- BODIES ---
ID Type X Y Z Roll Pitch Yaw Mass Vol C33 C44 C55 CdA Ca Ixx Iyy Izz
(-) (-) (m) (m) (m) (deg) (deg) (deg) (kg) (m3) (-) (-) (-) (m2) (-) (kgm2) (kgm2) (kgm2)
1 Rigid6 {x} 0 {z} 0 0 0 0.2 {volume} 0 0 0 0 0 1e-3 1e-3 1e-3
--- POINTS ---
ID Type X Y Z Mass Vol CdA Ca
(-) (-) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Body1 0 0 0 0 0 0 0
2 Fixed 0 0 -10 0 0 0 0
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
1 B Rigid 0 0 1
--- OPTIONS ---
{gravity} g
{density} rhoW
100 WtrDpth
{time_step} dtM
{duration} TMax
uniform {speed} 0 0 current
moordyn bodyWetting
deck bodyIC
--- OUTPUTS ---
"Body1Px"
"Body1Pz"
--- need this line ---
"""


def _tips(arm: Scenario, speed: float) -> Float[np.ndarray, "t 3"]:
    """Return time (s), x and z (m) of the tip, from a nearly straight cable on."""
    import cabledyn

    rod, water = arm.arm, arm.water
    assert isinstance(rod.radius, float)
    area, aside = np.pi * rod.radius**2, 0.02
    # its statics accept no upright cable, and none that is slack by more than a little
    depth = np.sqrt((rod.length * (1 + 1e-6)) ** 2 - aside**2)
    deck = _DECK.format(
        diameter=2 * rod.radius,
        mass=rod.density * area,
        EA=rod.youngs_modulus * area,
        EI=rod.youngs_modulus * area * rod.radius**2 / 4,
        drag=water.drag_normal,
        added=water.added_mass_normal,
        x=aside,
        z=-10.0 - depth,
        volume=0.2 / water.density,
        length=rod.length,
        edges=_EDGES,
        gravity=water.gravity,
        density=water.density,
        time_step=_TIME_STEP,
        duration=_DURATION,
        speed=speed,
    )
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "arm.dat"
        path.write_text(deck, "ascii")
        written = cabledyn.CableDynDriver().run(path, Path(name) / "arm", overwrite=True)
        tips = np.array(written.read_main().values)
    tips[:, 2] += 10.0
    return tips


def _run() -> Evidence:
    checks, scenarios, ends, paths = [], {}, [], []
    for speed in SPEEDS:
        scenarios[f"{speed:g}"] = arm = scenario(MESHES[-1], speed)
        paths.append(_tips(arm, speed))
        theirs = paths[-1][-1, 1:]
        ours = tip_of(equilibrium(arm)) - [0.0, -10.0]
        ends.append(ours)
        text = f"{speed:g} m/s"
        checks += [
            Check(f"x of the tip, {text}", theirs[0], ours[0], 0.002, "m", True),
            Check(f"z of the tip, {text}", theirs[1], ours[1], 0.002, "m", True),
            Check(f"CableDyn still moves, {text}", 0.0, np.ptp(paths[-1][-1000:, 1]), 2e-5, "m"),
        ]

    def draw(axes: Axes) -> None:
        for tips, end in zip(paths, ends, strict=True):
            axes.plot(tips[:, 0], tips[:, 1], color=VERMILLION, label="CableDyn, from rest")
            axes.axhline(end[0], color=BLUE, linestyle="--", label="crinoid, equilibrium")
        axes.set(xlabel="time (s)", ylabel="x of the tip (m)", xlim=(0.0, _DURATION))
        key(axes)

    remarks = ("CableDyn has no free end: the tip carries a body of 0.2 kg, as heavy as water.",)
    return Evidence(checks, None, scenarios, draw, remarks)


CASE = Case(
    name="cabledyn-line",
    title="An arm that hangs in a steady current comes to rest where CableDyn's cable does.",
    source="CableDyn 0.3.0, run in the case from a straight cable until it is at rest.",
    method=f"Static equilibrium with {MESHES[-1]} nodes; CableDyn with {_EDGES} elements, steps of "
    f"{_TIME_STEP:g} s and {_DURATION:g} s.",
    reason="CableDyn's tips are 0.1 % from the boundary-value problem of hanging-in-current; the "
    "mesh of crinoid adds up to a third of an edge squared, 0.02 % of the length.",
    kind="peer",
    run=_run,
    needs=("cabledyn",),
)
