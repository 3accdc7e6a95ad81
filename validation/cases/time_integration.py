"""Time integration: its order, and the balance of energy."""

from itertools import pairwise

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import BLUE, INK, SERIES
from validation.case import Check, Evidence, case
from validation.slender import MESHES, order_of, slender_arm

_FALL_STEPS = np.array([8e-3, 4e-3, 2e-3, 1e-3])
_FALL_DURATION = 0.8


@case(
    kind="exact",
    title="A heavy arm falls from level; Newmark's method converges with order 2 in the time step.",
    source="Newmark 1959, J. Eng. Mech. Div. ASCE 85(3), 67-94: order 2 with gamma = 1/2.",
    method=f"w L^3/EI = 10 and EA L^2/EI = 1000, {MESHES[0]} nodes, {_FALL_DURATION:g} s in steps "
    "of 8, 4, 2 and 1 ms; the order is from the changes between the last three.",
    reason="Terms of order 4 shift the measured order by less than 0.05 at these steps.",
)
def newmark_order() -> Evidence:
    ends = []
    run = {"start": "rest", "duration": _FALL_DURATION, "tolerance": 1e-12}
    heavy = {"arm.damping_time": 0.02, "arm.section.EA": 1e3, "water.gravity": 10.0}
    heavy |= {"output.interval": _FALL_DURATION}
    for step in _FALL_STEPS:
        values = {"simulation": run | {"time_step": float(step)}}
        scenario = slender_arm(MESHES[0], heavy | values)
        ends.append(simulate(scenario).dataset["position"].values[-1])
    # of successive steps: no run without error of the time step is needed
    changes = [float(np.abs(one - other).max()) for one, other in pairwise(ends)]
    order = order_of(changes)
    checks = [
        Check("order of convergence", 2.0, order, 0.05),
        Check("change, 2 to 1 ms", 0.0, changes[-1], 3e-4, "m"),
    ]

    def draw(axes: Axes) -> None:
        axes.loglog(1e3 * _FALL_STEPS[1:], changes, "o-", color=BLUE, label="crinoid")
        slope = changes[-1] * (_FALL_STEPS[1:] / _FALL_STEPS[-1]) ** 2
        axes.loglog(1e3 * _FALL_STEPS[1:], slope, "--", color=INK, label="order 2")
        axes.set(xlabel="time step (ms)", ylabel="change from twice the step (m)")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")

    return Evidence(checks, order, {"": scenario}, draw)


_STORED = ["kinetic", "elastic", "potential"]
_STEPS = (4e-3, 2e-3, 1e-3)
_SWING_STEPS = 10_000
_TENTH = 100
"""Instants of a tenth of the swing."""
_DRAWN = ("drag", "damping", "actuation", "loads", "added_mass", "tool")
_SWING = {
    "water.gravity": 10.0,
    "arm.section.EA": 1e4,
    "simulation.start": "rest",
    "simulation.tolerance": 1e-12,
    "simulation.time_step": 5e-3,
    "simulation.duration": 5e-3 * _SWING_STEPS,
    "output.interval": 0.05,
}


def _everything(step: float) -> Scenario:
    """Return an arm in space on which everything acts at once."""
    swaying = {"kind": "sine", "channel": "tilt", "amplitude_deg": 10.0, "frequency_hz": 0.6}
    schedule = {"time": [0.0, 0.6, 1.0, 1.4], "share": [0.0, 0.0, 0.5, 0.5]}
    tendon = {"offset": 0.015, "max_tension": 2.0, "friction": 0.2, "schedule": schedule}
    return Scenario(
        arm={"dimension": 3, "nodes": 6, "rest_curvature": [0.5, 0.0, 0.3]}
        | {"relaxation": [{"ratio": 0.4, "time": 0.3}]},
        base={"tilt_deg": -50.0, "motion": [swaying]},
        water={"linear_drag": 0.2, "vortices": {}},
        flow=[{"kind": "uniform", "velocity": [0.12, 0.05, 0.0], "ramp_time": 0.4}],
        load=[{"kind": "tip", "force": [0.0, 0.02, 0.01], "ramp_time": 0.3}],
        tool={"mass": 0.05, "volume": 2e-5, "drag_area": 1e-3},
        tendon=[tendon],
        control={"kind": "none"},
        simulation={"duration": 1.6, "time_step": step, "start": "rest", "tolerance": 1e-12},
        output={"interval": 0.02},
    )


def _imbalance(energy: xr.DataArray) -> Float[np.ndarray, " t"]:
    """Return stored energy less works, since the start (J)."""
    stored = energy.sel(kind=_STORED).sum("kind")
    works = energy.drop_sel(kind=_STORED).sum("kind")
    return np.asarray(stored - stored[0] - works)


@case(
    kind="exact",
    title="Stored energy changes by the works of all forces; an undamped swing keeps its energy.",
    source="Balance of energy. The trapezoid rule keeps E + h^2/12 (a.Ma + v.Kv) (Hairer, Lubich "
    "and Wanner 2006, Geometric Numerical Integration, sections VI.8 and IX.3).",
    method="An arm in space, 6 nodes, with current, drag, vortices, Kelvin-Voigt damping, "
    "relaxation, a tendon with friction, a tool, a load and a moving base, 1.6 s in steps of 4, 2 "
    f"and 1 ms. A heavy arm of 11 nodes that swings from level, undamped, {_SWING_STEPS} steps of "
    "5 ms.",
    reason="The trapezoid rule of the ledger errs by (omega h)^2/12: 4e-6 for 1 ms and 1 Hz. The "
    "energy of the swing stays in a band of (omega h)^2/12, 1e-3 for its second mode of 22 rad/s; "
    "allowed are a drift of a twentieth of the band and a tenth more width.",
)
def energy_balance() -> Evidence:
    ledgers = [simulate(_everything(step)).dataset["energy"] for step in _STEPS]
    left = [float(np.abs(_imbalance(each)).max()) for each in ledgers]
    works = ledgers[-1].drop_sel(kind=_STORED)
    turned = float(np.abs(works[-1]).sum())
    order = order_of(left)
    swing = slender_arm(11, _SWING)
    swung = simulate(swing).dataset["energy"]
    kinetic = float(swung.sel(kind="kinetic").max())
    total = _imbalance(swung) / kinetic
    first, last = total[1 : _TENTH + 1], total[-_TENTH:]
    widths = np.ptp(first), np.ptp(last)
    band, drift = widths[1] / widths[0], (last.mean() - first.mean()) / widths[0]
    share = left[-1] / turned
    checks = [
        Check("what all works and stored energies leave, over the works", 0.0, share, 4e-6),
        Check("order in the time step", 2.0, order, 0.1),
        Check("undamped swing: largest energy over kinetic", 0.0, np.abs(total).max(), 1e-3),
        Check("undamped swing: band of the last tenth over the first", 1.0, band, 0.1),
        Check("undamped swing: drift over the band", 0.0, drift, 0.05),
    ]

    def draw(axes: Axes) -> None:
        time = works["time"].values
        for kind, colour in zip(_DRAWN, SERIES, strict=False):
            axes.plot(time, 1e3 * works.sel(kind=kind), color=colour, label=kind.replace("_", " "))
        stored = ledgers[-1].sel(kind=_STORED).sum("kind")
        stored = 1e3 * (stored - stored[0])
        axes.plot(time[::4], stored[::4], "o", mfc="none", color=INK, ms=4, label="stored")
        axes.plot(time, 1e3 * works.sum("kind"), color=INK, label="all works")
        axes.set(xlabel="time (s)", ylabel="energy and works (mJ)")

    return Evidence(checks, order, {"everything": _everything(_STEPS[-1]), "swing": swing}, draw)
