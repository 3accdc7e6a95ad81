"""The same motion by the planar and the spatial arm."""

import numpy as np
from matplotlib.axes import Axes

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.view.figures.style import BLUE, ORANGE
from validation.case import Check, Evidence, case


def _scenario(dimension: int) -> Scenario:
    """Return an arm that a current, waves of the base, weight and a follower bend in a plane."""

    def vector(x: float, z: float) -> list[float]:
        return [x, z] if dimension == 2 else [x, 0.0, z]

    tilting = {"kind": "sine", "channel": "tilt", "amplitude_deg": 15.0, "frequency_hz": 0.7}
    heaving = {"kind": "sine", "channel": "heave", "amplitude": 0.03, "frequency_hz": 0.5}
    position = vector(0.0, -10.0)
    return Scenario(
        arm={"dimension": dimension, "nodes": 7, "rest_curvature": 1.0},
        base={"position": position, "tilt_deg": -40.0, "motion": [tilting, heaving]},
        flow=[
            {"kind": "uniform", "velocity": vector(0.15, 0.0), "ramp_time": 0.5},
            {"kind": "sine", "amplitude": vector(0.05, 0.1), "frequency_hz": 1.1},
        ],
        load=[{"kind": "tip", "force": vector(0.0, 0.02), "follower": True}],
        simulation={"duration": 2.0, "time_step": 0.01, "tolerance": 1e-13},
    )


@case(
    kind="exact",
    title="An arm that moves in a plane does the same as a planar and as a spatial arm.",
    source="Symmetry: no force acts out of the plane. The two arms bend by different elements.",
    method="7 nodes, 2 s in steps of 10 ms, Newton's tolerance 1e-13, both from equilibrium: a "
    "moving base, steady and swinging current, weight, a force that follows the tip.",
    reason="Steps are solved to 1e-13 of the largest force. Over 200 steps this and round-off "
    "stay below 1e-9 m, by the stiffness of an edge below 1e-6 N.",
)
def plane_and_space() -> Evidence:
    flat, full = (simulate(_scenario(dimension)).dataset for dimension in (2, 3))
    place, deep = flat["position"].values, full["position"].values
    force = np.abs(flat["base_force"].values - full["base_force"].values[:, [0, 2]]).max()
    apart = np.abs(place - deep[..., [0, 2]]).max()
    checks = [
        Check("largest distance of the nodes", 0.0, float(apart), 1e-9, "m"),
        Check("largest y in space", 0.0, float(np.abs(deep[..., 1]).max()), 1e-9, "m"),
        Check("largest difference of the force on the base", 0.0, float(force), 1e-6, "N"),
    ]

    def draw(axes: Axes) -> None:
        for index in range(0, len(place), 40):
            axes.plot(*place[index].T, color=ORANGE, lw=3.5, label="in the plane")
            axes.plot(*deep[index, :, [0, 2]], color=BLUE, label="in space")
        axes.set(xlabel="x (m)", ylabel="z (m)", aspect="equal")

    scenarios = {"plane": _scenario(2), "space": _scenario(3)}
    return Evidence(checks, None, scenarios, draw)
