"""The spatial arm in time: frequencies, orders, energy, directions of the world, twist and writhe.

All arms here are of one make, so that their step is compiled once; what a test does without is
zero.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from crinoid.base import SineMotion, TableMotion
from crinoid.dynamics import Integrator, System, find_modes
from crinoid.elements import ENERGIES, WORKS, DistributedLoad, TipLoad
from crinoid.flow import Sine, Uniform
from crinoid.frames import tangents
from crinoid.onset import Onset
from crinoid.space import CHANNELS
from crinoid.spline import PiecewiseCubic
from physics import always, arm, facing, order

NODES = 9
CHUNK = 50
"""Steps of one compiled run."""
STILL = np.zeros(6)
ROLL = CHANNELS[3].index("roll")
TURN = 2 * np.pi

# --- how an arm is run: compiled once, whatever its numbers ------------------------------------


@eqx.filter_jit
def _rest(system, time):
    return system.rest(time)


def rest(system, time=0.0):
    return _rest(system, jnp.asarray(time))


@eqx.filter_jit
def _run(system, state, command, step):
    def once(state, _):
        state, outcome = system.step(state, command, step)
        return state, (state, outcome)

    return jax.lax.scan(once, state, None, length=CHUNK)[1]


def run(system, state, *, until, steps, command=STILL):
    """Return the states after each of equal steps, none of which may fail."""
    step = jnp.asarray((until - float(state.time)) / steps)
    parts = []
    assert steps % CHUNK == 0
    for _ in range(steps // CHUNK):
        states, outcomes = _run(system, state, jnp.asarray(command), step)
        assert outcomes.converged.all()
        state = jax.tree.map(lambda leaf: leaf[-1], states)
        parts.append(jax.tree.map(np.asarray, states))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def at(states, index):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[index]), states)


def channels(**given):
    """Return a number for each channel, zero if not given."""
    return jnp.asarray([given.get(name, 0.0) for name in CHANNELS[3]], float)


def spatial(
    *,
    swing=None,
    frequency=0.7,
    phase=0.3,
    rolled=((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (3.0, 0.0)),
    dead=(0.0, 0.0, 0.0),
    follower=(0.0, 0.0, 0.0),
    moment=(0.0, 0.0, 0.0),
    follower_moment=(0.0, 0.0, 0.0),
    tangential=0.0,
    normal=0.0,
    fixed=(0.0, 0.0, 0.0),
    onset=0.0,
    current=(0.0, 0.0, 0.0),
    swaying=(0.0, 0.0, 0.0),
    **properties,
):
    """Build a spatial arm in water, on a base that swings in all channels and rolls by a table.

    In the water a current is steady and another a sine of 1.3 Hz. Loads come on within the time
    ``onset`` (s).
    """
    number = jnp.asarray
    amplitudes = channels(**swing or {})
    motions = [
        SineMotion(i, amplitudes[i], number(frequency), number(phase * (i + 1)))
        for i in range(len(amplitudes))
    ]
    ramp = Onset.of(0.0, onset)
    settings = {"axes": 3, "nodes": NODES, "EA": 1e3, "GJ": 0.8, "water_density": 1000.0}
    return arm(
        loads=(
            lambda rod: DistributedLoad.of(
                rod, tangential=tangential, normal=normal, fixed=number(fixed), onset=ramp
            ),
            lambda rod: TipLoad.of(
                rod,
                dead_force=number(dead),
                follower_force=number(follower),
                moment=number(moment),
                follower_moment=number(follower_moment),
                onset=ramp,
            ),
        ),
        flows=(
            Uniform(always(), number(current, float)),
            Sine(always(), number(swaying, float), number(1.3), number(0.4)),
        ),
        motions=[*motions, TableMotion(ROLL, PiecewiseCubic(CubicSpline(*np.transpose(rolled))))],
        **settings | properties,
    )


def dry(**properties):
    """Build an arm in a vacuum."""
    return spatial(water_density=0.0, linear_drag=1e-300, **properties)
