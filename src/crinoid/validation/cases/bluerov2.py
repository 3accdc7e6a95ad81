"""A BlueROV2 Heavy: terminal speeds and decay."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from matplotlib.axes import Axes
from scipy.integrate import solve_ivp

from crinoid.scenario import Scenario
from crinoid.simulation import simulate
from crinoid.validation.case import Case, Check, Evidence
from crinoid.view.figures.style import AXIS_COLOURS, INK, key

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

_THRUST, _CURRENT, _MOMENT = 40.0, 0.5, 2.0
_DURATION = 6.0
_ROV: dict[str, Any] = {
    "arm.dimension": 3,
    "arm.nodes": 3,
    "arm.length": 0.1,
    # a rod that weighs and drags next to nothing, and is stiff enough for the moments
    "arm.section": {
        "EA": 1e6,
        "EI": 1e3,
        "GJ": 1e3,
        "mass_per_length": 1e-4,
        "diameter": 1e-4,
        "displaced_area": 1e-7,
    },
    "base.position": [0.0, 0.0, -10.0],
    "water.density": _DENSITY,
    "water.gravity": _GRAVITY,
    "vehicle": {
        "mass": _MASS,
        "volume": _VOLUME,
        "inertia": _INERTIA.tolist(),
        "added_mass": _ADDED_MASS.tolist(),
        "added_inertia": _ADDED_INERTIA.tolist(),
        "linear_drag": _LINEAR.tolist(),
        "drag_area": (2 * _QUADRATIC / _DENSITY).tolist(),
        "angular_linear_drag": _ANGULAR_LINEAR.tolist(),
        "angular_drag": _ANGULAR_QUADRATIC.tolist(),
    },
    "load": [{"kind": "tip", "follower": True}],
    "flow": [{"kind": "uniform", "velocity": [0.0, 0.0, 0.0]}],
    "control.kind": "none",
    "simulation.duration": _DURATION,
    "simulation.time_step": 0.01,
    "simulation.start": "rest",
    "output.interval": 0.05,
}


def _run() -> Evidence:
    import time
    for v in ({"load.0.force": [_THRUST, 0.0, 0.0], "flow.0.velocity": [0.0, _CURRENT, 0.0]},
              *({"load.0.moment": m} for m in ([2.,0,0],[0,2.,0],[0,0,2.]))):
        t=time.time()
        r=simulate(Scenario().with_values(_ROV|v)); d=r.dataset["vehicle_pose"]
        print(r.status, d[-1].values, (d[-1]-d[-2]).values/.05, time.time()-t)
