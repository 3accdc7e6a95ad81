"""Arms that move: one make for each number of axes, and how they are run.

What a test does without is zero, so that the step of each make is compiled once.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from crinoid.base import SineMotion, TableMotion
from crinoid.dynamics import EnergyAccount, System, find_modes
from crinoid.elements import DistributedLoad, TipLoad, Tool
from crinoid.flow import PowerShear, Sine, Uniform
from crinoid.foundation.axes import CHANNELS
from crinoid.numerics.piecewise import PiecewisePolynomial
from crinoid.numerics.ramp import Onset
from helpers.arms import QUICKLY, Kept, always, arm

NODES = {2: 11, 3: 9}
CHUNK = 50
"""Steps of one compiled run."""


# --- makes of arms -----------------------------------------------------------------------------


def vector(axes, x, z, y=0.0):
    """Return a vector of the world; in the plane without its part across it."""
    return np.array([x, z] if axes == 2 else [x, y, z], float)


def submerged(
    axes,
    *,
    swing=None,
    frequency=0.7,
    phase=0.3,
    paths=None,
    dead=None,
    follower=None,
    moment=None,
    follower_moment=None,
    tangential=0.0,
    normal=0.0,
    fixed=None,
    onset=(),
    current=None,
    swaying=None,
    shear=(0.0, 0.0),
    depth=0.0,
    tool=0.0,
    **properties,
):
    """Build an arm in water, on a base that swings in its channels and follows paths.

    In the water a current is steady and another a sine of 1.3 Hz; in the plane a third grows from
    the bed, 5 m below. ``onset`` is that of the loads. ``tool`` is the share of a `body` at the
    tip.
    """
    number, none = jnp.asarray, np.zeros(axes)
    motions = []
    for i, name in enumerate(CHANNELS[axes]):
        amplitude, lead = (swing or {}).get(name, 0.0), phase * (CHANNELS[3].index(name) + 1)
        motions.append(SineMotion(i, *(number(x, float) for x in (amplitude, frequency, lead))))
        time, path = (paths or {}).get(name, ((0.0, 1.0, 2.0, 3.0), np.zeros(4)))
        knots = np.linspace(time[0], time[-1], 41)  # as many for all: they are compiled once
        table = CubicSpline(knots, CubicSpline(time, path)(knots))
        motions.append(TableMotion(i, PiecewisePolynomial(table)))
    flows = [
        Uniform(always(), number(none if current is None else current, float)),
        Sine(
            always(), number(none if swaying is None else swaying, float), number(1.3), number(0.4)
        ),
    ]
    if axes == 2:
        heights = map(number, (5.0, -depth - 5.0, 1.0 / 7.0))
        flows.append(PowerShear(always(), number(shear, float), *heights))
    given = (fixed, dead, follower, moment, follower_moment)
    spread, *tip = (None if load is None else number(load, float) for load in given)
    names = ("dead_force", "follower_force", "moment", "follower_moment")
    ramp = Onset.of(*onset)
    settings = {
        "axes": axes,
        "nodes": NODES[axes],
        "EA": {2: 1e4, 3: 1e3}[axes],
        "GJ": 0.8,
        "water_density": 1000.0,
        "origin": vector(axes, 0.0, -depth),
    }
    return arm(
        loads=(
            lambda rod: DistributedLoad.of(
                rod, tangential=tangential, normal=normal, fixed=spread, onset=ramp
            ),
            lambda rod: TipLoad.of(rod, **dict(zip(names, tip, strict=True)), onset=ramp),
            lambda rod: body(rod, tool),
        ),
        flows=flows,
        motions=motions,
        **settings | properties,
    )


def body(rod, share):
    """Build a share of a tool that has all that one may have."""
    inertia = 2e-3 if rod.axes == 2 else jnp.array([1e-3, 2e-3, 3e-3])
    return Tool.of(
        rod,
        mass=0.2 * share,
        inertia=share * inertia,
        density=1000.0 * share,
        gravity=9.81 * share,
        volume=5e-5,
        added_mass=0.05 * share,
        drag_area=2e-3,
        offset=0.05,
    )


def dry(axes, **properties):
    """Build an arm in a vacuum."""
    return submerged(axes, water_density=0.0, linear_drag=1e-300, **properties)


def carried(axes, speed=None, acceleration=None, **properties):
    """Build an arm under water on a base that moves along a straight line, from rest or not."""
    none, time = np.zeros(axes), np.arange(-1.0, 4.0)
    shifts = CHANNELS[axes][:axes]
    given = (none if rate is None else rate for rate in (speed, acceleration))
    paths = {
        name: (time, v * time + 0.5 * a * time**2)
        for name, v, a in zip(shifts, *given, strict=True)
    }
    return submerged(axes, paths=paths, **properties)


def everything(axes, **changes):
    """Build an arm on which everything acts at once."""
    plane = {
        "EA": 1e3,
        "shear": (0.5, 0.1),
        "swing": {"slide": 0.03, "heave": 0.05, "tilt": 0.2},
        "moment": 0.1,
        "follower_moment": 0.05,
    }
    space = {
        "EI": (0.8, 1.3),
        "rest_curvature": (0.5, -0.7, 1.1),
        "radius": 0.2,
        "current": (0.3, -0.4, 0.1),
        "swing": {
            "slide": 0.03,
            "sway": -0.05,
            "heave": 0.04,
            "pan": 0.2,
            "tilt": -0.15,
            "roll": 0.4,
        },
        "paths": {"roll": ((0.0, 1.0, 2.0, 3.0), (0.0, 2.0, 1.0, 4.0))},
        "moment": (0.1, 0.05, -0.2),
        "follower_moment": (0.2, -0.1, 0.1),
        "pan": 0.4,
        "tilt": 0.2,
        "roll": -0.6,
    }
    both = {
        "damping_time": 0.05,
        "gravity": 9.81,
        "displaced_area": 8e-4,
        "diameter": 0.032,
        "added_mass_tangential": 0.2,
        "linear_drag": 0.5,
        "tolerance": 1e-12,
        "swaying": vector(axes, 0.2, -0.4, y=0.3),
        "onset": (0.0, 0.4),
        "tangential": 0.1,
        "normal": 0.3,
        "fixed": vector(axes, 0.2, 0.3, y=-0.2),
        "dead": vector(axes, 0.2, 0.6, y=0.4),
        "follower": vector(axes, 0.1, 0.3, y=-0.2),
    }
    return submerged(axes, **both | (plane if axes == 2 else space) | changes)


# --- how an arm is run: compiled once for each make, whatever its numbers ----------------------


@eqx.filter_jit(compiler_options=QUICKLY)
def _rest(system, time):
    return Kept.of(system, system.rest(time))


def rest(system, time=0.0):
    return _rest(system, jnp.asarray(time))


def _command(system, command):
    return jnp.zeros(len(system.inputs)) if command is None else jnp.asarray(command, float)


@eqx.filter_jit
def _run(system, state, command, step):
    def once(state, _):
        state, outcome = state.step(system, command, step)
        return state, (state, outcome)

    return jax.lax.scan(once, state, None, length=CHUNK)[1]


def watch(system, state, *, until, steps, command=None):
    """Return the states after each of equal steps, none of which may fail, and how they went."""
    step = jnp.asarray((until - float(state.time)) / steps, float)
    parts = []
    assert steps % CHUNK == 0
    for _ in range(steps // CHUNK):
        states, outcomes = _run(system, state, _command(system, command), step)
        assert outcomes.converged.all()
        state = at(states, -1)
        parts.append(jax.tree.map(np.asarray, (states, outcomes)))
    assert float(state.time) == pytest.approx(until, rel=1e-12)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def run(system, state, **how):
    """Return the states after each of equal steps, none of which may fail."""
    return watch(system, state, **how)[0]


def march(system, state, **how):
    """Return the state after equal steps, none of which may fail."""
    return at(run(system, state, **how), -1)


def at(states, index):
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[index]), states)


@eqx.filter_jit
def wrench(states):
    """Return force and moment on the base in each of many states."""
    return states.base_force, states.base_moment


def whole_step(system, state, step):
    """Return the state after one step that is not cut, and how it went."""
    return at(_run(system, state, _command(system, None), jnp.asarray(step, float)), 0)


@eqx.filter_jit(compiler_options=QUICKLY)
def _advance(system, state, step):
    return state.advance(system, _command(system, None), step)


def advance(system, state, step):
    """Return the state after a step, cut where it must be, and how it went."""
    return _advance(system, state, jnp.asarray(step, float))


@eqx.filter_jit
def _march_with_books(system, command, step, steps):
    def tick(_, carry):
        *before, converged = carry
        state, account, progress = system.advance_with_account(*before, command, step)
        return state, account, converged & progress.outcome.converged

    state = system.rest()
    start = (state, EnergyAccount.of(system.forces, state), jnp.asarray(True))
    return jax.lax.fori_loop(0, steps, tick, start)


@eqx.filter_jit
def gain(system, state):
    """Return what energy an arm has gained since it was at rest."""
    return jnp.sum(system.energy(state)) - jnp.sum(system.energy(system.rest()))


def march_with_books(system, command, step, steps):
    """Return state and books after steps from rest, and whether all of these converged."""
    return _march_with_books(system, command, jnp.asarray(step), jnp.asarray(steps))


# --- vibration ---------------------------------------------------------------------------------


@eqx.filter_jit(compiler_options=QUICKLY)
def linearise(system):
    """Return stiffness and mass of an arm at rest."""
    return system.linearise(system.rest())


def natural_frequencies(system, state, count=8):
    """Return the natural frequencies of an arm without lines about a state (Hz)."""
    matrices = eqx.filter_jit(System.linearise)(system, state)
    return find_modes(*matrices, count).frequency


def vibrations(system, column):
    """Return circular frequencies (rad/s) and shapes of a straight arm's modes in one column."""
    modes = find_modes(*linearise(system), 14)
    size = np.abs(modes.shape).max(axis=1)
    chosen = size[:, column] > 0.99
    others = np.delete(size[chosen], column, axis=1)
    np.testing.assert_allclose(others, 0, atol=1e-6)
    return 2 * np.pi * modes.frequency[chosen], modes.shape[chosen]


def ring_down(system, column, mode, step=0.2):
    """Return frequency (rad/s) and pole (1/s) with which one mode of small amplitude rings.

    The trapezoid rule maps a pole ``s`` to ``z = (1 + s h / 2) / (1 - s h / 2)`` exactly (Tustin),
    so undoing that map leaves no error of the time step. ``z`` comes from the two-term recurrence
    of the tip's motion, which is the logarithmic decrement and the period in one.
    """
    frequencies, shapes = vibrations(system, column)
    frequency, shape = frequencies[mode], shapes[mode]
    # so slow that the nonlinear terms are 1e-6 of the linear
    velocity = np.concatenate([np.zeros((1, shape.shape[1])), 1e-3 * shape])
    # Kelvin-Voigt damping of a mode is damping_time omega^2 times its velocity
    slowing = -float(system.forces.bend.material.damping_time[0]) * frequency**2 * velocity
    state = eqx.tree_at(
        lambda s: (s.motion.velocity, s.motion.acceleration),
        rest(system),
        (jnp.asarray(velocity), jnp.asarray(slowing)),
    )
    step = step / frequency
    tip = run(system, state, until=200 * step, steps=200).motion.position[:, -1, column]
    (twice, minus), *_ = np.linalg.lstsq(np.stack([tip[1:-1], tip[:-2]], 1), tip[2:], rcond=None)
    z = np.roots([1.0, -twice, -minus])
    s = 2.0 / step * (z - 1.0) / (z + 1.0)
    return frequency, complex(s[np.argmax(s.imag)])
