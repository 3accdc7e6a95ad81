"""A heavy arm that falls from level, as other programs compute it: in print, and run here."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.optimize import brentq

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import BLUE, GREEN, INK, PURPLE, VERMILLION
from validation.case import Check, Evidence, case
from validation.peers.swing import Swing
from validation.slender import cantilever_roots

_LENGTH, _RADIUS, _DENSITY, _MODULUS, _POISSON = 0.6, 0.03, 1000.0, 1e6, 0.5
_STIFFER = 16.0
"""Stretching stiffness of `_stiffer` over that of the material."""
_SHEAR_FACTOR = 27.0 / 28.0
"""Of PyElastica: shear stiffness over that of an even shear."""
_NODES, _STEP, _DAMPING = 41, 1e-3, 0.03
_UNDAMPED = {0.2: (0.5292, -0.2671), 0.3: (0.3603, -0.4563), 0.5: (-0.0017, -0.5049)}
"""x and z (m) of the tip by PyElastica with 80 elements, by time (s)."""
_TURN, _AT_THE_TURN = 0.5, 0.014
"""Time at which the tip turns (s), and the tolerance there (m)."""
_DAMPED = {
    "SoRoMoX": {0.5: (0.11569, -0.49327), 1.0: (0.57781, -0.15035), 2.0: (0.52785, -0.26174)},
    "SoRoSim": {0.5: (0.11390, -0.49333), 1.0: (0.57863, -0.14760), 2.0: (0.52977, -0.25840)},
    "PyElastica": {0.5: (0.14186, -0.49632), 1.0: (0.58359, -0.13253), 2.0: (0.54179, -0.24041)},
}


class _TipPath(NamedTuple):
    """Times (s) and the tip at each (m)."""

    time: Float[np.ndarray, " t"]
    tips: Float[np.ndarray, "t axis"]

    def at(self, when: float) -> Float[np.ndarray, " axis"]:
        """Return the tip at a time, linear between samples."""
        return np.array([np.interp(when, self.time, each) for each in self.tips.T])


def _falling(nodes: int, time_step: float, damping_time: float, duration: float) -> Scenario:
    """Return the arm, level at rest at t = 0, without water."""
    return Scenario(
        arm={"length": _LENGTH, "nodes": nodes, "radius": _RADIUS, "density": _DENSITY}
        | {"youngs_modulus": _MODULUS, "poisson_ratio": _POISSON, "damping_time": damping_time},
        base={"position": [0.0, 0.0]},
        water={"density": 0.0},
        simulation={"start": "rest", "time_step": time_step, "duration": duration},
        output={"interval": 0.01},
    )


def _simulated(scenario: Scenario) -> _TipPath:
    dataset = simulate(scenario).dataset
    return _TipPath(dataset["time"].values, dataset["tip_position"].values)


def _timoshenko_share() -> float:
    """Return the first frequency of a cantilever with shear and rotary inertia over that without.

    Timoshenko's beam: displacements are sums of cosh(a s), sinh(a s), cos(b s), sin(b s), with
    arc length s over L; the frequency is where the four conditions at the ends have a solution.
    """
    slender = (_RADIUS / (2 * _LENGTH)) ** 2  # radius of gyration over length, squared
    soft = slender * 2 * (1 + _POISSON) / _SHEAR_FACTOR  # EI/(kGA L^2)

    def lacking(root: float) -> float:
        square = root**4  # of the frequency, times m L^4/EI
        mean, off = 0.5 * square * (slender + soft), 0.5 * square * (slender - soft)
        spread = np.sqrt(off**2 + square)
        a, b = np.sqrt(spread - mean), np.sqrt(spread + mean)
        # slope of the section over that of the displacement's derivative
        p, q = (a**2 + square * soft) / a, (b**2 - square * soft) / b
        ch, sh, c, s = np.cosh(a), np.sinh(a), np.cos(b), np.sin(b)
        conditions = np.array(
            [
                [1.0, 0.0, 1.0, 0.0],
                [0.0, p, 0.0, q],
                [a * p * ch, a * p * sh, -b * q * c, -b * q * s],
                [(a - p) * sh, (a - p) * ch, (q - b) * s, (b - q) * c],
            ]
        )
        return float(np.linalg.det(conditions))

    (first,) = cantilever_roots(1)
    return float(brentq(lacking, 0.9 * first, first) ** 2 / first**2)


@case(
    kind="published",
    title="A heavy arm falls from level, as other programs compute it.",
    source="SoRoMoX (2026), section IV a: damped, by SoRoMoX, SoRoSim and PyElastica. Undamped: "
    "PyElastica 1.0.0 with 80 elements.",
    method=f"{_NODES} nodes, time step {1e3 * _STEP:g} ms.",
    reason="Up to 0.3 s: the way of the tip in the delay by shear and rotary inertia, from "
    "Timoshenko's beam. At 0.5 s, where the tip turns: 14 mm, the effect of these and of "
    "PyElastica's thinner sections under tension on its own tip (see pyelastica-release).",
)
def falling_arm() -> Evidence:
    scenarios = {
        "undamped": _falling(_NODES, _STEP, 0.0, 2.0),
        "damped": _falling(_NODES, _STEP, _DAMPING, 2.0),
    }
    paths = {label: _simulated(scenario) for label, scenario in scenarios.items()}
    share = _timoshenko_share()
    checks = []
    for when, expected in _UNDAMPED.items():
        found = paths["undamped"].at(when)
        way = np.hypot(*(found - paths["undamped"].at(share * when)))
        allowed = _AT_THE_TURN if when == _TURN else way
        apart = np.hypot(*(found - expected))
        checks.append(Check(f"distance from PyElastica, {when:g} s", 0.0, apart, allowed, "m"))
    damped = []
    for name, places in _DAMPED.items():
        apart = [np.hypot(*(paths["damped"].at(when) - place)) for when, place in places.items()]
        damped.append(f"{name} {', '.join(f'{1e3 * each:.0f}' for each in apart)}")

    def draw(axes: Axes) -> None:
        for label, line in (("undamped", ":"), ("damped", "-")):
            time, tips = paths[label]
            axes.plot(time, tips[:, 1], line, color=BLUE, label=f"crinoid, {label}")
        for (name, places), colour in zip(
            _DAMPED.items(), (GREEN, PURPLE, VERMILLION), strict=True
        ):
            axes.plot(list(places), [z for _, z in places.values()], "o", color=colour, label=name)
        undamped = list(_UNDAMPED), [z for _, z in _UNDAMPED.values()]
        axes.plot(*undamped, "s", mfc="none", color=VERMILLION, label="PyElastica, undamped")
        axes.set(xlabel="time (s)", ylabel="z of the tip (m)", ylim=(-0.56, 0.25))
        axes.legend(ncols=2, fontsize=8, frameon=False, loc="upper center")

    remarks = (
        "Shear and rotary inertia, which crinoid leaves out, lower the first frequency, and delay "
        f"PyElastica's arm, by {100 * (1 - share):.2f} %.",
        f"With damping_time = {_DAMPING:g} s the tip is off those in print at 0.5, 1 and 2 s by "
        f"(mm): {'; '.join(damped)}. SoRoMoX and SoRoSim have only two segments there (see "
        "soromox-fall), PyElastica another law of damping.",
    )
    return Evidence(checks, None, scenarios, draw, remarks)


_TIMES = (0.2, 0.3, 0.4, 0.5)
_MUJOCO_NODES, _MUJOCO_STEP = (21, 41), 1e-4
_ELEMENTS, _VERLET_STEP = 40, 2.5e-5
_SLENDER = (1.0, 4.0)
"""Factors on PyElastica's shear stiffness, and divisors of its rotary inertia."""
_SEGMENTS = {2: 5e-4, 4: 2.5e-4, 8: 1e-4}
"""Numbers of SoRoMoX's segments, and time steps of an explicit method of order 5 (s)."""
Times = tuple[float, ...]


def _stiffer(damping_time: float, times: Times) -> tuple[Scenario, _TipPath]:
    """Return the arm with 16 times the stretching stiffness of its material, and its fall.

    Other programs do not stretch, or have sections that become thinner as they do.
    """
    plain = _falling(_NODES, _STEP, damping_time, times[-1])
    area = np.pi * _RADIUS**2
    scenario = plain.with_values({"arm.section": {"EA": float(_STIFFER * _MODULUS * area)}})
    return scenario, _simulated(scenario)


def _by_peer(
    prepare: Callable[..., Swing], nodes: int, time_step: float, times: Times, damping: float = 0.0
) -> Float[np.ndarray, "time axis"]:
    """Return the tip (m) of a peer's arm at the times, which are multiples of the first step."""
    arm, interval = _falling(nodes, _STEP, damping, times[-1]), round(times[1] - times[0], 9)
    tips, _ = prepare(arm, time_step, interval, round(times[-1] / interval))()
    return np.asarray(tips[[round(when / interval) - 1 for when in times]])


def _compared(
    path: _TipPath, theirs: Float[np.ndarray, "time axis"], times: Times, within: float
) -> list[Check]:
    return [
        Check(f"{axis} of the tip, {when:g} s", reference, found, within, "m")
        for when, place in zip(times, theirs, strict=True)
        for axis, reference, found in zip("xz", place, path.at(when), strict=True)
    ]


@case(
    kind="peer",
    title="A heavy arm that hardly stretches falls from level, as in MuJoCo.",
    source="MuJoCo 4.0.0, run in the case: a rod by flexcomp, integrator discrete.",
    method=f"41 nodes, time step 1 ms, undamped, EA {_STIFFER:g} times that of the material: the "
    "edges of MuJoCo keep their length by soft constraints. MuJoCo by steps of "
    f"{_MUJOCO_STEP:g} s, extrapolated from {_MUJOCO_NODES[0]} and {_MUJOCO_NODES[1]} vertices "
    "with order 2.",
    reason="A third of MuJoCo's change between the meshes, 1 mm at 0.5 s.",
    needs=("mujoco",),
)
def mujoco_rod() -> Evidence:
    from validation.peers.mujoco import prepare

    scenario, path = _stiffer(0.0, _TIMES)
    coarse, fine = (_by_peer(prepare, nodes, _MUJOCO_STEP, _TIMES) for nodes in _MUJOCO_NODES)
    theirs = fine + (fine - coarse) / 3

    def draw(axes: Axes) -> None:
        axes.plot(*path.tips.T, color=BLUE, label="crinoid")
        axes.plot(*theirs.T, "o", mfc="none", color=VERMILLION, label="MuJoCo")
        axes.set(xlabel="x of the tip (m)", ylabel="z of the tip (m)", aspect="equal")

    return Evidence(_compared(path, theirs, _TIMES, 1e-3), None, {"": scenario}, draw)


@case(
    kind="peer",
    title="A heavy arm that hardly stretches falls from level, as in PyElastica.",
    source="PyElastica 1.0.0, run in the case; its shear and rotary inertia are extrapolated to "
    "none from all and a quarter of both.",
    method=f"41 nodes, time step 1 ms, undamped, EA {_STIFFER:g} times that of the material, as "
    "PyElastica's sections become thinner as they stretch and crinoid's do not. PyElastica with "
    f"{_ELEMENTS} elements and steps of {1e6 * _VERLET_STEP:g} us.",
    reason="From 40 to 80 elements PyElastica's tip moves by up to 0.25 mm; the extrapolation "
    "leaves a part of its step of 0.4 mm at 0.2 s and 2.4 mm at 0.5 s.",
    needs=("elastica",),
)
def pyelastica_release() -> Evidence:
    from validation.peers.pyelastica import prepare

    def change(rod: Any, slender: float) -> None:
        rod.shear_matrix[:2, :2] *= slender
        rod.shear_matrix[2, 2] *= _STIFFER
        rod.mass_second_moment_of_inertia[:] /= slender
        rod.inv_mass_second_moment_of_inertia[:] *= slender

    scenario, path = _stiffer(0.0, _TIMES)
    rods = [partial(prepare, change=partial(change, slender=each)) for each in _SLENDER]
    full, slender = (_by_peer(rod, _ELEMENTS + 1, _VERLET_STEP, _TIMES) for rod in rods)
    # shear and rotary inertia delay the rod in proportion
    theirs = slender + (slender - full) / (_SLENDER[1] / _SLENDER[0] - 1)

    def draw(axes: Axes) -> None:
        axes.plot(*path.tips.T, color=BLUE, label="crinoid")
        axes.plot(*full.T, "x", color=VERMILLION, label="PyElastica")
        axes.plot(*theirs.T, "o", mfc="none", color=INK, label="without shear and rotary inertia")
        axes.set(xlabel="x of the tip (m)", ylabel="z of the tip (m)", aspect="equal")

    moved = 1e3 * np.hypot(*(full - theirs).T)
    remarks = (
        f"Shear and rotary inertia move PyElastica's tip by {', '.join(f'{x:.1f}' for x in moved)} "
        f"mm at {', '.join(f'{when:g}' for when in _TIMES)} s.",
    )
    return Evidence(_compared(path, theirs, _TIMES, 1e-3), None, {"": scenario}, draw, remarks)


@case(
    kind="peer",
    title="A damped heavy arm falls from level, as in SoRoMoX when its segments are refined.",
    source="SoRoMoX 0.5.0, run in the case with 2, 4 and 8 segments of constant curvature, which "
    "neither stretch nor shear.",
    method=f"41 nodes, time step 1 ms, damping time {_DAMPING:g} s, EA {_STIFFER:g} times that of "
    "the material. SoRoMoX is extrapolated from 4 and 8 segments with order 2.",
    reason="A third of SoRoMoX's change from 4 to 8 segments, 3 mm at 0.5 s.",
    needs=("soromox",),
)
def soromox_fall() -> Evidence:
    from validation.peers.soromox import prepare

    times = (0.5, 1.0, 2.0)
    scenario, path = _stiffer(_DAMPING, times)
    rod = partial(prepare, stretches=False)
    two, four, eight = (
        _by_peer(rod, count + 1, step, times, _DAMPING) for count, step in _SEGMENTS.items()
    )
    theirs = eight + (eight - four) / 3

    def draw(axes: Axes) -> None:
        axes.plot(path.time, path.tips[:, 1], color=BLUE, label="crinoid")
        axes.plot(times, two[:, 1], "x", color=VERMILLION, label="SoRoMoX, 2 segments")
        axes.plot(times, theirs[:, 1], "o", mfc="none", color=INK, label="refined")
        axes.set(xlabel="time (s)", ylabel="z of the tip (m)")

    apart = 1e3 * np.hypot(*(two - theirs).T)
    remarks = (
        "Two segments, as in print, are off the refined ones by "
        f"{', '.join(f'{x:.0f}' for x in apart)} mm at {', '.join(map(str, times))} s. The tip of "
        "falling-arm is as far from theirs.",
    )
    return Evidence(_compared(path, theirs, times, 3e-3), None, {"": scenario}, draw, remarks)
