"""Parts of a user are checked where they are traced: name, result, the form it must have."""

import os
import re
import subprocess
import sys
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.door import expect, made
from crinoid.assembly.parts import Parts
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.samples import check_steady
from crinoid.assembly.system import OWN
from crinoid.control import Clock
from crinoid.dynamics import Outcome
from crinoid.flow.measured import MeasuredPoint
from crinoid.plausibility import Facts, doubts
from crinoid.simulation.failure import culprit
from crinoid.simulation.setup import loop_about
from crinoid.spline import PiecewisePolynomial, shape_preserving

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


def flow(given):
    return Parts(flows=(Kelp(crinoid.Onset.of(), given),))


def element(given, first=2, share=2):
    return Parts(elements=(Rope(first, jnp.ones(share), given),))


def sensor(given, *named):
    zeros = np.zeros(1)
    made = crinoid.Sensor(
        "range", Sonar(given, *named), Clock(jnp.asarray(0.1)), jnp.asarray(0.0),
        jnp.asarray(zeros), jnp.asarray(zeros), jax.random.key(0), 2,
    )  # fmt: skip
    return Parts(Hold(still), sensors=(made,))


def actuator(advanced, driven):
    return Parts(Hold(still), actuators=(FinNumbers(Fin(advanced, driven)),))


def asks(*given):
    return given[0] if given[0].sum() > 0 else 2 * given[0]


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


VALUE = (
    r"got a traced array where Python needs its value \(test_door.py, line \d+\); must use "
    "jnp.where in place of if, and jax.numpy in place of numpy"
)
CAUSE = r"KeyError: 'kelp' \(test_door.py, line \d+\)"
VECTOR = r"must return float64\[2\]"
MISTAKES = {
    "a command for all": (
        Parts(Hold(lambda seen: seen.time)),
        r"Hold \(controller\) command: returned \(float64\[\], float64\[2\]\); must return "
        r"\(float64\[3\], float64\[2\]\), with a command for each of slide, heave, tilt",
    ),
    "one command of two": (
        Parts(Hold(lambda seen: jnp.zeros(1))),
        r"command: returned \(float64\[1\], ",
    ),
    "whole numbers": (
        Parts(Hold(lambda seen: jnp.zeros(2, int))),
        r"command: returned \(int64\[2\], ",
    ),
    "half precision": (
        Parts(Hold(lambda seen: jnp.zeros(2, "float32"))),
        r"returned \(float32\[2\], ",
    ),
    "no array": (Parts(Hold(lambda seen: "left")), r"returned \(str, "),
    "memory of another form": (
        Parts(Hold(still, lambda m: (m, m))),
        r"returned \(float64\[3\], \(float64\[2\], float64\[2\]\)\); must",
    ),
    "memory of another type": (
        Parts(Hold(still, lambda m: m.astype(int))),
        r"returned \(float64\[3\], int64\[2\]\); must",
    ),
    "a controller that asks": (
        Parts(Hold(lambda seen: asks(seen.command))),
        rf"Hold \(controller\) command: {VALUE}",
    ),
    "a controller that fails": (
        Parts(Hold(lambda seen: fails())),
        rf"Hold \(controller\) command: {CAUSE}",
    ),
    "no controller": (
        Parts(lambda plan: None),
        r"<lambda> \(controller\): got NoneType; must be of Controller",
    ),
    "a flow of one number": (
        flow(lambda point, time: time),
        rf"Kelp \(flow 0\) fully_on: returned float64\[\]; {VECTOR}",
    ),
    "a flow of (1,)": (flow(lambda point, time: point[:1]), rf"returned float64\[1\]; {VECTOR}"),
    "a flow in space": (
        flow(lambda point, time: jnp.zeros(3)),
        rf"returned float64\[3\]; {VECTOR}",
    ),
    "a flow of whole numbers": (
        flow(lambda point, time: jnp.zeros(2, int)),
        rf"returned int64\[2\]; {VECTOR}",
    ),
    "a flow of a list": (
        flow(lambda point, time: [0.1, 0.0]),
        rf"returned \[float, float\]; {VECTOR}",
    ),
    "a flow that asks": (flow(asks), rf"Kelp \(flow 0\) fully_on: {VALUE}"),
    "a flow that fails": (flow(fails), rf"Kelp \(flow 0\) fully_on: {CAUSE}"),
    "a force for all": (
        element(lambda m: m.time),
        r"Rope \(element 6\) residual: returned float64\[\]; must return float64\[2, 2\]",
    ),
    "a force for one node": (
        element(lambda m: m.position[0]),
        r"returned float64\[2\]; must return float64\[2, 2\]",
    ),
    "no force": (element(lambda m: None), r"returned None; must return float64\[2, 2\]"),
    "an element that asks": (
        element(lambda m: asks(m.position)),
        rf"Rope \(element 6\) residual: {VALUE}",
    ),
    "an element that fails": (element(fails), rf"Rope \(element 6\) residual: {CAUSE}"),
    "windows past the tip": (
        element(lambda m: m.position, first=4),
        r"Rope \(element 6\): got 2 windows of 2 nodes from node 4 on; must be within nodes 0, the "
        "ghost, to 4",
    ),
    "a reading too many": (
        sensor(lambda state: jnp.zeros(2)),
        r"Sonar \(sensor range\) of: returned float64\[2\]; must return float64\[1\]",
    ),
    "a reading of one number": (
        sensor(lambda state: state.time),
        r"of: returned float64\[\]; must return float64\[1\]",
    ),
    "a reading without unit": (
        sensor(lambda state: jnp.zeros(1), ("range",)),
        r"Sonar \(sensor range\) names: ValueError: too many values",
    ),
    "a sensor that asks": (
        sensor(lambda state: asks(state.position)),
        rf"Sonar \(sensor range\) of: {VALUE}",
    ),
    "a sensor that fails": (sensor(fails), rf"Sonar \(sensor range\) of: {CAUSE}"),
    "a state of another form": (
        actuator(lambda command: command[0], jnp.asarray),
        r"Fin \(actuator\) advance: returned float64\[\]; must return float64\[1\]",
    ),
    "a drive too many": (
        actuator(jnp.asarray, lambda state: jnp.zeros(2)),
        r"Fin \(actuator\) drive: returned float64\[2\]; must return float64\[1\]",
    ),
    "an actuator that asks": (actuator(asks, jnp.asarray), rf"Fin \(actuator\) advance: {VALUE}"),
    "an actuator that fails": (actuator(jnp.asarray, fails), rf"Fin \(actuator\) drive: {CAUSE}"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_part_that_does_not_fit_is_refused_in_one_line(name):
    parts, line = MISTAKES[name]
    with pytest.raises(crinoid.ScenarioError, match=line) as caught:
        enter(parts)
    assert len(str(caught.value).splitlines()) == 1
    if line.endswith(CAUSE):
        assert isinstance(caught.value.__cause__, KeyError)


@pytest.mark.parametrize(
    "parts",
    [
        Parts(Hold(still)),
        flow(lambda point, time: jnp.stack([time, time])),
        element(lambda motion: motion.position),
        sensor(lambda state: jnp.zeros(1)),
        actuator(jnp.asarray, jnp.asarray),
    ],
)
def test_a_part_that_fits_passes(parts):
    if parts.controller is None:
        parts = Parts(Hold(still), parts.elements, parts.flows)
    enter(parts)


class Mooring(Rope):
    worked: ClassVar[str] = "mooring"


def test_an_element_whose_work_has_no_name_is_refused():
    parts = Parts(elements=(Mooring(1, jnp.ones(2), fails),))
    line = r"Mooring \(element 6\) worked: got 'mooring'; must be one of \('drag', "
    with pytest.raises(crinoid.ScenarioError, match=line):
        enter(parts)


@pytest.mark.parametrize("build", [lambda: 3.0, lambda: (1,), lambda: None])
def test_a_builder_that_returns_too_few_is_refused(build):
    with pytest.raises(
        crinoid.ScenarioError, match=r"\(load 0\): returned .*; must return 2 values"
    ):
        made("load 0", 2, build)


def test_what_is_no_part_is_refused():
    with pytest.raises(crinoid.ScenarioError, match=r"^flow 0: got float; must be of Flow$"):
        expect(1.0, crinoid.Flow, "flow 0")


LOADED = SCENARIO.with_values({"load": [{"kind": "tip", "force": [0.0, 0.0]}] * 2})
FAILED = eqx.tree_at(
    lambda o: o.residual, Outcome.of_nothing(converged=False), jnp.asarray(jnp.nan)
)


@pytest.fixture(scope="module")
def loaded():
    return Prepared(LOADED).system


def broken(value):
    return jnp.where(jnp.sum(value) > -1e9, jnp.nan, value)


@pytest.mark.parametrize(
    ("parts", "line"),
    [
        (flow(lambda point, time: broken(point)), r"Kelp \(flow 0\) gives a velocity"),
        (element(lambda motion: broken(motion.position)), r"Rope \(element 8\) gives a force"),
        (actuator(jnp.asarray, broken), r"Fin \(actuator\) gives a drive"),
    ],
)
def test_a_part_that_is_not_finite_at_the_start_is_named(parts, line):
    system = Prepared(LOADED, parts).system
    line += " that is not finite at t = 0 s$"
    assert re.search(line, culprit(LOADED, system, None, FAILED))


def test_a_load_and_a_measured_flow_that_are_not_finite_are_named(loaded):
    assert culprit(LOADED, loaded, None, FAILED) == ""
    force = eqx.tree_at(lambda s: s.forces.elements[OWN + 1].dead_force, loaded, replace_fn=broken)
    assert "TipLoad (load 1) gives a force" in culprit(LOADED, force, None, FAILED)
    assert culprit(LOADED, force, None, Outcome.of_nothing(converged=True)) == ""
    knots = PiecewisePolynomial(shape_preserving(np.array([0.0, 1.0]), np.ones((2, 2))))
    zero = jnp.zeros(2)
    record = MeasuredPoint(crinoid.Onset.of(), knots, zero, zero, False)
    record = eqx.tree_at(lambda r: r.met, record, replace_fn=broken)
    system = Prepared(LOADED, Parts(flows=(record,))).system
    assert "MeasuredPoint (flow 0) gives a velocity" in culprit(LOADED, system, None, FAILED)


def test_chambers_and_a_flow_that_has_no_value_at_the_start():
    chamber = {"offset": 0.01, "area": 2e-4, "max_pressure": 1e4}
    driven = SCENARIO.with_values({"chamber": [chamber], "load": []})
    prepared = Prepared(driven, flow(lambda point, time: jnp.sin(time) / time * point))
    state = eqx.filter_jit(prepared.system.rest)(0.1)
    assert culprit(driven, prepared.system, state, FAILED) == ""
    begin = eqx.tree_at(lambda s: s.motion.time, state, jnp.zeros(()))
    assert "Kelp (flow 0) gives a velocity" in culprit(driven, prepared.system, begin, FAILED)


def test_what_is_not_finite_later_is_named_with_its_time(loaded):
    state = eqx.filter_jit(loaded.rest)(0.05)
    late = flow(lambda point, time: jnp.where(time > 0.052, jnp.nan, 0.0) * point)
    system = Prepared(LOADED, late).system
    line = culprit(LOADED, system, state, FAILED)
    assert line == "test_door:Kelp (flow 0) gives a velocity that is not finite at t = 0.06 s"


class Swirl(crinoid.Flow):
    """Turns about the base at a rate in time."""

    onset: crinoid.Onset
    rate: jax.Array

    def fully_on(self, point, time):
        turning = 1.0 + self.rate * time
        return turning * jnp.stack([-point[1] - 10.0, point[0]])


class Declared(Swirl):
    steady: ClassVar[bool] = True


class Undeclared(Swirl):
    steady: ClassVar[bool] = False


@pytest.mark.parametrize(
    ("kind", "rate", "line"),
    [
        (Swirl, 0.0, "got none for a velocity that differs in space and never changes; must be"),
        (Declared, 1.0, "got True for a velocity that changes in time; must be False"),
        (Swirl, 1.0, ""),
        (Declared, 0.0, ""),
        (Undeclared, 0.0, ""),
    ],
)
def test_a_flow_says_truly_whether_it_is_steady(kind, rate, line):
    given = kind(crinoid.Onset.of(), jnp.asarray(rate))
    if line:
        with pytest.raises(
            crinoid.ScenarioError, match=rf"{kind.__name__} \(flow 0\) steady: {line}"
        ):
            check_steady(given, "flow 0", SCENARIO)
    else:
        check_steady(given, "flow 0", SCENARIO)


KELP = """
from crinoid import Flow, Onset, flow_onset
from crinoid.tables import FlowTable

class Kelp(Flow):
    onset: Onset
    def fully_on(self, point, time):
        return point if point[0] > 0 else -point

class KelpFlow(FlowTable):
    kind: str = "kelp"
    lost: bool = False
    def build(self, scenario, generator):
        if self.lost:
            raise OSError("no map")
        return Kelp(flow_onset(self))
"""
RUN = """
from typer.testing import CliRunner
from crinoid.cli.app import app
for setting in ("true", "false"):
    ended = CliRunner().invoke(app, ["run", "kelp.toml", "--set", f"flow.0.lost={setting}"])
    print(ended.exit_code, " ".join(ended.output.split()))
"""


def test_a_command_tells_it_in_one_line_and_exits_with_2(tmp_path):
    # a process without checks of types: these refuse tables of packages in a scenario
    (tmp_path / "kelp.py").write_text(KELP)
    (tmp_path / "kelp.toml").write_text('[arm]\nnodes = 5\n[[flow]]\nkind = "kelp"\n')
    about = tmp_path / "kelp-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: kelp\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[crinoid.flows]\nkelp = kelp:KelpFlow\n")
    path = os.pathsep.join(filter(None, [str(tmp_path), os.environ.get("PYTHONPATH")]))
    command, environment = [sys.executable, "-c", RUN], os.environ | {"PYTHONPATH": path}
    ended = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300
    )
    built, traced = ended.stdout.splitlines()
    assert built == ("2 crinoid: kelp:KelpFlow.build (flow 0): OSError: no map (kelp.py, line 15)")
    assert traced == (
        "2 crinoid: kelp:Kelp (flow 0) fully_on: got a traced array where Python needs its value "
        "(kelp.py, line 8); must use jnp.where in place of if, and jax.numpy in place of numpy"
    )


LONG = crinoid.Scenario(arm={"nodes": 9, "length": 1.0})


def share(per_metre, count):
    return jnp.full(count, per_metre * LONG.arm.length / count)


def couple(motion):
    edge = motion.position[1] - motion.position[0]
    return jnp.stack([-1.0, 1.0])[:, None] * jnp.stack([-edge[1], edge[0]]) / jnp.sum(edge**2)


class Scaled(Rope):
    def residual(self, motion):
        return self.share * self.given(motion)


@pytest.mark.parametrize(
    ("given", "per_metre", "line"),
    [
        (
            couple,
            1e4,
            r"load: test_door:Scaled \(element 6\) puts 1e\+04 N m on the arm, 8e\+05 times",
        ),
        (couple, 0.1, ""),
        (
            lambda motion: jnp.full((2, 2), 0.5),
            1e3,
            r"puts 1\.41e\+03 N on the arm, 1\.1e\+05 times",
        ),
        (lambda motion: jnp.full((2, 2), 0.5), 1.0, ""),
    ],
)
def test_a_load_of_ones_own_is_doubted_by_its_force_and_its_couple(given, per_metre, line):
    load = Scaled(1, share(per_metre, 8), given)
    found = doubts(Prepared(LONG, Parts(elements=(load,))))
    if line:
        assert re.search(line, "; ".join(found)), found
    else:
        assert not [doubt for doubt in found if doubt.startswith("load")]


def test_a_flow_of_ones_own_counts_as_current_and_is_doubted():
    away = jnp.array([30.0, 0.0])
    facts = Facts(Prepared(LONG, flow(lambda point, time: away + 0 * point)))
    assert facts.current == pytest.approx(30.0)
    assert facts.mean_current == pytest.approx((30.0, 0.0))
    swell = flow(lambda point, time: jnp.sin(2 * jnp.pi * time / 3) * away + 0 * point)
    assert np.linalg.norm(Facts(Prepared(LONG, swell)).mean_current) < 0.05 * 30
    assert "flow.0: got a flow of up to 30 m/s; usual is up to 5 m/s" in "".join(
        doubts(facts.prepared)
    )
