"""A BlueROV2 Heavy: terminal speeds and decay."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import INK, SERIES
from validation.case import Check, Evidence, case

_DENSITY, _GRAVITY = 1000.0, 9.82
_MASS, _VOLUME = 13.5, 0.0134
_INERTIA = np.array([0.26, 0.23, 0.37])
_ADDED_MASS = np.array([6.3567, 7.1206, 18.6863])
_ADDED_INERTIA = np.array([0.1858, 0.1348, 0.2215])
_LINEAR = np.array([13.7, 0.0, 33.0])
_QUADRATIC = np.array([141.0, 217.0, 190.0])
_ANGULAR_LINEAR = np.array([0.0, 0.8, 0.0])
_ANGULAR_QUADRATIC = np.array([1.192, 0.470, 1.500])
"""Surge, sway and heave, then roll, pitch and yaw."""

_THRUST, _CURRENT = 40.0, 0.5
_MOMENTS = np.array([0.05, 0.2, 0.05])
# a rod that weighs and drags next to nothing and carries the moments; a stiffer one would need
# steps that its waves set
_SECTION = {"EA": 1e4, "EI": 10.0, "GJ": 10.0, "mass_per_length": 1e-4, "diameter": 1e-4}
_VEHICLE = {
    "mass": _MASS,
    "volume": _VOLUME,
    "inertia": _INERTIA.tolist(),
    "added_mass": _ADDED_MASS.tolist(),
    "added_inertia": _ADDED_INERTIA.tolist(),
    "linear_drag": _LINEAR.tolist(),
    "drag_area": (2 * _QUADRATIC / _DENSITY).tolist(),
    "angular_linear_drag": _ANGULAR_LINEAR.tolist(),
    "angular_drag": _ANGULAR_QUADRATIC.tolist(),
}
_ROV = Scenario(
    arm={"dimension": 3, "nodes": 3, "length": 0.1, "section": _SECTION | {"displaced_area": 1e-7}},
    base={"position": [0.0, 0.0, -10.0]},
    water={"density": _DENSITY},
    vehicle=_VEHICLE,
    load=[{"kind": "tip", "force": [0.0] * 3, "moment": [0.0] * 3, "follower": True}],
    flow=[{"kind": "uniform", "velocity": [0.0, 0.0, 0.0]}],
    control={"kind": "none"},
    simulation={"duration": 6.0, "time_step": 0.01, "start": "rest"},
    output={"interval": 0.1},
)


class _Motion(NamedTuple):
    """A motion along or about one axis, from rest."""

    name: str
    channel: str
    values: dict[str, object]
    inertia: float
    """With that of the water (kg or kg m2)."""
    linear: float
    quadratic: float
    push: float = 0.0
    """N or N m."""
    water: float = 0.0
    """Velocity of the water (m/s)."""

    def exact(self, times: Float[np.ndarray, " t"]) -> Float[np.ndarray, "2 t"]:
        """Integrate the motion by DOP853: displacement, velocity."""

        def rates(_: float, y: Float[np.ndarray, "2"]) -> list[float]:
            slip = self.water - y[1]
            drag = self.linear * slip + self.quadratic * abs(slip) * slip
            return [y[1], (self.push + drag) / self.inertia]

        span = (0.0, times[-1])
        done = solve_ivp(rates, span, [0.0, 0.0], "DOP853", t_eval=times, rtol=1e-10, atol=1e-12)
        return np.asarray(done.y)


def _motions() -> list[_Motion]:
    mass, inertia = _MASS + _ADDED_MASS, _INERTIA + _ADDED_INERTIA
    still = {"water.gravity": 0.0}
    weight = _GRAVITY * (_MASS - _DENSITY * _VOLUME)
    values = (
        still | {"load.0.force": [_THRUST, 0.0, 0.0]},
        still | {"flow.0.velocity": [0.0, _CURRENT, 0.0]},
        {"water.gravity": _GRAVITY},
    )
    pushes, water = (_THRUST, 0.0, -weight), (0.0, _CURRENT, 0.0)
    names = ("surge", "sway", "heave"), ("slide", "sway", "heave")
    along = map(_Motion, *names, values, mass, _LINEAR, _QUADRATIC, pushes, water)
    turned = [still | {"load.0.moment": row.tolist()} for row in np.diag(_MOMENTS)]
    names = ("roll", "pitch", "yaw"), ("roll", "tilt", "pan")
    # tilt is up, where a right-handed turn about y is down
    signs = _MOMENTS * [1, -1, 1]
    about = map(_Motion, *names, turned, inertia, _ANGULAR_LINEAR, _ANGULAR_QUADRATIC, signs)
    return [*along, *about]


@case(
    kind="published",
    title="A BlueROV2 Heavy moves along and about each axis, up to its terminal speeds.",
    source="von Benzon et al. 2022, J. Mar. Sci. Eng. 10, 1898: mass, inertia, added mass, linear "
    "and quadratic drag. (m + added) dv/dt = F + c1 (u - v) + c2 |u - v| (u - v), integrated by "
    "SciPy's DOP853 to 1e-10.",
    method="The vehicle with a rod of 10 mg in space, steps of 10 ms: thrust 40 N, current 0.5 "
    "m/s, weight of 0.1 kg; moments 0.05, 0.2, 0.05 N m.",
    reason="Steps of h err by (h/T)^2/12 in a decay of time T: 5e-4 with T = 0.13 s of the surge. "
    "The rod adds up to 2.5e-5 to the drag.",
)
def bluerov2() -> Evidence:
    checks, scenarios, drawn = [], {}, []
    for each in _motions():
        scenarios[each.name] = scenario = _ROV.with_values(each.values)
        pose = simulate(scenario).dataset["vehicle_pose"].sel(channel=each.channel)
        times, moved = pose["time"].values, pose.values
        place, _ = each.exact(times)
        unit = "m" if each.inertia > 1 else "rad"
        rate = np.diff(moved) / np.diff(times)
        wanted = np.diff(place) / np.diff(times)
        error = np.abs(moved - place).max() / np.abs(place).max()
        checks += [
            Check(f"{each.name}, last 0.1 s", wanted[-1], rate[-1], 5e-4, f"{unit}/s", True),
            Check(f"{each.name}, largest error over the way", 0.0, error, 1e-3),
        ]
        drawn.append((times[1:] - 0.05, rate / wanted[-1], wanted / wanted[-1]))

    def draw(axes: Axes) -> None:
        for each, (times, ours, exact), colour in zip(_motions(), drawn, SERIES, strict=False):
            axes.plot(times, ours, color=colour, label=each.name)
            axes.plot(times[::5], exact[::5], "o", mfc="none", color=INK, ms=4, label="exact")
        axes.set(xlabel="time (s)", ylabel="speed over the last one")

    return Evidence(checks, None, scenarios, draw)
