"""Parts of a user are checked where they are traced: name, result, the form it must have."""

import re
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.door import build_part
from crinoid.assembly.facts import Facts
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.system import OWN, check_steady
from crinoid.control import Clock
from crinoid.diagnostics.plausibility import plausibility_warnings
from crinoid.dynamics import Outcome
from crinoid.flow.currents import MeasuredPoint
from crinoid.numerics.piecewise import PiecewisePolynomial, shape_preserving
from crinoid.simulation.conclusion import nonfinite
from crinoid.simulation.setup import loop_about
from helpers.refusals import mistake, refused

SCENARIO = crinoid.Scenario(
    arm={"nodes": 4},
    base={"channels": {"slide": {}, "tilt": {}}},
    control={"kind": "custom", "compare": False},
    simulation={"duration": 0.1},
)


class Hold(crinoid.Controller):
    """Commands a given function."""

    given: object = eqx.field(static=True)
    memory: object = eqx.field(static=True, default=None)

    def start(self, seen):
        return jnp.zeros(2)

    def command(self, memory, seen):
        return self.given(seen), memory if self.memory is None else self.memory(memory)


class Kelp(crinoid.Flow):
    steady: ClassVar[bool] = False
    onset: crinoid.Onset
    given: object = eqx.field(static=True)

    def fully_on(self, point, time):
        return self.given(point, time)


class Rope(crinoid.Element):
    stencil: ClassVar[int] = 2
    first: int = eqx.field(static=True)
    share: jax.Array
    given: object = eqx.field(static=True)

    def residual(self, motion):
        return self.given(motion)


class Mooring(Rope):
    worked: ClassVar[str] = "mooring"


class Sonar(crinoid.Measurand):
    given: object = eqx.field(static=True)
    named: object = eqx.field(static=True, default=(("range", "m"),))

    def of(self, system, state):
        return self.given(state)

    def names(self, axes):
        return self.named


class Fin(crinoid.Actuator):
    advanced: object = eqx.field(static=True)
    driven: object = eqx.field(static=True)

    @property
    def inputs(self):
        return (crinoid.Input("fin", "N", "tension", jnp.asarray(0.0), jnp.asarray(1.0)),)

    def at_rest(self):
        return jnp.zeros(1)

    def advance(self, state, command, step):
        return self.advanced(command)

    def drive(self, state):
        return self.driven(state)


class FinNumbers(crinoid.ActuatorParameters):
    actuator: Fin

    def assemble(self, rod, first):
        return self.actuator, ()


def still(seen):
    return jnp.zeros_like(seen.command)


def controller(given, memory=None):
    return Parts(Hold(given, memory))


def flow(given):
    return Parts(Hold(still), flows=(Kelp(crinoid.Onset.of(), given),))


def element(given, first=2, share=2, kind=Rope):
    return Parts(Hold(still), elements=(kind(first, jnp.ones(share), given),))


def sensor(given, *named):
    none = jnp.zeros(1)
    made = crinoid.Sensor(
        "range",
        Sonar(given, *named),
        Clock(jnp.asarray(0.1)),
        jnp.asarray(0.0),
        none,
        none,
        jax.random.key(0),
        2,
    )
    return Parts(Hold(still), sensors=(made,))


def actuator(advanced=jnp.asarray, driven=jnp.asarray):
    return Parts(Hold(still), actuators=(FinNumbers(Fin(advanced, driven)),))


def asks(*given):
    return 0.0 if jax.tree.leaves(given)[0].sum() > 0 else 1.0


def fails(*given):
    raise KeyError("kelp")


def enter(parts):
    """Lead parts through every door that a run has, without compiling the run."""
    prepared = Prepared(SCENARIO, parts)
    state = jax.tree.map(
        lambda leaf: (
            jnp.zeros(leaf.shape, leaf.dtype) if isinstance(leaf, jax.ShapeDtypeStruct) else leaf
        ),
        eqx.filter_eval_shape(prepared.system.rest),
    )
    loop, _ = loop_about(prepared, state, jnp.zeros(3), None, 1.0)
    eqx.filter_eval_shape(loop.start, state)


PLACES = {
    "controller command": (controller, r"Hold \(controller\) command"),
    "flow": (flow, r"Kelp \(flow 0\) fully_on"),
    "element": (element, r"Rope \(element 6\) residual"),
    "sensor": (sensor, r"Sonar \(sensor range\) of"),
    "actuator advance": (actuator, r"Fin \(actuator\) advance"),
    "actuator drive": (lambda given: actuator(driven=given), r"Fin \(actuator\) drive"),
}
"""How a function becomes a part, and what it is called in a message."""


VALUE = (
    r"got a traced array where Python needs its value \(test_door.py, line \d+\); must use "
    "jnp.where in place of if, and jax.numpy in place of numpy. "
    "A number that chooses a node or a size is bound by functools.partial."
)
CAUSE = r"KeyError: 'kelp' \(test_door.py, line \d+\)"


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("fault", "line"), [(asks, VALUE), (fails, CAUSE)])
def test_an_error_inside_a_part_is_refused_in_one_line(place, fault, line):
    build, name = PLACES[place]
    error = refused(enter, build(fault))
    assert re.search(f"{name}: {line}$", str(error))
    assert len(str(error).splitlines()) == 1
    assert (fault is asks) or isinstance(error.__cause__, KeyError)


LOADED = SCENARIO.with_values({"load": [{"kind": "tip", "force": [0.0, 0.0]}] * 2})
FAILED = eqx.tree_at(
    lambda o: o.residual, Outcome.of_nothing(converged=False), jnp.asarray(jnp.nan)
)


def broken(value):
    return jnp.where(jnp.sum(value) > -1e9, jnp.nan, value)


def record():
    knots = PiecewisePolynomial(shape_preserving(np.array([0.0, 1.0]), np.ones((2, 2))))
    found = MeasuredPoint(crinoid.Onset.of(), knots, jnp.zeros(2), jnp.zeros(2), False)
    return Parts(flows=(eqx.tree_at(lambda r: r.met, found, replace_fn=broken),))


@pytest.mark.parametrize(
    ("parts", "line"),
    [
        (flow(lambda point, time: broken(point)), r"Kelp \(flow 0\) gives a velocity"),
        (element(lambda motion: broken(motion.position)), r"Rope \(element 8\) gives a force"),
        (actuator(driven=broken), r"Fin \(actuator\) gives a drive"),
        (record(), r"MeasuredPoint \(flow 0\) gives a velocity"),
    ],
)
def test_a_part_that_is_not_finite_at_the_start_is_named(parts, line):
    system = Prepared(LOADED, parts).system
    line += " that is not finite at t = 0 s$"
    assert re.search(line, nonfinite(LOADED, system, None, FAILED))


def test_a_load_that_is_not_finite_is_named():
    loaded = Prepared(LOADED).system
    assert nonfinite(LOADED, loaded, None, FAILED) == ""
    force = eqx.tree_at(lambda s: s.forces.elements[OWN + 1].dead_force, loaded, replace_fn=broken)
    assert "TipLoad (load 1) gives a force" in nonfinite(LOADED, force, None, FAILED)
    assert nonfinite(LOADED, force, None, Outcome.of_nothing(converged=True)) == ""


def test_a_flow_without_a_value_at_the_start_is_named_next_to_chambers():
    chamber = {"offset": 0.01, "area": 2e-4, "max_pressure": 1e4}
    driven = SCENARIO.with_values({"chamber": [chamber], "load": []})
    prepared = Prepared(driven, flow(lambda point, time: jnp.sin(time) / time * point))
    state = prepared.system.rest(0.1)
    assert nonfinite(driven, prepared.system, state, FAILED) == ""
    begin = eqx.tree_at(lambda s: s.motion.time, state, jnp.zeros(()))
    assert "Kelp (flow 0) gives a velocity" in nonfinite(driven, prepared.system, begin, FAILED)


class Swirl(crinoid.Flow):
    """Turns about the base at a rate in time."""

    steady: ClassVar[bool] = False
    onset: crinoid.Onset
    rate: jax.Array

    def fully_on(self, point, time):
        turning = 1.0 + self.rate * time
        return turning * jnp.stack([-point[1] - 10.0, point[0]])


class SteadySwirl(Swirl):
    steady: ClassVar[bool] = True


@pytest.mark.parametrize(
    ("kind", "rate", "line"),
    [
        (SteadySwirl, 1.0, "got True for a velocity that changes in time; must be False"),
        (SteadySwirl, 0.0, ""),
        (Swirl, 1.0, ""),
        (Swirl, 0.0, ""),
    ],
)
def test_a_flow_says_truly_whether_it_is_steady(kind, rate, line):
    given = kind(crinoid.Onset.of(), jnp.asarray(rate)), "flow 0", SCENARIO
    if line:
        assert f"{kind.__name__} (flow 0) steady: {line}" in mistake(check_steady, *given)
    else:
        check_steady(*given)


def test_a_flow_must_say_whether_it_is_steady():
    class Silent(crinoid.Flow):
        onset: crinoid.Onset

        def fully_on(self, point, time):
            return point

    with pytest.raises(TypeError, match=r"Silent\.steady must be declared"):
        Silent(crinoid.Onset.of())


LONG = crinoid.Scenario(arm={"nodes": 9, "length": 1.0})


def test_a_users_flow_counts_as_current_and_is_doubted():
    def facts(given):
        return Facts(Prepared(LONG, Parts(flows=flow(given).flows)))

    away = jnp.array([30.0, 0.0])
    steady = facts(lambda point, time: away + 0 * point)
    assert steady.current == pytest.approx(30.0)
    assert steady.mean_current == pytest.approx((30.0, 0.0))
    swell = facts(lambda point, time: jnp.sin(2 * jnp.pi * time / 3) * away + 0 * point)
    assert np.linalg.norm(swell.mean_current) < 0.05 * 30
    line = "flow.0: got a flow of up to 30 m/s; usual is up to 5 m/s"
    assert line in "".join(plausibility_warnings(steady.prepared))


def test_a_flow_without_a_known_speed_is_sampled(monkeypatch):
    current = {"kind": "uniform", "velocity": [0.3, 0.4]}
    wave = {"kind": "sine", "amplitude": [2.0, 0.0], "frequency_hz": 0.5}
    known = Facts(Prepared(crinoid.Scenario(flow=[current, wave])))
    assert known.sampled == {}
    monkeypatch.setattr(Facts, "_fastest", lambda *_: None)
    new = Facts(Prepared(known.scenario))
    assert new.speeds == pytest.approx(known.speeds, rel=0.05)


class Creeping(crinoid.Element):
    """A spring from the tip to the place where it was, which it follows within a second."""

    stencil: ClassVar[int] = 1
    first: int = eqx.field(static=True)
    stiffness: jax.Array

    def steady(self, motion):
        return motion.position

    def advance(self, motion):
        share = -jnp.expm1(-motion.step)
        return motion.memory + share * (motion.position - motion.memory)

    def residual(self, motion):
        if motion.memory is None:
            return 0.0 * motion.position
        return self.stiffness * (motion.position - self.advance(motion))


class Lost(Creeping):
    def advance(self, motion):
        return motion.position[0]


@pytest.mark.slow
def test_an_element_of_a_user_may_have_a_memory():
    spring = Creeping(SCENARIO.arm.nodes, 50 * jnp.ones(1))
    moving = crinoid.Scenario(
        arm={"nodes": 4},
        base={"channels": {"heave": {}}, "motion": [
            {"kind": "sine", "channel": "heave", "amplitude": 0.1, "frequency_hz": 0.5}
        ]},
        control={"kind": "none"},
        simulation={"duration": 1.0},
    )  # fmt: skip
    tips = [
        crinoid.simulate(moving, elements=elements).dataset["tip_position"]
        for elements in ((), (spring,))
    ]
    assert 0.02 < float(np.abs(tips[0] - tips[1]).max()) < 0.3


def memory(kind):
    return Parts(Hold(still), elements=(kind(SCENARIO.arm.nodes, jnp.ones(1)),))


ONE, TWO, THREE, WINDOW = (rf"float64\[{size}\]" for size in ("1", "2", "3", "2, 2"))
BARE = Parts(Hold(still), elements=(Rope(2, 1.0, still),))
MISTAKES = {
    rf"Hold \(controller\) command: returned \(float64\[\], {TWO}\); must return "
    rf"\({THREE}, {TWO}\), with a command for each of slide, heave, tilt": controller(
        lambda seen: seen.time
    ),
    r"returned \(float32\[2\], ": controller(lambda seen: jnp.zeros(2, "float32")),
    rf"returned \({THREE}, int64\[2\]\); must": controller(still, lambda m: m.astype(int)),
    r"<lambda> \(controller\): got NoneType; must be of Controller": Parts(lambda plan: None),
    rf"returned float64\[\]; must return {TWO}": flow(lambda point, time: time),
    rf"returned {TWO}; must return {WINDOW}": element(lambda m: m.position[0]),
    r"Rope \(element 6\): got 2 windows of 2 nodes from node 4 on; must be within": element(
        lambda m: m.position, first=4
    ),
    r"Rope \(element 6\): got first axes {\(\)}; must be one alike. Fields without ": BARE,
    r"worked: got 'mooring'; must be one of \('drag', ": element(fails, kind=Mooring),
    rf"Sonar .* of: returned {TWO}; must return {ONE}": sensor(lambda state: jnp.zeros(2)),
    r"Sonar \(sensor range\) names: ValueError: too many values": sensor(
        lambda state: jnp.zeros(1), ("range",)
    ),
    rf"advance: returned float64\[\]; must return {ONE}": actuator(lambda to: to[0]),
    rf"drive: returned {TWO}; must return {ONE}": actuator(driven=lambda state: jnp.zeros(2)),
    r"Lost .* advance: returned float64\[2\]; must return float64\[1, 2\]": memory(Lost),
}


@pytest.mark.parametrize(("line", "parts"), MISTAKES.items(), ids=MISTAKES)
def test_a_part_that_does_not_fit_is_refused_in_one_line(line, parts):
    said = mistake(enter, parts)
    assert re.search(line, said), said


def test_a_builder_that_returns_too_few_or_fails_is_refused():
    assert "must return 2 values" in mistake(build_part, "load 0", 2, lambda: (1,))
    assert "KeyError: 'kelp'" in mistake(build_part, "load 0", 2, fails)
