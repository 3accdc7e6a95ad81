"""Numbers of step responses, against formulas and python-control."""

import jax.numpy as jnp
import numpy as np
import pytest

import control
import crinoid
from crinoid.control import Controller
from crinoid.results.metrics import MEASURES
from crinoid.results.result import Result
from crinoid.results.step_response import load_response, step_response, target_response
from helpers.made_results import of_values

TIME = np.linspace(0.0, 20.0, 2001)
HELD = {"control": {"kind": "pid", "pid": {"slide": {"ki": 1.0}}, "controlled": ["x"]}}
PUSH = {"kind": "tip", "force": [1.0, 0.0]}


def second_order(time, damping, natural):
    """Return the unit step response of a second-order system, 0 before the step."""
    since, root = np.maximum(time, 0.0), np.sqrt(1 - damping**2)
    phase = natural * root * since
    swing = np.cos(phase) + damping / root * np.sin(phase)
    return 1 - np.exp(-damping * natural * since) * swing


def made(tip=0.0, target=0.0, angle=0.0, angle_target=0.0, **keys):
    """Make a planar result of a tip and a target that move along x and turn."""
    zero = np.zeros_like(TIME)
    values = {"arm.length": 1.0, "base.channels.slide": {}, "simulation.duration": 20.0}
    scenario = crinoid.Scenario().with_values(values | keys)
    along = {"tip_position": tip, "tip_target": target}
    run = of_values(
        2,
        TIME,
        np.zeros(2),
        np.ones(2),
        **{name: np.stack([zero + each, zero], axis=1) for name, each in along.items()},
        tip_angle=zero + angle,
        tip_angle_target=zero + angle_target,
    )
    attrs = {"title": "made", "scenario": scenario.to_toml(), "status": "ok"}
    return Result(run.assign_attrs(attrs))


def after(begin, size=1.0, damping=0.4):
    return size * second_order(TIME - begin, damping, 4.0)


@pytest.mark.parametrize("damping", [0.2, 0.5, 0.9])
def test_a_second_order_response_has_the_numbers_of_its_formula_and_of_python_control(damping):
    time = np.linspace(0.0, 20.0, 20001)
    covered = second_order(time, damping, 4.0)
    found = target_response(time, covered)
    exact = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert found.overshoot == pytest.approx(exact, rel=1e-3)
    info = control.step_info(covered, T=time)
    assert found.rise_time == pytest.approx(info["RiseTime"], rel=0.01)
    assert found.settling_time == pytest.approx(info["SettlingTime"], rel=0.01)
    # a load that bends the arm by 3 cm for good
    bent = load_response(time, covered[:, None] * [0.018, -0.024], 1e-6)
    np.testing.assert_allclose(bent, found, rtol=1e-9)


def test_numbers_are_between_saved_instants():
    found = target_response(TIME, np.minimum(1.0, TIME / 0.455))
    assert found == pytest.approx((0.8 * 0.455, 0.0, 0.98 * 0.455), rel=1e-9)


def test_a_loop_that_keeps_an_error_settles_at_its_own_final_value():
    whole, part = (target_response(TIME, share * after(0.0)) for share in (1.0, 0.6))
    np.testing.assert_allclose(part, whole, rtol=1e-12)
    assert target_response(TIME, 0.01 * after(0.0)) is None  # it did not follow


def test_a_swing_in_the_last_tenth_is_not_settled():
    swings = after(0.0) + 0.03 * np.sin(7.0 * TIME)
    assert target_response(TIME, swings).settling_time is None
    assert target_response(TIME, swings).rise_time is not None


def test_control_that_brings_the_tip_back_from_a_load_has_a_settling_time_alone():
    found = load_response(TIME, np.stack([TIME * np.exp(-TIME), 0 * TIME], axis=1), 1e-6)
    # t exp(1 - t) falls to 2 % of its largest value
    assert found == (None, None, pytest.approx(6.8354, rel=1e-3))
    assert load_response(TIME, np.zeros((TIME.size, 2)), 1e-6) is None


@pytest.mark.parametrize(
    ("run", "begin"),
    [
        # a target that jumps, twice; the tip is at the first point from the start
        ((after(2.0, 0.1) + after(8.0, 0.2), 0.1 * (TIME > 2) + 0.2 * (TIME > 8), HELD), 8.0),
        # a controller that switches on away from its target
        ((after(3.0, 0.1), 0.1, HELD | {"control.start": 3.0}), 3.0),
        # a load that starts for good, and one that the arm is in equilibrium with and lets go
        ((after(4.0, 0.1), 0.0, {"load": [PUSH | {"start": 4.0}]}), 4.0),
        ((after(5.0, 0.1), 0.0, {"load": [PUSH | {"stop": 5.0}]}), 5.0),
    ],
)
def test_the_last_step_counts_from_its_time(run, begin):
    tip, target, keys = run
    found = step_response(made(tip, target, **keys))
    since = TIME - begin
    since = since[since > -1e-9]
    np.testing.assert_allclose(found, target_response(since, second_order(since, 0.4, 4.0)), 1e-3)


@pytest.mark.parametrize(
    ("tip", "target", "keys"),
    [
        (0.001 * np.sin(TIME), 0.0, HELD),  # it stays where it is
        (after(2.0, 0.1), 0.1 * (TIME > 2), {}),  # nothing follows the target
        (after(2.0, 0.1), 0.1 * np.sin(TIME), HELD),  # a path
        (after(2.0, 0.1), 0.1 * np.clip(TIME - 2, 0, 10) / 10, HELD),  # longer than it holds
        (after(2.0, 0.1), 0.1 * (TIME > 2), HELD | {"target.judged_from": 3.0}),
        (after(2.0, 0.1), 0.0, {"load": [PUSH | {"start": 2.0, "stop": 2.2}]}),  # a push
        (after(2.0, 0.1), 0.0, {"load": [PUSH]}),  # in equilibrium with it
    ],
)
def test_a_run_without_a_step_has_no_such_numbers(tip, target, keys):
    run = made(tip, target, **keys)
    names = ("rise_time", "overshoot", "settling_time")
    assert [MEASURES[name].of(run) for name in names] == [None] * 3


def test_the_next_change_ends_a_response():
    # from 10 s on a push bends the arm, which the response to the target leaves out
    tip = after(2.0, 0.1) + after(10.0, 5.0)
    push = HELD | {"load": [PUSH | {"start": 10.0, "stop": 11.0}]}
    found = step_response(made(tip, 0.1 * (TIME > 2), **push))
    since = TIME[:801]  # 8 s
    np.testing.assert_allclose(found, target_response(since, second_order(since, 0.4, 4.0)), 1e-3)


def test_a_target_that_only_turns_steps_in_its_angle():
    turns = {"control": HELD["control"] | {"controlled": ["x", "angle"]}}
    turn = 2 * np.pi  # an angle of the target is that modulo a whole turn
    found = step_response(made(angle=after(0.0, 0.3), angle_target=0.3 + turn, **turns))
    np.testing.assert_allclose(found, target_response(TIME, after(0.0)), rtol=1e-9)
    assert step_response(made(angle=after(0.0, 0.3), angle_target=0.3, **HELD)) is None


class Integrator(Controller):
    """Moves the base along x by the integral of the error, and by the error."""

    gains: tuple[float, float]
    period: float

    def start(self, seen):
        return jnp.zeros(())

    def command(self, memory, seen):
        error = seen.reference[0] - seen.measured[0]
        memory = memory + self.period * error
        kp, ki = self.gains
        return jnp.zeros_like(seen.command).at[0].set(kp * error + ki * memory), memory


@pytest.mark.slow
def test_the_step_of_a_simulated_loop_is_that_of_its_linear_model():
    begin, size, (kp, ki) = 1.0, 1e-4, (0.1, 3.0)
    slide = {"max_speed": 10.0, "max_acceleration": 1e3}
    scenario = crinoid.Scenario(
        arm={"nodes": 7, "youngs_modulus": 4e6, "damping_time": 0.2},
        base={"tilt_deg": 90.0, "channels": {"slide": slide}},
        control={"controlled": ["x"], "compare": False},
        simulation={"duration": 11.0, "tolerance": 1e-12},
        output={"interval": 0.01},
    )
    model = crinoid.linearise(scenario)
    at = model.operating_outputs[model.outputs.index("tip_x")]
    height = model.operating_outputs[model.outputs.index("tip_z")]
    target = {"time": [begin, begin + 0.01], "tip": [[at, height], [at + size, height]]}
    scenario = scenario.with_values({"target": target | {"feed_forward": False}})
    run = crinoid.simulate(scenario, controller=Integrator((kp, ki), model.period))
    found = {name: MEASURES[name].of(run) for name in ("rise_time", "overshoot", "settling_time")}

    plant = model.to_control()
    # the command adds the error of its own instant to the integral
    error = control.ss(1.0, model.period, ki, kp + ki * model.period, model.period)
    forward = plant[["tip_x", "measured_tip_x"], "command_slide"] * error
    closed = control.feedback(forward, control.ss([], [], [], [[0.0, 1.0]], model.period))
    time = np.arange(0.0, 10.0, model.period)
    _, moved = control.step_response(closed[0, 0], time)
    fine = np.linspace(0.0, time[-1], 20 * time.size)  # it gives instants, none between them
    info = control.step_info(np.interp(fine, time, moved), T=fine)
    assert info["SteadyStateValue"] == pytest.approx(1.0, abs=1e-3)
    assert info["Overshoot"] > 2.0
    assert found["rise_time"] == pytest.approx(info["RiseTime"], rel=0.01)
    assert found["overshoot"] == pytest.approx(info["Overshoot"] / 100, rel=0.01)
    # the step is seen at the next command
    assert found["settling_time"] == pytest.approx(info["SettlingTime"] + model.period, rel=0.01)
