"""A heavy arm that falls from level, and PyElastica's rod without shear and rotary inertia."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from crinoid.scenario import Scenario
from crinoid.validation.case import Case, Check, Evidence
from crinoid.validation.cases.falling_arm import STIFFER, hardly_stretching, simulated_tips
from crinoid.view.figures.style import BLUE, INK, VERMILLION, key

_TIMES = (0.2, 0.3, 0.4, 0.5)
_ELEMENTS, _VERLET_STEP = 40, 2.5e-5
_SLENDER = (1.0, 4.0)
"""Factors on shear stiffness, and divisors of rotary inertia."""


def _fallen(scenario: Scenario, slender: float) -> Float[np.ndarray, "time axis"]:
    """Return the tip (m) of PyElastica's rod at the times.

    PyElastica holds the first element: its middle is the clamp.
    """
    import elastica

    class World(elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing):
        """A rod, its clamp and gravity."""

    arm = scenario.arm
    edge = arm.length / (_ELEMENTS - 0.5)
    rod = elastica.CosseratRod.straight_rod(
        _ELEMENTS,
        np.array([-edge / 2, 0.0, 0.0]),
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 1.0]),
        edge * _ELEMENTS,
        arm.radius,
        arm.density,
        youngs_modulus=arm.youngs_modulus,
        shear_modulus=arm.youngs_modulus / (2 * (1 + arm.poisson_ratio)),
    )
    rod.shear_matrix[:2, :2] *= slender
    rod.shear_matrix[2, 2] *= STIFFER
    rod.mass_second_moment_of_inertia[:] /= slender
    rod.inv_mass_second_moment_of_inertia[:] *= slender
    world = World()
    world.append(rod)
    world.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    fall = np.array([0.0, 0.0, -scenario.water.gravity])
    world.add_forcing_to(rod).using(elastica.GravityForces, acc_gravity=fall)
    world.finalize()
    stepper, step, now = elastica.PositionVerlet(), np.float64(_VERLET_STEP), np.float64(0.0)
    tips = []
    for when in _TIMES:
        for _ in range(round((when - now) / step)):
            now = stepper.step(world, now, step)
        tips.append(rod.position_collection[[0, 2], -1].copy())
    return np.array(tips)


def _run() -> Evidence:
    scenario = hardly_stretching()
    path = simulated_tips(scenario)
    full, slender = (_fallen(scenario, factor) for factor in _SLENDER)
    # shear and rotary inertia delay the rod in proportion
    theirs = slender + (slender - full) / (_SLENDER[1] / _SLENDER[0] - 1)
    checks = []
    for when, expected, found in zip(_TIMES, theirs, map(path.at, _TIMES), strict=True):
        text = f"{when:g} s"
        checks += [
            Check(f"x of the tip, {text}", expected[0], found[0], 1e-3, "m"),
            Check(f"z of the tip, {text}", expected[1], found[1], 1e-3, "m"),
        ]

    def draw(axes: Axes) -> None:
        axes.plot(*path.tips.T, color=BLUE, label="crinoid")
        axes.plot(*full.T, "x", color=VERMILLION, label="PyElastica")
        axes.plot(*theirs.T, "o", mfc="none", color=INK, label="without shear and rotary inertia")
        axes.set(xlabel="x of the tip (m)", ylabel="z of the tip (m)", aspect="equal")
        key(axes)

    moved = 1e3 * np.hypot(*(full - theirs).T)
    remarks = (
        f"Shear and rotary inertia move PyElastica's tip by {', '.join(f'{x:.1f}' for x in moved)} "
        f"mm at {', '.join(f'{when:g}' for when in _TIMES)} s.",
    )
    return Evidence(checks, None, {"": scenario}, draw, remarks)


CASE = Case(
    name="pyelastica-release",
    title="A heavy arm that hardly stretches falls from level, as in PyElastica.",
    source="PyElastica 1.0.0, run in the case; its shear and rotary inertia are extrapolated to "
    "none from all and a quarter of both.",
    method=f"41 nodes, time step 1 ms, undamped, EA {STIFFER:g} times that of the material, as "
    "PyElastica's sections become thinner as they stretch and crinoid's do not. PyElastica with "
    f"{_ELEMENTS} elements and steps of {1e6 * _VERLET_STEP:g} us.",
    reason="From 40 to 80 elements PyElastica's tip moves by up to 0.25 mm, and the extrapolation "
    "leaves a part of its own step of 0.4 mm at 0.2 s and 2.4 mm at 0.5 s.",
    kind="peer",
    run=_run,
    needs=("elastica",),
)
