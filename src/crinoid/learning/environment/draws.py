"""Sampling of episodes: the values that each draws, and the start of its arm."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple, NoReturn

import jax
import jax.numpy as jnp
import numpy as np

from crinoid.assembly.arrays import array
from crinoid.assembly.control_loop import build_sensors
from crinoid.assembly.neural import Observables
from crinoid.assembly.plan import Parts
from crinoid.assembly.prepared import Prepared, require_one_case
from crinoid.learning.environment.episode import EpisodeParameters
from crinoid.scenario import Scenario, ScenarioError, got, one_of, refusal
from crinoid.simulation.batch import on_processor
from crinoid.simulation.conclusion import start_failure
from crinoid.simulation.external import ExternalCommand
from crinoid.simulation.setup import Setup, set_up
from crinoid.studies.batch import structure

_PROGRAM = "the compiled program"

Arrays = list[jax.Array]


def arrays_of(tree: Any) -> Arrays:
    """Return the arrays of a pytree, with the raw data of its random keys."""
    return [
        jax.random.key_data(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else leaf
        for leaf in jax.tree.leaves(tree)
    ]


class TreeForm:
    """Structure, shapes and types of a pytree of arrays, to rebuild it from `arrays_of`."""

    def __init__(self, tree: Any) -> None:
        leaves, self._tree = jax.tree.flatten(tree)
        self._keys = [
            jax.random.key_impl(leaf) if jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key) else None
            for leaf in leaves
        ]
        self.shapes = [(leaf.shape, leaf.dtype) for leaf in leaves]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, TreeForm):
            return NotImplemented
        return (self._tree, self._keys, self.shapes) == (other._tree, other._keys, other.shapes)

    __hash__ = None  # type: ignore[assignment]

    def tree(self, arrays: Arrays) -> Any:
        """Return the pytree of some arrays; traceable."""
        leaves = [
            each if kind is None else jax.random.wrap_key_data(each, impl=kind)
            for each, kind in zip(arrays, self._keys, strict=True)
        ]
        return jax.tree.unflatten(self._tree, leaves)


class EpisodeDraw(NamedTuple):
    """An episode before its first step."""

    case: EpisodeParameters
    setup: Setup

    @property
    def scenario(self) -> Scenario:
        """Its scenario, with the values drawn."""
        return self.setup.scenario


class EpisodeSampler:
    """Sampler of episodes of one scenario, which share a compiled program.

    ``ranges`` has the keys that every episode draws, with the smallest and the largest value.
    """

    def __init__(self, scenario: Scenario, ranges: Mapping[str, Any] | None) -> None:
        require_one_case(scenario)
        self.scenario = scenario.with_values({"control.kind": "custom"})
        self.ranges = _check_ranges("draw", ranges)
        # check both ends, so that no draw fails later
        self.scenario.with_values({key: low for key, (low, _) in self.ranges.items()})
        widest = self.scenario.with_values({key: high for key, (_, high) in self.ranges.items()})
        self._samples = {sensor.name: sensor.kept for sensor in build_sensors(widest)}
        self.first = self._build(self.scenario)
        self.observables = Observables(self.first.setup.plan)
        self._form = TreeForm(self.first.case)

    def draw(
        self, seed: int | None, random: np.random.Generator, options: Mapping[str, Any] | None
    ) -> EpisodeDraw:
        """Draw an episode with a seed of the scenario, which is drawn as well if None.

        ``options`` are those of a reset: ``set``, values by key, and ``draw``, further ranges.
        """
        given = _check_options(options)
        ranges = self.ranges | _check_ranges("options: draw", given["draw"])
        values = {"seed": int(random.integers(2**31)) if seed is None else seed}
        values |= {key: random.uniform(low, high) for key, (low, high) in ranges.items()}
        values |= given["set"]
        scenario = self.scenario.with_values(values)
        if given["set"] and structure(scenario) != structure(self.scenario):
            self._refuse(values, structure, _PROGRAM)  # before it is compiled
        drawn = self._build(scenario)
        if TreeForm(drawn.case) != self._form:
            self._refuse(values, structure, _PROGRAM)
        limits = Observables(drawn.setup.plan)
        if (limits.entries, limits.actions) != (self.observables.entries, self.observables.actions):
            self._refuse(values, _limits, "the limits of actions or observations")
        return drawn

    def _build(self, scenario: Scenario) -> EpisodeDraw:
        with on_processor():
            none = Parts(lambda plan: ExternalCommand(jnp.zeros(len(plan.inputs))))
            setup = set_up(Prepared(scenario, none))
            if trouble := start_failure(setup):
                raise RuntimeError(trouble)
            # buffers suit the longest delay of all draws
            sensors = tuple(
                replace(sensor, kept=max(sensor.kept, self._samples.get(sensor.name, 0)))
                for sensor in setup.loop.sensors
            )
            # commands come from outside, so there is no feed-forward
            case = EpisodeParameters(
                replace(setup.loop, feed_forward=None, sensors=sensors),
                setup.state,
                jnp.asarray(scenario.simulation.steps),
                array(scenario.arm.length),
            )
        return EpisodeDraw(case, setup)

    def _refuse(self, values: Mapping[str, Any], trait: Any, changed: str) -> NoReturn:
        """Refuse values that change a trait common to all episodes, naming one of them."""
        common = trait(self.scenario)
        for key, value in values.items():
            try:
                changes = trait(self.scenario.with_values({key: value})) != common
            except ScenarioError:  # valid only together with the other values
                changes = True
            if changes:
                break
        hint = "Make another environment with this value in its scenario."
        raise refusal(key, got(value, f"not change {changed}", hint))


def _limits(scenario: Scenario) -> Any:
    return scenario.base.channels.model_dump(), scenario.chamber, scenario.tendon


def _check_options(options: Mapping[str, Any] | None) -> dict[str, Mapping[str, Any]]:
    known: dict[str, Mapping[str, Any]] = {"set": {}, "draw": {}}
    given = known | dict(options or {})
    for name, values in given.items():
        if name not in known:
            raise refusal(f"options: {name}", f"unknown; must be {one_of(known)}")
        if not isinstance(values, Mapping):
            raise refusal(f"options: {name}", got(values, "be a dictionary of dotted keys"))
    return given


def _check_ranges(where: str, ranges: Any) -> dict[str, tuple[float, float]]:
    if not isinstance(ranges or {}, Mapping):
        raise refusal(where, got(ranges, "be a dictionary of dotted keys and ranges"))
    found = {}
    for key, pair in (ranges or {}).items():
        try:
            low, high = map(float, pair)
            fine = math.isfinite(low) and math.isfinite(high) and low <= high
        except (TypeError, ValueError):
            fine = False
        if not fine:
            raise refusal(f"{where}: {key}", got(pair, "be two numbers, the smaller one first"))
        found[str(key)] = low, high
    return found


class NamedBoxes:
    """Names and units of an environment's observations and actions."""

    _sampler: EpisodeSampler

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Name of each number of an observation."""
        return tuple(entry.name for entry in self._sampler.observables.entries)

    @property
    def observation_units(self) -> tuple[str, ...]:
        """Unit of each number of an observation."""
        return tuple(entry.unit for entry in self._sampler.observables.entries)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Name of the input that each number of an action commands."""
        return tuple(entry.name for entry in self._sampler.observables.actions)

    @property
    def action_units(self) -> tuple[str, ...]:
        """Unit of each number of an action."""
        return tuple(entry.unit for entry in self._sampler.observables.actions)
