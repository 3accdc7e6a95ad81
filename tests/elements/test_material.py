"""Material that relaxes: closed forms, energy balance, gradients, batches."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.dynamics import Relaxing, System, find_relaxing_modes
from crinoid.elements import Material
from crinoid.elements.loads import TipLoad
from crinoid.elements.material import Strained, branches_of_loss_factor
from helpers.arms import always, arm
from helpers.motion import gain, march_with_books, natural_frequencies

RATIO, TIME = np.array([0.4, 0.2]), np.array([1.5, 0.05])
DAMPING = 0.003
both = pytest.mark.parametrize("axes", [2, pytest.param(3, marks=pytest.mark.release)])


def bar(axes, relaxation=(RATIO, TIME), **more):
    stiff = {"EI": 1.0 if axes == 2 else (1.0, 1.0), "GJ": 0.7, "EA": 1e3}
    return arm(
        axes=axes,
        nodes=5,
        radius=0.02,
        relaxation=relaxation,
        **stiff | {"damping_time": DAMPING} | more,
    )


def at_rest(system):
    return jnp.zeros(len(system.inputs))


@eqx.filter_jit
def state_matrix(system, step):
    system = eqx.tree_at(lambda s: s.time_step, system, step)
    return System.transition(system, system.rest(), jnp.zeros(len(system.inputs))).A


def poles(system, step):
    """Return the poles of small motions of an arm at rest (1/s)."""
    z = np.linalg.eigvals(state_matrix(system, jnp.asarray(step)))
    return np.log(z[np.abs(z) > 1e-9].astype(complex)) / step


def exact_poles(frequency, ratio, time, damping_time):
    """Return the poles of a mode whose spring is the material: q'' + w^2 (q + T q' + b) = 0."""
    matrix = np.zeros((2 + len(ratio),) * 2)
    matrix[0, 1] = 1.0
    matrix[1] = [-1.0, -damping_time, *np.full(len(ratio), -1.0)]
    matrix[1] *= frequency**2
    matrix[2:, 1] = ratio
    matrix[2:, 2:] = -np.diag(1 / time)
    return np.linalg.eigvals(matrix)


def farthest(found, exact):
    """Return the largest relative error of the found pole next to each exact one."""
    return max(np.min(np.abs(found - pole)) / abs(pole) for pole in exact)


@both
@pytest.mark.release
def test_small_motions_have_the_poles_of_the_material_to_second_order(axes):
    elastic = bar(axes, None)
    frequency = 2 * np.pi * natural_frequencies(elastic, elastic.rest())[0]
    exact = exact_poles(frequency, RATIO, TIME, DAMPING)
    errors = [farthest(poles(bar(axes), step), exact) for step in (0.01, 0.005)]
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


@both
@pytest.mark.release
def test_modes_of_a_relaxing_arm_have_the_frequency_and_damping_of_the_material(axes):
    elastic, system = bar(axes, None), bar(axes)
    small = eqx.filter_jit(System.small_motions)(system, system.rest(), jnp.zeros(axes))
    relaxing = Relaxing(small.elastic, np.stack([RATIO, TIME]))
    count = 2 * (axes - 1)
    damped = small.stiffness_in_current, small.damping_in_current, small.mass
    found = find_relaxing_modes(relaxing, *damped, count)
    for index, frequency in enumerate(natural_frequencies(elastic, elastic.rest())[:count]):
        exact = exact_poles(2 * np.pi * frequency, RATIO, TIME, DAMPING)
        pole = exact[np.argmax(exact.imag)]
        assert 2 * np.pi * found.frequency[index] == pytest.approx(pole.imag, rel=1e-7)
        assert found.decay_rate[index] == pytest.approx(-pole.real, rel=1e-7)


@pytest.mark.release
def test_a_branch_that_relaxes_fast_is_kelvin_voigt_damping():
    # all with two branches, which one program has; a ratio of 0 is none
    none = 1e-9
    viscous = poles(bar(2, ([0.0, 0.0], [none, none]), damping_time=DAMPING + 0.02), 1e-4)
    slowest = viscous[np.argsort(np.abs(viscous))[:4]]
    # ratio * time = 0.02 s more of damping
    errors = [
        farthest(poles(bar(2, ([0.02 / time, 0.0], [time, none])), 1e-4), slowest)
        for time in (1e-3, 1e-8)
    ]
    assert errors[0] > 1e-3
    # a branch damps by the difference of strains over a step, half a step before its end
    assert errors[1] < 1e-3


def cycled(material, frequency, step):
    """Return storage and loss over the relaxed modulus, from a cycle after many."""
    memory = Strained(jnp.zeros(()), jnp.zeros(2))
    times = step * np.arange(1, 4001)

    def one(memory, strain):
        after = material.advance(strain, memory, jnp.asarray(step))
        return after, strain + jnp.sum(after.branches)

    strain = np.sin(frequency * times)
    _, stress = jax.lax.scan(one, memory, jnp.asarray(strain))
    last = slice(2000, None)
    waves = np.stack([np.sin(frequency * times[last]), np.cos(frequency * times[last])], axis=1)
    return np.linalg.lstsq(waves, np.asarray(stress)[last], rcond=None)[0]


@pytest.mark.parametrize("frequency", [2.0, 6.0, 20.0])
def test_storage_and_loss_modulus_are_those_of_the_branches(frequency):
    material = Material(jnp.zeros(()), jnp.asarray([[0.4, 0.3], [0.3, 0.02]]))
    turned = frequency * np.array([0.3, 0.02])
    storage = 1 + np.sum([0.4, 0.3] * turned**2 / (1 + turned**2))
    loss = np.sum([0.4, 0.3] * turned / (1 + turned**2))
    assert cycled(material, frequency, 2e-3) == pytest.approx([storage, loss], rel=1e-3)


@pytest.mark.parametrize("value", [1e-3, 0.1, 0.5, 1.0, 1.5])
@pytest.mark.parametrize("band", [(0.1, 10.0), (0.05, 20.0), (0.01, 1e4), (1.0, 1.1)])
def test_a_loss_factor_is_nearly_constant_over_its_band(value, band):
    ratio, time = branches_of_loss_factor(value, band)
    turned = 2 * np.pi * np.geomspace(*band, 50)[:, None] * time
    storage = 1 + np.sum(ratio * turned**2 / (1 + turned**2), axis=1)
    loss = np.sum(ratio * turned / (1 + turned**2), axis=1)
    np.testing.assert_allclose(loss / storage, value, rtol=0.01 if value <= 1 else 0.02)


def pulled(axes, relaxation=(RATIO, TIME), *, force, linear_drag, **more):
    """Build an arm with a force at its tip from the start, in viscous water.

    With other numbers it is another arm, of the same program.
    """

    def load(rod):
        dead = jnp.zeros(axes).at[-1].set(force)
        return TipLoad.of(rod, dead_force=dead, onset=always())

    return bar(axes, relaxation, loads=[load], linear_drag=linear_drag, **more)


@both
@pytest.mark.slow
def test_a_bent_arm_creeps_as_in_closed_form(axes):
    ratio, time, end = 0.5, 4.0, 4.0

    def moved(ratio):
        light = {"mass_per_length": 0.01, "force": 1e-3, "linear_drag": 0.5}
        # two branches, as below; a ratio of 0 is none
        system = pulled(axes, ([ratio, 0.0], [time, time]), time_step=0.005, **light)
        state, _, _ = march_with_books(system, at_rest(system), 0.005, round(end / 0.005))
        return float(state.position[-1, -1])

    # slow compared to the arm's own motion, the strain follows the creep of the material
    creep = 1 - ratio / (1 + ratio) * np.exp(-end / (time * (1 + ratio)))
    assert moved(ratio) / moved(0.0) == pytest.approx(creep, rel=0.01)


@both
@pytest.mark.slow
def test_the_energy_balance_of_a_relaxing_arm_closes(axes):
    bent = {"rest_curvature": 0.5 if axes == 2 else (0.4, 0.3, 0.5), "gravity": 2.0}
    system = pulled(axes, force=0.0, linear_drag=1e-300, **bent)
    state, account, converged = march_with_books(system, at_rest(system), 1e-3, 400)
    assert converged
    gained = gain(system, state)
    works = dict(zip(crinoid.elements.WORKS, account.work.tolist(), strict=True))
    assert works["damping"] < -1e-4
    assert float(gained) == pytest.approx(sum(works.values()), abs=2e-4 * -works["damping"])


@pytest.mark.release
def test_the_gradient_by_ratio_and_time_is_that_of_differences():
    def tip(ratio, time):
        system = bar(2, jnp.stack([ratio, time])[:, None], rest_curvature=0.5, gravity=2.0)

        def one(state, _):
            return system.step(state, at_rest(system))[0], None

        state = jax.lax.scan(one, system.rest(), None, length=20)[0]
        return state.position[-1, -1]

    # one program for the tip and its slopes
    tip = eqx.filter_jit(jax.value_and_grad(tip, (0, 1)))
    at = jnp.asarray(0.5), jnp.asarray(0.1)
    _, slopes = tip(*at)
    for index, slope in enumerate(slopes):
        step = 1e-4 * at[index]
        ends = [
            tip(*(x + sign * step * (i == index) for i, x in enumerate(at)))[0] for sign in (1, -1)
        ]
        assert float(slope) == pytest.approx(float((ends[0] - ends[1]) / (2 * step)), rel=1e-5)


@pytest.mark.release
def test_a_batch_over_the_branches_equals_single_runs():
    scenario = crinoid.Scenario(
        arm={"nodes": 4, "relaxation": [{"ratio": 0.5, "time": 0.4}]},
        base={"channels": {"heave": {}}},
        flow=[{"kind": "sine", "amplitude": [0.0, 0.2], "frequency_hz": 1.0}],
        control={"compare": False},
        simulation={"duration": 0.5, "time_step": 0.01, "start": "rest"},
    )
    ratios = [0.2, 1.0]
    batch = crinoid.simulate_batch(scenario, {"arm.relaxation.0.ratio": ratios}, records=True)
    tips = [
        crinoid.simulate(scenario.with_values({"arm.relaxation.0.ratio": ratio})).dataset[
            "tip_position"
        ]
        for ratio in ratios
    ]
    np.testing.assert_allclose(batch["tip_position"], tips, rtol=0, atol=1e-9)
    assert float(np.abs(tips[0] - tips[1]).max()) > 1e-5
