"""Tables of a scenario side by side: programs of their derivatives, and three steps.

Any two tables stand together in one of a few scenarios, in another without each other, and in
others alone: some mistakes need company, some need its absence. An equilibrium, a step and their
derivatives, forward and backward, are traced in all of them, which shows what does not fit. The
largest ones run as well; programs of all, with derivatives, would take hours to compile.
`test_loops` has derivatives of controllers with their numbers.
"""

from itertools import combinations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.scenario import Scenario, ScenarioError
from helpers.documents import joined


def tables(axes):
    """Return tables of a scenario by name; each makes another program than without it."""

    def at(x, z, y=0.02):
        return [x, y, z] if axes == 3 else [x, z]

    def obstacle(kind, *place, **more):
        return {"obstacle": [{"kind": kind, "position": at(*place)} | more]}

    winch = {"offset": 0.01, "drive": "length", "stiffness": 100.0, "max_shortening": 0.01}
    chamber = {"offset": 0.01, "area": 1e-4}
    line = {"drive": "volume", "bulk_modulus": 1e5, "max_volume": 1e-6, "volume": 1e-7}
    vehicle, tool = {"mass": 20.0, "inertia": 1.0}, {"mass": 0.05, "volume": 1e-5}
    motion = {"kind": "sine", "channel": "heave", "amplitude": 0.02, "frequency_hz": 0.5}
    turbulence = {"kind": "turbulence", "mean": at(0.2, 0.0), "intensity": 0.1, "modes": 8}
    gains = {"kp": 0.3, "ki": 2.0, "kd": 0.01}
    return {
        "free ball": obstacle("sphere", 0.45, -9.8, radius=0.05, mass=0.6, friction=0.1),
        "fixed ball": obstacle("sphere", 0.3, -10.13, radius=0.05, friction=0.2),
        "drifting ball": obstacle("sphere", 0.4, -10.3, radius=0.05, velocity="flow"),
        "plane": obstacle("plane", 0.0, -10.6, normal=at(0.0, 1.0, 0.0)),
        "self-contact": {"contact": {"self": True, "friction": 0.1}},
        "rubbing tendon": {
            "tendon": [{"offset": 0.01, "max_tension": 5.0, "tension": 0.5, "friction": 0.2}]
        },
        "winch": {"tendon": [winch | {"shortening": 1e-3}]},
        "chamber": {"chamber": [chamber | {"max_pressure": 1e4, "pressure": 1e3}]},
        "closed chamber": {"chamber": [chamber | line]},
        "tool": {"tool": tool | {"radius": 0.02}},
        "taken tool": {"tool": tool | {"from": 0.02, "until": 0.5}},
        "floating": {"vehicle": vehicle | {"hold": "thrusters"}},
        "hull": {
            "vehicle": {"hull": {"length": 0.6, "diameter": 0.3}},
            "contact": {"self": True},
        },
        "pinned": {"base": {"mount": "pinned"}},
        "motion": {"base": {"motion": [motion]}},
        "relaxation": {"arm": {"relaxation": [{"ratio": 0.2, "time": 0.5}]}},
        "vortices": {"water": {"vortices": {}}},
        "waves": {"flow": [{"kind": "regular-wave", "height": 0.3, "period": 3.0}]},
        "turbulence": {"flow": [turbulence | {"length_scale": 0.5}]},
        "load": {"load": [{"kind": "tip", "force": at(0.01, 0.02), "follower": True}]},
        "control": {
            "base": {"channels": {"slide": {}, "heave": {}}},
            "control": {"kind": "pid", "compare": False, "pid": {"slide": gains}},
            "sensor": {"delay": 0.01, "noise_position": 1e-3},
            "sensors": [{"kind": "shape", "stations": [0.1, 1.0]}],
            "target": {"tip": at(0.4, -10.2)},
        },
    }


NAMES = tuple(tables(2))
CLASH = [{"tool", "taken tool"}, {"floating", "motion"}]
"""Tables that exclude each other."""
USUAL = {"actuator", "title", "seed", "vary", "measure", "output", "simulation", "training"}
"""Keys of a scenario that make no other program of an arm, or name packages."""


def scenario(axes, names):
    """Return a scenario with tables."""
    found = {"arm": {"nodes": 5, "dimension": axes}, "simulation": {"duration": 0.03}}
    for name in names:
        found = joined(found, tables(axes)[name])
    return Scenario(**found)


def fit(names):
    return not any(clash <= set(names) for clash in CLASH)


def states(names):
    """Return of each two tables which of them are there."""
    return {(a, b, a in names, b in names) for a, b in combinations(NAMES, 2)}


def together():
    """Choose scenarios such that any two tables are both there, both absent, and there alone.

    One after the other, each the best of some at random.
    """
    random, chosen = np.random.default_rng(1), []
    left = {
        (a, b, *there)
        for a, b in combinations(NAMES, 2)
        for there in [(True, True), (True, False), (False, True), (False, False)]
        if fit({a, b}) or not all(there)
    }
    while left:
        tried = []
        for _ in range(40):
            names = set()
            for name in random.permutation(NAMES):
                if random.random() < 0.45 and fit({*names, str(name)}):
                    names.add(str(name))
            tried.append(names)
        best = max(tried, key=lambda names: len(states(names) & left))
        chosen.append([name for name in NAMES if name in best])
        left -= states(best)
    return chosen


CHOSEN = together()


def test_every_table_of_a_scenario_is_here():
    here = {key for table in tables(2).values() for key in table}
    assert set(Scenario.model_fields) - here - USUAL == set()


def test_a_vehicle_that_floats_has_no_prescribed_motion():
    for axes in (2, 3):
        with pytest.raises(ScenarioError, match="has no prescribed motion"):
            scenario(axes, ["floating", "motion"])


LARGEST = sorted(CHOSEN, key=len)[::-1]
both_dimensions = pytest.mark.parametrize("axes", [2, 3])


def test_most_pairs_run_together():
    pairs = [{a, b} for a, b in combinations(NAMES, 2) if fit({a, b})]
    ran = sum(any(pair <= set(names) for names in LARGEST[:4]) for pair in pairs)
    assert ran > 0.75 * len(pairs)


@pytest.mark.release
@both_dimensions
@pytest.mark.parametrize("names", LARGEST[:4], ids=", ".join)
def test_many_tables_run_side_by_side(names, axes):
    run = crinoid.simulate(scenario(axes, names)).dataset
    assert run.attrs["status"] == "ok"
    assert np.isfinite(run["tip_position"]).all()


@pytest.mark.release
@both_dimensions
@pytest.mark.parametrize("names", CHOSEN, ids=", ".join)
def test_tables_side_by_side_have_derivatives(names, axes):
    both = scenario(axes, names)
    varied, fixed = eqx.partition(crinoid.parameters(both), eqx.is_inexact_array)

    def seen(varied):
        system = crinoid.assemble(eqx.combine(varied, fixed))
        first, _ = system.find_equilibrium()
        after, _ = system.step(first, jnp.zeros(len(system.inputs)))
        return jnp.concatenate([system.tip(first), system.tip(after), after.base_force])

    def slopes(varied):
        found, linear = jax.linearize(seen, varied)
        (back,) = jax.linear_transpose(linear, varied)(found)
        return found, linear(varied), back

    found, ahead, back = jax.eval_shape(slopes, varied)
    assert found.shape == ahead.shape
    assert jax.tree.structure(back) == jax.tree.structure(varied)
