"""Forces of shed vortices: fixed and forced cylinders, then whole arms.

The validation case `vortices-cylinder` has forced cylinders and those on springs.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.elements import Motion, Synchronisation, Vortices, WakeOscillator
from crinoid.elements.oscillators import Oscillation
from crinoid.flow import Uniform
from helpers.arms import always, arm
from helpers.motion import gain, march_with_books

DIAMETER, DENSITY, SPEED = 0.1, 1000.0, 0.5
SHEDDING = SPEED / DIAMETER
MODELS = {
    "synchronisation": (Synchronisation, 0.18, 0.08),
    "wake-oscillator": (WakeOscillator, 0.2, 12.0, 0.3),
}
each_model = pytest.mark.parametrize("model", MODELS)


def oscillator(model, harmonic):
    """Build the oscillators of one or more harmonics."""
    kind, *numbers = MODELS[model]
    return kind(*(jnp.full(jnp.shape(harmonic), number) for number in (harmonic, *numbers)))


def at(velocity=0.0, acceleration=0.0):
    direction, relative = jnp.ones(1), -jnp.asarray(velocity, float)[None]
    shedding, speed, diameter, acceleration = (
        jnp.asarray(x, float) for x in (SHEDDING, SPEED, DIAMETER, acceleration)
    )
    return Oscillation(shedding, speed, diameter, direction, relative, acceleration)


@eqx.filter_jit
def oscillated(oscillator, velocities, accelerations, step):
    """Return signal and phase of an oscillator at the ends of steps with a given motion."""

    def one(state, motion):
        state = oscillator.advance(state, at(*motion), step)
        return state, (oscillator.signal(state, jnp.zeros(())), oscillator.phase(state))

    state = oscillator.start(jnp.asarray(1.0), at())
    return jax.lax.scan(one, state, (velocities, accelerations))[1]


def on_fixed(model, harmonic):
    """Return the amplitude of the signal on a fixed cylinder, and its frequency (Hz)."""
    still = jnp.zeros(60_000)
    signal, phase = map(
        np.asarray, oscillated(oscillator(model, harmonic), still, still, jnp.asarray(1e-3))
    )
    turns = np.unwrap(phase)[30_000:] / (2 * np.pi)
    whole = np.floor(turns[-1] - turns[0])
    lasted = 1e-3 * np.interp(turns[0] + whole, turns, np.arange(turns.size))
    return np.abs(signal[30_000:]).max(), whole / lasted


def test_vortices_along_the_flow_have_twice_the_frequency_of_those_across():
    amplitude, frequency = on_fixed("synchronisation", 2.0)
    assert amplitude == pytest.approx(1.0, rel=1e-3)
    rate = np.sqrt(0.18**2 - 0.08**2)
    assert frequency == pytest.approx(2 * rate * SHEDDING, rel=1e-3)
    amplitude, frequency = on_fixed("wake-oscillator", 2.0)
    assert amplitude == pytest.approx(2.0014 / 2, rel=1e-3)
    assert frequency == pytest.approx(2 * 0.99442 * 0.2 * SHEDDING, rel=1e-3)


@pytest.mark.parametrize(
    ("low", "high"), [(0.095, 0.098), (0.105, 0.255), (0.262, 0.27)], ids=["below", "in", "above"]
)
def test_a_forced_cylinder_locks_in_between_centre_less_and_centre_plus_range(low, high):
    locked = []
    for share in (low, high):
        rate, step = 2 * np.pi * share * SHEDDING, 2e-3
        time = step * np.arange(1, 60_001)
        y = 0.5 * DIAMETER
        motion = y * rate * np.cos(rate * time), -y * rate**2 * np.sin(rate * time)
        _, phase = oscillated(
            oscillator("synchronisation", 1.0), *map(jnp.asarray, motion), jnp.asarray(step)
        )
        slipped = np.unwrap(np.asarray(phase)) - rate * time
        locked.append(np.ptp(slipped[30_000:]) < 1.0)
    assert locked == ([True, True] if low == 0.105 else [False, False])


@each_model
def test_a_frame_that_moves_and_speeds_up_with_the_water_changes_nothing(model):
    one = jax.tree.map(lambda x: x[0] if x.ndim else x, riser(model).forces.elements[-1])
    step, way = 0.05, np.array([0.3, 0.2, -0.1])

    def phases(frame):
        memory, found, rng = None, [], np.random.default_rng(3)
        for time in step * np.arange(1, 12):
            speed, rate = frame * np.sin(2 * time) * way, 2 * frame * np.cos(2 * time) * way
            swing = 0.03 * np.cos(7 * time) * rng.normal(size=(2, 3))
            motion = Motion(
                jnp.asarray([[0.0, 0.0, 0.0], [0.0, 0.1, 0.0]]),
                jnp.asarray(swing + speed),
                jnp.asarray(-7 * swing + rate),
                jnp.asarray([[0.2, 0.0, 0.05]] * 2 + speed),
                jnp.asarray([rate] * 2),
                jnp.asarray(time),
            )
            if memory is None:
                memory = one.steady(motion)
            held = one.prepared(memory, jnp.asarray(step))
            memory = one.advance(motion.remembering(held, jnp.asarray(step)))
            found.append(one.oscillator.phase(memory))
        return np.asarray(found)

    np.testing.assert_allclose(phases(5.0), phases(0.0), rtol=0, atol=1e-9)


def riser(model, axes=3, **more):
    """Build an arm that hangs in a current across it, with vortices."""

    def load(rod):
        edges = rod.rest_length.size
        return Vortices.of(
            rod,
            density=1000.0,
            coefficients=jnp.array([0.8, 0.1]),
            angles=jnp.asarray(np.random.default_rng(1).uniform(0, 6, (edges, 2))),
            oscillator=oscillator(model, jnp.array([1.0, 2.0])),
        )

    stiff = {"EI": 0.02 if axes == 2 else (0.02, 0.02), "GJ": 0.02, "EA": 200.0}
    return arm(
        axes=axes,
        nodes=6,
        length=0.5,
        diameter=0.04,
        displaced_area=np.pi * 4e-4,
        mass_per_length=1.35,
        water_density=1000.0,
        tilt=-np.pi / 2,
        flows=(Uniform(always(), jnp.eye(axes)[0] * 0.12),),
        loads=[load, *more.pop("loads", ())],
        damping_time=0.02,
        **stiff,
        **more,
    )


@each_model
@pytest.mark.slow
def test_the_energy_balance_of_an_arm_that_sheds_vortices_closes(model):
    system = riser(model)
    state, account, converged = march_with_books(system, jnp.zeros(6), 2e-3, 1000)
    assert converged
    gained = float(gain(system, state))
    assert gained == pytest.approx(float(jnp.sum(account.work)), abs=2e-3 * abs(gained))
    # across the current and out of the plane of arm and current
    assert float(jnp.abs(state.position[:, 1]).max()) > 1e-3


@pytest.mark.slow
def test_vortices_exert_no_force_in_an_equilibrium():
    shedding = riser("synchronisation", axes=2)
    # without coefficients, as without the element, there is none; that is the same program
    bare = eqx.tree_at(
        lambda s: s.forces.elements[-1].coefficients, shedding, replace_fn=jnp.zeros_like
    )
    expected = bare.equilibrium().position
    np.testing.assert_array_equal(shedding.equilibrium().position, expected)
    # the current bends the arm, which hangs straight at rest
    assert float(jnp.ptp(expected[:, 0])) > 1e-3


def forward(function):
    return lambda at: jax.jvp(function, (at,), (jnp.ones(()),))


@pytest.mark.parametrize(
    ("model", "way"),
    [("synchronisation", forward), ("wake-oscillator", jax.value_and_grad)],
    ids=["synchronisation, forward", "wake-oscillator, backward"],
)
@pytest.mark.slow
def test_the_gradient_by_the_lift_is_that_of_differences(model, way):
    system = riser(model)

    def tip(lift):
        changed = eqx.tree_at(
            lambda s: s.forces.elements[-1].coefficients,
            system,
            jnp.tile(jnp.stack([lift, 0.1 * lift]), (5, 1)),
        )
        state = changed.rest()
        state = jax.lax.scan(
            lambda state, _: (changed.step(state, jnp.zeros(6))[0], None), state, None, length=30
        )[0]
        return state.position[-1, 1]

    # one program for the tip and its slope
    tip, lift = eqx.filter_jit(way(tip)), 0.7
    slope = tip(jnp.asarray(lift, float))[1]
    ends = [float(tip(jnp.asarray(lift * (1 + sign * 1e-4), float))[0]) for sign in (1, -1)]
    assert float(slope) == pytest.approx((ends[0] - ends[1]) / (2e-4 * lift), rel=1e-5)


SCENARIO = crinoid.Scenario(
    arm={"dimension": 3, "nodes": 4},
    base={"tilt_deg": -90.0, "channels": {"heave": {}}},
    flow=[{"kind": "uniform", "velocity": [0.12, 0.0, 0.0]}],
    water={"vortices": {}},
    control={"kind": "none"},
    simulation={"duration": 0.5, "time_step": 0.01, "start": "rest"},
)


@pytest.mark.release
def test_a_batch_equals_single_runs_and_a_seed_is_another_start():
    batch = crinoid.simulate_batch(SCENARIO, seeds=[0, 1], records=True)
    runs = [crinoid.simulate(SCENARIO.with_values({"seed": seed})).dataset for seed in (0, 1)]
    for name in ("tip_position", "vortex_force"):
        alone = [run[name] for run in runs]
        np.testing.assert_allclose(batch[name], alone, rtol=0, atol=1e-9)
    force = runs[0]["vortex_force"]
    assert float(np.abs(force - runs[1]["vortex_force"]).max()) > 0.01
    # 1/2 rho D U^2 times at most the root of both coefficients' squares
    assert 0.2 < float(np.sqrt((force**2).sum("axis")).max()) < 0.24


def test_numbers_of_another_model_are_refused():
    calm = SCENARIO.with_values({"water.vortices.model": "none", "water.vortices.centre": 0.2})
    assert calm.water.vortices is None
    with pytest.raises(crinoid.ScenarioError, match=r"water.vortices.strouhal: is no number of"):
        SCENARIO.with_values({"water.vortices.strouhal": 0.2})
    with pytest.raises(crinoid.ScenarioError, match=r"range: got 0.2; must be below centre = 0.18"):
        SCENARIO.with_values({"water.vortices.range": 0.2})


@pytest.mark.slow
def test_an_arm_towed_through_still_water_moves_as_one_held_in_a_current():
    # as heavy as water, whose acceleration then pushes the arm as its own inertia would
    neutral = SCENARIO.with_values(
        {"arm.density": 1025.0, "simulation.duration": 2.0, "simulation.time_step": 0.0025}
    )
    current = {"kind": "uniform", "velocity": [0.0, 0.15, 0.0], "ramp_time": 1.0}
    tow = {"kind": "velocity", "channel": "sway", "velocity": -0.15, "ramp_time": 1.0}
    held = crinoid.simulate(neutral.with_values({"flow": [current]})).dataset
    towed = neutral.with_values({"flow": [], "base.motion": [tow]})
    towed = crinoid.simulate(towed).dataset
    shapes = [each["position"] - each["position"].isel(node=0) for each in (held, towed)]
    np.testing.assert_allclose(*shapes, rtol=0, atol=1e-6)
    across = shapes[0].isel(node=-1).sel(axis="x")
    assert float(np.abs(across).max()) > 1e-4
