"""Each number of `crinoid.parameters` acts as its key does, or is documented.

A key that moves one number alone is that number: a system assembled from the changed number is the
system of the changed scenario. The others are in two tables of the page on parameters.
"""

import re
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import crinoid
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.threads import UNLIMITED
from crinoid.scenario import ScenarioError
from crinoid.scenario.model import Model
from crinoid.scenario.scenario import scenario_schema
from helpers.arms import QUICKLY
from helpers.every_table import PLANE, SPACE

INEXACT = eqx.is_inexact_array
STEP = 1e-4
"""Step of central differences, over the value."""
PAGE = Path(__file__).parents[2] / "docs/how-to/parameters.md"
DERIVED, STRUCTURE = (
    re.findall(r"^\| `(.*[^.])` \|", table, re.MULTILINE)
    for table in PAGE.read_text().split("## What stays")[1].split("|---|---|")[1:]
)
"""Numbers that follow from several keys or none, and those whose keys change the structure too."""
LIBRARY = ["buoy-sea", "reef", "ship-motion", "ship-rao", "tidal-channel"]
"""Built-in scenarios with files."""
SENSORS = ("Contact", "Inclination", "Shape", "Wrench", "Current")
UNUSED = {
    "ActuatorTable",
    "FileMotion",
    "Phase",
    "SpectrumFile",
    *(f"{name}Sensor" for name in SENSORS),
}
"""Tables without a number of the parameters, or with those of a table that is used."""
NOT_A_NUMBER = {"title", "output", "target", "sensor", "sensors", "control"}
"""Tables of which no number, or only gains, are among the parameters."""


def keys(table, place=""):
    """Yield the dotted keys of all numbers in a plain table, with their values."""
    if isinstance(table, float):
        yield place, table
    elif isinstance(table, dict):
        for key, value in table.items():
            yield from keys(value, f"{place}.{key}" if place else key)
    elif isinstance(table, tuple | list):
        for index, value in enumerate(table):
            yield from keys(value, f"{place}.{index}")


def numbers(parameters):
    """Return the numbers by name."""
    found, _ = jax.tree_util.tree_flatten_with_path(parameters)
    return {jax.tree_util.keystr(path).lstrip("."): np.asarray(leaf) for path, leaf in found}


def differ(one, other):
    return one.shape != other.shape or not np.allclose(one, other, rtol=1e-9, atol=0)


def moved(one, other):
    """Return the names of numbers that differ, or that only one of both has."""
    common = one.keys() & other.keys()
    return (one.keys() ^ other.keys()) | {name for name in common if differ(one[name], other[name])}


def changed(prepared, key, value):
    """Return the scenario with the key doubled, or else with a value that it may have."""
    for new in (2 * value, value / 2, 1.1 * value, 0.9 * value) if value else (1.0, 0.1, 1e-4):
        try:
            scenario = prepared.scenario.with_values({key: new})
            other = prepared.with_scenario(scenario)
            _ = other.parameters
        except ScenarioError:
            continue
        return other
    return None


def walk(scenario):
    """Yield each key of a scenario that moves numbers, with these and the changed parameters."""
    prepared = Prepared(scenario)
    before = numbers(prepared.parameters)
    for key, value in keys(prepared.scenario.model_dump(by_alias=True)):
        first, *more = key.split(".")
        if first in NOT_A_NUMBER and more[:1] != ["pid"]:
            continue
        other = changed(prepared, key, value)
        found = set() if other is None else moved(before, numbers(other.parameters))
        if found:
            yield key, found, other.parameters


def held(name, names):
    """Return whether names have a number; a name stands for all that is in it."""
    patterns = (re.escape(each).replace(r"\[i\]", r"\[\d+\]") for each in names)
    return any(re.match(pattern + r"(?!\w)", name) for pattern in patterns)


def general(name):
    """Return the name of a number of all tables of a list."""
    return re.sub(r"(?<=\[)\d+(?=\])", "i", name)


def follow(scenario):
    """Return the numbers of a scenario, and those that some key moves alone."""
    before, alone = Prepared(scenario).parameters, set()
    structure, known = jax.tree.structure(before), numbers(before)
    for key, found, after in walk(scenario):
        own = {name for name in found if not held(name, DERIVED)}
        assert len(own) <= 1, f"{key} moves {sorted(own)}: derive or document all but one"
        # a number that appears with the structure is not offered before
        if jax.tree.structure(after) != structure and found <= known.keys():
            assert all(held(name, STRUCTURE + DERIVED) for name in found), f"{key}: {found}"
        alone |= own
    return known, alone


@pytest.fixture(scope="module")
def scenarios(tmp_path_factory):
    """Return scenarios that together use every table that has numbers."""
    path = tmp_path_factory.mktemp("bed") / "bed.csv"
    path.write_text("x,h\n" + "\n".join(f"{x},{-0.1 * x * x - 12}" for x in range(-9, 10)))
    bed = {"kind": "seabed", "file": str(path), "height": "h"}
    plain = [PLANE, SPACE, {"arm": {"nodes": 5}, "obstacle": [bed]}]
    return [*map(crinoid.Scenario.from_dict, plain), *map(crinoid.load, LIBRARY)]


def test_each_key_of_a_planar_arm_moves_one_number_or_is_documented(scenarios):
    known, alone = follow(scenarios[0])
    assert len(known) > 150
    assert len(alone) > 110


@pytest.mark.release
def test_each_key_moves_one_number_and_each_number_has_a_key_or_is_documented(scenarios):
    found = [follow(scenario) for scenario in scenarios]
    alone = {general(name) for _, some in found for name in some}
    for name, value in (pair for known, _ in found for pair in known.items()):
        absent = np.all((value == 0) | ~np.isfinite(value) | (value == UNLIMITED))
        whole = not np.issubdtype(value.dtype, np.floating)
        documented = held(name, DERIVED) or general(name) in alone
        assert documented or absent or whole, f"no key moves {name} alone: document it"
    # what is documented is there
    names = {name for known, _ in found for name in known}
    for known in DERIVED + STRUCTURE:
        assert any(held(name, [known]) for name in names), known


def test_the_scenarios_use_every_table(scenarios):
    def tables(model):
        yield type(model).__name__
        for value in vars(model).values():
            for each in value if isinstance(value, tuple) else [value]:
                if isinstance(each, Model):
                    yield from tables(each)

    used = {name for scenario in scenarios for name in tables(scenario)}
    assert scenario_schema()["$defs"].keys() - used == UNUSED


MOVING = {
    "arm": {"nodes": 5, "length": 0.4, "radius": 0.015},
    "base": {"position": [0.0, -4.0]},
    "water": {"depth": 12.0},
    "flow": [
        {"kind": "uniform", "velocity": [0.2, 0.0]},
        {"kind": "regular-wave", "height": 0.4, "period": 1.5},
        PLANE["flow"][4] | {"mean": [0.15, 0.02]},
        PLANE["flow"][5],
    ],
    "obstacle": [
        {
            "kind": "capsule",
            "position": [0.0, -4.4999],
            "axis": [1.0, 0.0, 0.2],
            "radius": 0.05,
            "length": 0.1,
            "mass": 3.0,
            "spin": 1.0,
        },
        {"kind": "plane", "position": [0.0, -4.8], "normal": [0.2, 1.0], "friction": 0.3},
    ],
    "chamber": [
        PLANE["chamber"][0],
        PLANE["chamber"][1] | {"schedule": {"time": [0.0, 1.0], "share": [0.2, 0.3]}},
    ],
    "tendon": [PLANE["tendon"][0] | {"friction": 0.0}],
    "simulation": {"time_step": 5e-3, "duration": 1.0, "start": "rest", "tolerance": 1e-12},
}
"""A planar arm with a capsule that turns in the water, whose numbers have others in their train."""
ACTING = {
    "chamber.0.max_pressure": "max_pressure",
    "chamber.1.area": "area",
    "chamber.1.max_volume": "max_volume",
    "tendon.0.max_tension": "max_tension",
    "obstacle.0.mass": "mass",
    "obstacle.0.radius": "radius",
    "obstacle.0.length": "length",
    "water.gravity": "gravity",
    "flow.0.velocity.0": "uniform_velocity",
    "flow.1.period": "frequencies",
    "flow.2.mean.0": "mean",
    "flow.3.mean.0": "mean",
}
"""Keys on which others follow, with the last name of their number."""


def flat(tree):
    return jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(eqx.filter(tree, INEXACT))])


@eqx.filter_jit(compiler_options=QUICKLY)
def moved_on(parameters, tangent):
    """Return all that moves after three steps, and its derivative."""

    def end(parameters):
        system = crinoid.assemble(parameters)
        command = jnp.zeros(len(system.inputs))

        def onward(_, last):
            state, outcome = system.step(last[0], command)
            return state, last[1] & outcome.converged

        state, well = jax.lax.fori_loop(0, 3, onward, (system.rest(), jnp.asarray(True)))
        return flat((state.position, state.obstacle_position, state.obstacle_spin)), well

    return eqx.filter_jvp(end, (parameters,), (tangent,))


@pytest.mark.release
def test_a_changed_number_and_its_derivative_are_those_of_the_key():
    prepared = Prepared(crinoid.Scenario.from_dict(MOVING))
    parameters, values = prepared.parameters, dict(keys(prepared.scenario.model_dump()))
    zero = jax.tree.map(jnp.zeros_like, eqx.filter(parameters, INEXACT))
    (_, converged), _ = moved_on(parameters, zero)
    assert converged

    def at(key, factor):
        changed = prepared.scenario.with_values({key: factor * values[key]})
        return prepared.with_scenario(changed).parameters

    for key, name in ACTING.items():
        twice, found = at(key, 2.0), []
        for path, leaf in jax.tree_util.tree_leaves_with_path(parameters):
            (other,) = [x for p, x in jax.tree_util.tree_leaves_with_path(twice) if p == path]
            if differ(np.asarray(leaf), np.asarray(other)):
                found.append(jax.tree_util.keystr(path))
        assert [each.split(".")[-1] for each in found] == [name], key
        up, down = at(key, 1 + STEP), at(key, 1 - STEP)
        way = jax.tree.map(
            lambda a, b: jnp.where(a == b, 0.0, (a - b) / (2 * STEP)),
            *(eqx.filter(each, INEXACT) for each in (up, down)),
        )
        _, (slope, _) = moved_on(parameters, way)
        ends = [moved_on(each, zero)[0][0] for each in (up, down)]
        size = np.abs(slope).max()
        assert size > 1e-9, key
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * STEP), atol=1e-4 * size)


@pytest.mark.release
def test_a_loop_with_a_changed_number_moves_as_that_of_the_scenario_with_the_key():
    simulation = MOVING["simulation"] | {"tolerance": 1e-9}
    scenario = crinoid.Scenario.from_dict(MOVING | {"simulation": simulation})
    loop, state = crinoid.closed_loop(scenario)
    changed_loop = eqx.filter_jit(crinoid.with_parameters)
    tips = eqx.filter_jit(lambda loop: crinoid.rollout(loop, state, 3).kept.tip)
    values, still = dict(keys(scenario.model_dump())), tips(loop)
    for key in ACTING:
        other = scenario.with_values({key: 2 * values[key]})
        by_number = changed_loop(loop, crinoid.parameters(other))
        by_key, _ = crinoid.closed_loop(other)
        pair = [numbers(eqx.filter(each, INEXACT)) for each in (by_number, by_key)]
        assert not moved(*pair), key
        ends = [tips(each) for each in (by_number, by_key)]
        np.testing.assert_allclose(*ends, atol=1e-14, err_msg=key)
        if not key.startswith("obstacle"):
            assert np.abs(ends[0] - still).max() > 1e-6, key
