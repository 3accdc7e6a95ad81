"""Equilibria in currents that change along the arm: found, balanced in the water as it is."""

from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import crinoid
from crinoid import Scenario
from crinoid.dynamics import Context
from crinoid.dynamics.rows import BOUNDARY_NODES
from crinoid.dynamics.statics import static_stage
from crinoid.flow import MeasuredPoint
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from helpers.arms import QUICKLY, acting

NOT_YET = 1e6
"""A start (s) that no test comes to: the flow is there, compiled, but adds nothing."""
TIME = 1.3


@cache
def arm(kinds, tilt, seed=0, *, pinned=False, mean=0.2, intensity=0.2, scale=0.3):
    """Return the default arm in some of all kinds of flow, always of the same structure."""
    flows = {
        "turbulence": {
            "mean": [mean, 0.0],
            "intensity": intensity,
            "length_scale": scale,
        },
        "waves": {"significant_height": 1.0, "peak_period": 5.0},
        "gauss-markov": {"mean": [0.2, 0.0], "standard_deviation": 0.1, "correlation_time": 1.0},
        "gust": {"velocity": [0.3, 0.1], "duration": 4.0},
        "shear": {"velocity": [0.3, 0.0], "reference_depth": 5.0, "exponent": 0.4},
    }
    scenario = Scenario(
        base={
            "tilt_deg": tilt,
            "mount": "pinned" if pinned else "clamped",
            "position": [0.0, -10.0],
        },
        water={"depth": 20.0},
        flow=[
            {"kind": kind, "start": 0.0 if kind in kinds else NOT_YET} | table
            for kind, table in flows.items()
        ],
        seed=seed,
    )
    # a record at one point, drifting past
    past = np.array([0.25, 0.0])
    when = np.linspace(-20.0, 20.0, 81)
    wandering = 1 + 0.3 * np.sin(2.0 * when[:, None] + np.arange(2))
    record = MeasuredPoint(
        Onset.of(0.0 if "measured" in kinds else NOT_YET),
        PiecewisePolynomial(CubicSpline(when, past * wandering)),
        jnp.zeros(2),
        jnp.asarray(past / (past @ past)),
        carried=True,
    )
    system = crinoid.system(scenario)
    flows = (*system.forces.water.flows, record)
    return eqx.tree_at(lambda s: s.forces.water.flows, system, flows)


@eqx.filter_jit(compiler_options=QUICKLY)
def find(system, time):
    """Find an equilibrium, and ask the water again what the imbalance is there."""
    state, outcome = system.find_equilibrium(time)
    position = state.motion.position
    forces = acting(system, Context().at_rest(time))
    none = jnp.zeros_like(position)
    stage = static_stage(time, position, None)
    residual, _ = forces.residual(forces.motion(stage, none, forces.surroundings(stage, none)))
    return position, jnp.max(jnp.abs(residual[BOUNDARY_NODES:])), outcome


def found(system, time=0.0):
    """Return where the nodes are in equilibrium, which must be one."""
    position, imbalance, outcome = find(system, jnp.asarray(time))
    assert outcome.converged
    # the outcome tells of the same balance, which is within the tolerance of a time step
    np.testing.assert_allclose(imbalance, outcome.residual, rtol=0, atol=1e-11)
    assert imbalance <= 1e-8 * outcome.scale
    return np.asarray(position)


@pytest.mark.release
@pytest.mark.parametrize(
    ("tilt", "seed", "kind"),
    [
        (-30.0, 0, (0.2, 0.2, 0.3)),
        (-30.0, 7, (0.2, 0.2, 0.3)),
        (4.0, 4, (0.2, 0.4, 0.3)),
        (20.0, 5, (0.3, 0.3, 0.1)),
        (-60.0, 1, (0.4, 0.2, 0.3)),
    ],
)
def test_turbulence_has_an_equilibrium(tilt, seed, kind):
    # the search once roamed from eddy to eddy in the first four
    mean, intensity, scale = kind
    found(arm(("turbulence",), tilt, seed, mean=mean, intensity=intensity, scale=scale))


@pytest.mark.slow
@pytest.mark.parametrize("pinned", [False, True], ids=["clamped", "pinned"])
@pytest.mark.parametrize(
    "kinds",
    [
        ("waves",),
        ("gauss-markov",),
        ("gust",),
        ("measured",),
        ("shear", "turbulence", "waves"),
        ("gust", "gauss-markov", "measured", "turbulence"),
    ],
    ids=" ".join,
)
def test_currents_of_all_kinds_have_an_equilibrium(kinds, pinned):
    position = found(arm(kinds, -40.0, pinned=pinned), TIME)
    # the current has moved it
    assert np.abs(position - found(arm((), -40.0, pinned=pinned), TIME)).max() > 1e-3
