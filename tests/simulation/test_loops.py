"""Every controller, most with a tendon of given length: a short run, its derivative both ways.

Each has another target and other tables of base and sensors, so that few programs meet many pairs.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.scenario.control import KINDS
from helpers.arms import QUICKLY
from helpers.documents import joined
from helpers.paths import ROOT

H = 1e-5
"""Step of the central differences, relative."""
VEHICLE = {"mass": 20.0, "inertia": 1.0}
MOTION = {"kind": "sine", "channel": "heave", "amplitude": 0.02, "frequency_hz": 0.5}


def control(kind, **more):
    return {"control": {"kind": kind, "rate_hz": 50.0, "compare": False} | more}


SLIDE = {"channels": {"slide": {}}}
GAINS = {"kp": 0.3, "ki": 2.0, "kd": 0.01}
POINTS = {"tip": [[0.4, -10.2], [0.45, -10.1]], "time": [0.0, 1.0]}
HEADED = {"path": "line", "velocity": [0.05, 0.0]}
ALL_SENSORS = [
    {"kind": "shape", "stations": [0.1, 1.0], "noise": 0.01},
    {"kind": "wrench", "noise_force": 0.01},
    {"kind": "inclination", "stations": [0.2, 0.6, 1.0]},
    {"kind": "current", "points": [[0.0, 1.0]], "noise": 0.01},
]
LOOPS = {
    "pid": control(
        "pid", pid={"slide": GAINS, "heave": GAINS, "tilt": GAINS | {"return_time": 3.0}}
    )
    | {"base": {"channels": {"slide": {}, "heave": {}, "tilt": {}}, "motion": [MOTION]}}
    | {"target": {"path": "circle", "radius": 0.05, "period": 10.0, "frame": "base"}},
    "identity": control("pid", mapping="identity", controlled=["x"], pid={"slide": GAINS})
    | {"base": SLIDE | {"mount": "pinned"}, "target": POINTS},
    "lqg": control("lqg", start=0.01)
    | {"base": SLIDE, "target": HEADED, "vehicle": VEHICLE | {"hold": "thrusters"}},
    "known": control("mpc", mpc={"horizon": 0.3, "current": "known"})
    | {"base": SLIDE, "target": {"path": "sine", "amplitude": [0.05, 0.0], "frequency_hz": 0.2}},
    "measured": control("mpc", mpc={"horizon": 0.3, "current": "measured"})
    | {"base": SLIDE, "target": {"path": "file", "file": "series.csv"}, "sensors": ALL_SENSORS},
    "scheduled": control("mpc", mpc={"horizon": 0.3, "model": "scheduled"})
    | {"base": SLIDE, "target": HEADED | {"ramp_time": 0.5}},
    "sequence": control("sequence", sequence=[{"inputs": {"slide": 0.1}, "duration": 0.5}])
    | {"base": SLIDE, "vehicle": VEHICLE | {"hold": "free"}, "target": {"tip": [0.45, -10.1]}},
    "hybrid": control("hybrid", hybrid={"modes": 2})
    | {"base": SLIDE | {"tilt_deg": 90.0}, "sensors": ALL_SENSORS[2:3]}
    | {"arm": {"radius": 0.01, "density": 2500.0, "youngs_modulus": 7.7e6}},
    "neural": control("neural", rate_hz=100.0, neural={"weights": "station-keeping.eqx"})
    | {"base": {"channels": {"slide": {}, "tilt": {}}}, "simulation": {"start": "rest"}},
    "none": {"sensors": [*ALL_SENSORS, {"kind": "contact"}], "simulation": {"error": 1e-3}}
    | {"obstacle": [{"kind": "sphere", "position": [0.3, -10.13], "radius": 0.05}]},
}
"""A scenario for each controller, with another target each."""


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Work in a folder with the files that the scenarios name."""
    name = "station-keeping.eqx"
    (tmp_path / name).symlink_to(ROOT / "src" / "crinoid" / "scenario" / "library" / name)
    values = {"x": 0.45, "z": -10.1}
    time = np.arange(0.0, 21.0)
    rows = [time, *(value * (1 + 0.1 * np.sin(0.3 * time)) for value in values.values())]
    header = ",".join(["time", *values])
    np.savetxt(
        tmp_path / "series.csv", np.transpose(rows), delimiter=",", header=header, comments=""
    )
    monkeypatch.chdir(tmp_path)


def sides(scenario, seen):
    """Return the slopes of what is seen forward and backward, and the differences.

    Along a random direction of all numbers of a scenario, each in proportion to its size. ``seen``
    returns numbers from these, and whether everything was solved.
    """
    numbers = crinoid.parameters(scenario)
    varied = jax.tree.map(eqx.is_inexact_array, numbers)
    solver = jax.tree.map(lambda _: False, varied.simulation)
    varied = eqx.tree_at(lambda v: v.simulation, varied, solver)
    varied, fixed = eqx.partition(numbers, varied)
    random = np.random.default_rng(0)
    # limits may be infinite: without one
    direction = jax.tree.map(
        lambda x: jnp.where(jnp.isfinite(x), x, 0.0) * random.uniform(-1, 1, x.shape), varied
    )

    @partial(jax.jit, compiler_options=QUICKLY)
    def slopes(share):
        at = jax.tree.map(lambda x, d: x + share * d, varied, direction)
        found, linear, solved = jax.linearize(
            lambda x: seen(eqx.combine(x, fixed)), at, has_aux=True
        )
        ahead = linear(direction)
        # weighted by the slopes themselves
        (back,) = jax.linear_transpose(linear, at)(ahead)
        products = jax.tree.map(lambda a, b: jnp.sum(a * b), back, direction)
        return found, ahead, sum(jax.tree.leaves(products)), solved

    (found, ahead, back, solved), above, below = map(slopes, (0.0, H, -H))
    assert solved
    assert jnp.isfinite(found).all()
    return ahead, float(back), (above[0] - below[0]) / (2 * H)


def assert_one_derivative(scenario, seen):
    ahead, back, difference = sides(scenario, seen)
    assert back == pytest.approx(float(ahead @ ahead), rel=1e-8)
    np.testing.assert_allclose(ahead, difference, rtol=1e-3, atol=1e-4 * jnp.abs(ahead).max())


def loop_document(name):
    """Return the document of a closed loop: with a tendon, if its controller knows it."""
    current = {"kind": "uniform", "velocity": [0.1, 0.0]}
    usual = {"arm": {"nodes": 5}, "simulation": {"duration": 0.03}, "flow": [current]}
    usual |= {"sensor": {"noise_position": 1e-3, "noise_angle_deg": 0.1, "delay": 0.01}}
    winch = {"offset": 0.01, "drive": "length", "stiffness": 100.0, "max_shortening": 0.01}
    threads = {} if name in ("hybrid", "neural") else {"tendon": [winch | {"shortening": 1e-3}]}
    return joined(usual | threads, LOOPS[name])


@pytest.mark.release
@pytest.mark.parametrize("name", LOOPS)
@pytest.mark.usefixtures("files")
def test_a_closed_loop_runs_and_has_one_derivative(name):
    scenario = crinoid.Scenario(**loop_document(name))
    result = crinoid.simulate(scenario)
    assert result.dataset.attrs["status"] == "ok"
    loop, start = crinoid.closed_loop(scenario)

    def seen(numbers):
        run = crinoid.rollout(crinoid.with_parameters(loop, numbers), start, 3)
        return jnp.append(run.kept.tip, run.kept.command), run.converged

    assert_one_derivative(scenario, seen)


def test_every_kind_of_controller_is_here():
    kinds = {each.get("control", {}).get("kind", "none") for each in LOOPS.values()}
    assert kinds == {*KINDS} - {"custom"}
