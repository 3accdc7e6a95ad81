"""A tendon that rubs in its channel while it is pulled and paid out."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.foundation.fixed_numbers import ADHESION
from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import BLUE, GREY, INK, VERMILLION
from validation.case import Check, Evidence, case

_LENGTH, _OFFSET, _FRICTION = 0.5, 0.008, 0.3
_EI = 1e5 * np.pi / 4 * 0.02**4
_TENSION = 1.5 * _EI / (_OFFSET * _LENGTH)
"""Bends the arm by 1.5 rad without friction (N)."""
_TIME, _SHARE = [0.0, 15.0, 20.0, 30.0, 35.0], [0.0, 1.0, 1.0, 0.4, 0.4]


def pulled(tension: float) -> float:
    """Return the turn of the tip (rad) while the tendon is pulled: tension T/(1 + mu k s)."""
    bend = _OFFSET * tension * _LENGTH / _EI
    return float(np.log(1.0 + _FRICTION * bend) / _FRICTION)


def paid_out(tension: float) -> float:
    """Return the turn of the tip (rad) once all of the tendon slides: T/(1 - mu k s)."""
    bend = _OFFSET * tension * _LENGTH / _EI
    return float(-np.log(1.0 - _FRICTION * bend) / _FRICTION)


def _scenario() -> Scenario:
    tendon = {"offset": _OFFSET, "friction": _FRICTION, "max_tension": float(_TENSION)}
    return Scenario(
        arm={"nodes": 21, "length": _LENGTH, "radius": 0.02, "youngs_modulus": 1e5}
        | {"density": 10.0, "damping_time": 0.1},
        water={"density": 0.0, "gravity": 0.0},
        tendon=[tendon | {"schedule": {"time": _TIME, "share": _SHARE}}],
        simulation={"duration": _TIME[-1], "time_step": 0.05, "start": "rest"},
        output={"interval": 0.5},
    )


@case(
    kind="exact",
    title="A tendon with friction bends the arm less when pulled than when paid out.",
    source="Euler-Eytelwein on an arm that the tendon itself bends, EI k = r T: T' = -+ mu k T "
    "gives the turn ln(1 + mu r T L/EI)/mu pulled, -ln(1 - mu r T L/EI)/mu paid out.",
    method="Run of 35 s of a light arm in a vacuum with 21 nodes, in steps of 0.05 s; the tendon "
    "is slowly pulled to its largest tension and paid out to 0.4 of it, with 5 s of rest after "
    "each.",
    reason="Friction develops over a sliding of 2e-4 of the tendon's length, twice that when it "
    "reverses. Near the end 1 % of the tendon slides less, on the way back 4 %, and may bend as "
    "without friction or as when pulled.",
)
def tendon_friction() -> Evidence:
    scenario = _scenario()
    data = simulate(scenario).dataset
    time, angle = data["time"].values, data["tip_angle"].values
    before, after = (float(np.interp(at, time, angle)) for at in (20.0, 35.0))
    high, low = pulled(_TENSION), paid_out(0.4 * _TENSION)
    # parts of the tendon that slide too little, and how far the tip is from where it would be
    # without friction, or without turning round
    sticks = ADHESION * _LENGTH / _OFFSET
    within = sticks / high * (1.5 - high)
    within_back = 2.0 * sticks / (high - low) * (low - pulled(0.4 * _TENSION))
    checks = [
        Check("turn, pulled", high, before, within, "rad"),
        Check("turn, paid out", low, after, within_back, "rad"),
    ]

    def draw(axes: Axes) -> None:
        axes.plot(np.interp(time, _TIME, _SHARE), angle, color=BLUE, label="crinoid")
        shares = np.linspace(0.0, 1.0, 50)
        for law, colour in ((pulled, INK), (paid_out, VERMILLION)):
            turns = [law(share * _TENSION) for share in shares]
            name = "exact: pulled" if law is pulled else "paid out"
            axes.plot(shares, turns, "--", color=colour, label=name)
        axes.plot(shares, 1.5 * shares, ":", color=GREY, label="no friction")
        axes.set(xlabel="tension at the root over its largest", ylabel="turn of the tip (rad)")
        axes.set(xlim=(0.0, 1.05), ylim=(0.0, 1.6))

    return Evidence(checks, None, {"": scenario}, draw)
