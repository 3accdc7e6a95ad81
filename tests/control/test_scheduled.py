"""Predictive control on models of several poses of the base: near and far from where it starts."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.plan import find_state
from crinoid.base import Base, Servo
from crinoid.control import HorizonQp, RigidRotationCorrection
from crinoid.dynamics import numbers_of
from crinoid.results.errors import tip_error
from crinoid.simulation import closed_loop

SHORT = ("arm.nodes=9", "control.compare=false", 'control.kind="mpc"')
SCHEDULED = 'control.mpc.model="scheduled"'
CALM = "flow.0.intensity=1e-4"
FAR = ("base.tilt_deg=-20", "target.radius=0.25", "base.channels.slide.range=[-0.7, 0.7]")
FAR_IN_SPACE = (
    *("target.radius=0.2", "base.channels.pan.range_deg=[-90, 90]"),
    "water.vortices.model=none",  # at rest the arm stays where it is
)


def loop_of(name: str, *settings: str):
    return closed_loop(crinoid.load(name, [*SHORT, *settings]))


@eqx.filter_jit
def seen_at(loop, state):
    carry = loop.start(state)
    seen = loop.seen(carry.state, carry.sensors, carry.command)
    return eqx.tree_at(lambda each: each.measurement_time, seen, seen.time)


command = eqx.filter_jit(lambda controller, memory, seen: controller.command(memory, seen))


def with_reading(seen, measured, tick):
    """Return what a controller sees at a tick of 0.01 s where another pose is measured."""
    where = lambda each: (each.measured, each.measurement_time, each.time)  # noqa: E731
    return eqx.tree_at(where, seen, (measured, *(jnp.asarray(0.01 * tick),) * 2))


@pytest.fixture(scope="module")
def far():
    return loop_of("trace-circle", SCHEDULED, CALM, "sensor.delay=0", *FAR)


@pytest.mark.slow
def test_at_its_model_it_commands_what_the_frozen_model_does():
    found = []
    for model in ("frozen", "scheduled"):
        loop, state = loop_of("station-keeping", f'control.mpc.model="{model}"')
        controller, seen = loop.controller, seen_at(loop, state)
        begin, memory, given = seen.measured, controller.start(seen), []
        for tick in range(8):
            measured = begin + 1e-3 * jnp.sin(jnp.array([1.0, 2.0, 3.0]) * (tick + 1))
            moved, memory = command(controller, memory, with_reading(seen, measured, tick))
            seen = eqx.tree_at(lambda each: each.command, seen, moved)
            given.append(moved)
        found.append(np.array(given))
    assert controller.around.shape[0] == 1
    assert np.abs(found[0]).max() > 1e-4
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-12)


@pytest.mark.release
def test_far_away_it_predicts_the_arm_better_than_the_model_of_the_start():
    # in space; in the plane it follows a wide circle, below
    given = SCHEDULED, CALM, "sensor.delay=0", "arm.nodes=7", *FAR_IN_SPACE
    loop, _ = loop_of("trace-circle-3d", *given)
    controller, system = loop.controller, loop.system
    farthest = int(np.argmax(np.linalg.norm(controller.turns * controller.at, axis=1)))
    at, turning = controller.at[farthest], system.base.angles.shape[0]
    assert np.linalg.norm(at) > 0.5
    turned = eqx.tree_at(lambda each: each.base.angles, system, system.base.angles + at[-turning:])
    arm, outcome = find_state(turned, True)
    assert outcome.converged
    begin = eqx.tree_at(lambda each: each.servo.position, arm, at)
    step = eqx.filter_jit(lambda state, command: system.step(state, command)[0])
    # an arm whose base is set so stands as one whose servos have turned it
    around = controller.around[farthest]
    stayed = np.asarray(system.tip(step(begin, around)))
    assert stayed == pytest.approx(np.asarray(system.tip(begin)), abs=1e-6)
    axes, pushed = system.base.axes, around + 0.02 * (controller.turns + (around.size == 3))
    truth, actuators, state = [], [], begin
    for _ in range(25):
        state = step(state, pushed)
        truth.append(np.asarray(system.tip(state) - system.tip(begin))[:axes])
        actuators.append(numbers_of((state.servo, *state.actuators))[0])
    rest = numbers_of((begin.servo, *begin.actuators))[0]
    errors = []
    for model in (farthest, 0):
        observer = jax.tree.map(lambda each, model=model: each[model], controller.models.observer)
        kept = np.array(observer.kept)
        z, before, tips = np.zeros(observer.move.shape[0]), np.zeros(kept.size), []
        for each in actuators:
            now = np.asarray(each - rest)[kept]
            z = observer.move @ z + observer.held @ before + observer.driven @ now
            tips.append((observer.expect @ z + observer.follow @ now)[:axes])
            before = now
        errors.append(np.abs(np.array(tips) - truth).max())
    assert errors[0] < 0.1 * np.abs(truth).max()
    assert errors[0] < 0.25 * errors[1]


@pytest.mark.slow
def test_weights_are_one_at_a_model_and_add_up(far):
    weigh = jax.jit(jax.vmap(far[0].controller.weights))
    at = far[0].controller.at
    assert np.diag(weigh(at)) == pytest.approx(1.0, abs=1e-9)
    drawn = np.random.default_rng(0).normal(size=(20, at.shape[1]))
    weights = np.asarray(weigh(drawn))
    assert weights.sum(axis=1) == pytest.approx(np.ones(20))
    # a shift changes nothing
    drawn[:, :2] += 0.3
    assert weigh(drawn) == pytest.approx(weights)


@pytest.mark.release
def test_commands_keep_to_the_limits_for_any_reading(far):
    loop, state = far
    controller, start, draw = loop.controller, seen_at(loop, state), np.random.default_rng(1)
    braking, rows = controller.models.qp.braking, list(controller.models.rows)
    rate, acceleration = (np.asarray(each[0]) for each in (braking.rate, braking.acceleration))
    memory, seen, moving, met = controller.start(start), start, np.zeros(len(rows)), 0
    for tick in range(60):
        measured = start.measured + draw.normal(size=3)
        moved, memory = command(controller, memory, with_reading(seen, measured, tick))
        assert np.all((moved >= start.lower - 1e-12) & (moved <= start.upper + 1e-12))
        move = np.asarray(moved - seen.command)[rows]
        assert np.all(np.abs(move) <= rate * (1 + 1e-9))
        assert np.all(np.abs(move - moving) <= acceleration * (1 + 1e-9))
        met += bool(np.any(np.abs(move - moving) >= acceleration * (1 - 1e-6)))
        moving, seen = move, eqx.tree_at(lambda each: each.command, seen, moved)
    assert met  # the limits were


@pytest.mark.slow
def test_commands_have_slopes_and_come_in_batches(far):
    loop, state = far
    controller, seen = loop.controller, seen_at(loop, state)
    memory = controller.start(seen)

    def of(away):
        measured = seen.measured + away
        given, _ = controller.command(memory, eqx.tree_at(lambda x: x.measured, seen, measured))
        return given, given

    # slope and commands by one program, which the differences use too
    one, small = jax.jit(jax.jacrev(of, has_aux=True)), 1e-7
    away = 1e-3 * jnp.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.5]])
    each = np.stack([one(pushed)[1] for pushed in away])
    assert jax.jit(jax.vmap(of))(away)[0] == pytest.approx(each, abs=1e-12)
    slope = np.asarray(one(away[1])[0])
    assert np.isfinite(slope).all()
    for column, shift in enumerate(small * jnp.eye(3)[:2]):
        between = np.asarray(one(away[1] + shift)[1] - one(away[1] - shift)[1]) / (2 * small)
        assert slope[:, column] == pytest.approx(between, rel=1e-3)


@pytest.mark.release
def test_it_follows_a_wide_circle_on_which_the_frozen_model_is_lost():
    errors = {}
    for model in ("frozen", "scheduled"):
        given = [*SHORT, *FAR, f'control.mpc.model="{model}"', "simulation.duration=5"]
        result = crinoid.simulate(crinoid.load("trace-circle", given))
        assert result.dataset.attrs["status"] == "ok"
        errors[model] = tip_error(result).rms
    assert errors["scheduled"] < 0.3 * errors["frozen"]


def test_a_blend_of_programs_is_the_program_of_the_sum():
    def program(hessian):
        return HorizonQp.of(hessian, rate=np.ones(2), acceleration=np.ones(2), lengths=np.ones(6))

    draw = np.random.default_rng(3)
    squares = [draw.normal(size=(20, 12)) * size for size in (1.0, 7.0)]
    hessians = [(each.T @ each).reshape(2, 6, 2, 6) for each in squares]
    stacked = jax.tree.map(lambda *each: jnp.stack(each), *map(program, hessians))
    blend = stacked.blended(jnp.array([0.3, 0.7]))
    whole = program(0.3 * hessians[0] + 0.7 * hessians[1])
    for found, wanted in zip(jax.tree.leaves(blend), jax.tree.leaves(whole), strict=True):
        assert np.asarray(found) == pytest.approx(np.asarray(wanted), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("axes", [2, 3])
def test_a_rigid_arm_turns_with_its_base(axes):
    turns = 1 if axes == 2 else 3
    none = jnp.zeros(axes + turns)
    base = Base(0.3 * jnp.arange(1.0, 1 + turns), jnp.asarray(0.1), Servo(*[none] * 5), ())
    pointing = jnp.zeros(1) if axes == 2 else base.direction(none)
    slopes = jnp.zeros((axes + pointing.size, none.size))
    free = RigidRotationCorrection(base, 0.5 * base.direction(none), pointing, slopes)
    slope = jax.jacfwd(free.swung)(none)
    turned = eqx.tree_at(lambda each: each.slope, free, slope)
    assert jax.jacfwd(turned)(none) == pytest.approx(np.zeros(slope.shape), abs=1e-12)
    far = none.at[axes:].set(jnp.array([0.4, -0.7, 0.2])[:turns])
    moved = np.asarray(0.5 * (base.direction(far) - base.direction(none)))
    expected = [*moved, 0.4] if axes == 2 else [*moved, *2 * moved]
    assert turned(far) + slope @ far == pytest.approx(np.array(expected), abs=1e-12)
    assert np.abs(turned(far)[:axes]).max() > 1e-2


def test_models_of_several_poses_allow_no_forecast():
    with pytest.raises(crinoid.ScenarioError, match=r"control.mpc.model: .*current = \"unknown\""):
        crinoid.load("trace-circle", [*SHORT, SCHEDULED, 'control.mpc.current="known"'])
