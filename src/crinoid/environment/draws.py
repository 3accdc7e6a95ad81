"""Episodes of a scenario: which numbers each has, and where its arm starts."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from crinoid.assembly.numbers import array
from crinoid.assembly.observables import Observables
from crinoid.assembly.parts import Parts
from crinoid.assembly.plan import Plan
from crinoid.assembly.prepared import Prepared
from crinoid.assembly.sensor import build_sensors
from crinoid.batch.variation import structure
from crinoid.control import Sensor
from crinoid.environment.episode import Case
from crinoid.environment.given import Given
from crinoid.environment.program import Form
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of, shown
from crinoid.simulation.failure import start_failure
from crinoid.simulation.setup import Setup, require_one_case, set_up
from crinoid.simulation.together import on_processor

OPTIONS = ("set", "draw")
"""Names in the options of a reset."""

_PROGRAM = "the compiled program"


class Drawn(NamedTuple):
    """An episode that is ready to begin."""

    prepared: Prepared
    case: Case
    setup: Setup

    @property
    def scenario(self) -> Scenario:
        """Its scenario, with what was drawn."""
        return self.prepared.scenario


class Draws:
    """Draws episodes that share their compiled program.

    Parameters
    ----------
    scenario
        One case (`crinoid.Scenario.cases`).
    ranges
        Keys that every episode draws, with the smallest and the largest value.
    """

    def __init__(self, scenario: Scenario, ranges: Mapping[str, Any] | None) -> None:
        require_one_case(scenario)
        self.scenario = scenario.with_values({"control.kind": "custom"})
        self.ranges = _checked("draw", ranges)
        # both ends: no draw is to be refused later
        self.scenario.with_values({key: low for key, (low, _) in self.ranges.items()})
        widest = self.scenario.with_values({key: high for key, (_, high) in self.ranges.items()})
        self._kept = {sensor.name: sensor.kept for sensor in build_sensors(widest)}
        self.first = self._built(self.scenario)
        self.observables = Observables(self.first.setup.plan)
        self._form = Form(self.first.case)

    def draw(
        self, seed: int | None, random: np.random.Generator, options: Mapping[str, Any] | None
    ) -> Drawn:
        """Draw an episode.

        Parameters
        ----------
        seed
            The scenario's ``seed``; drawn as well if left out.
        random
            What to draw from.
        options
            ``set``: values by key; ``draw``: ranges by key, beside those of all episodes.
        """
        given = _options(options)
        ranges = self.ranges | _checked("options: draw", given["draw"])
        values = {"seed": int(random.integers(2**31)) if seed is None else seed}
        values |= {key: random.uniform(low, high) for key, (low, high) in ranges.items()}
        values |= given["set"]
        scenario = self.scenario.with_values(values)
        if given["set"] and structure(scenario) != structure(self.scenario):
            self._refuse(values, structure, _PROGRAM)  # before it is compiled
        drawn = self._built(scenario)
        if Form(drawn.case) != self._form:
            self._refuse(values, structure, _PROGRAM)
        limits = Observables(drawn.setup.plan)
        if (limits.entries, limits.actions) != (self.observables.entries, self.observables.actions):
            self._refuse(values, _limits, "the limits of actions or observations")
        return drawn

    def _built(self, scenario: Scenario) -> Drawn:
        with on_processor():
            prepared = Prepared(scenario, Parts(_no_command))
            setup = set_up(prepared)
            trouble = start_failure(scenario, setup.loop.system, setup.outcome)
            if trouble:
                raise RuntimeError(trouble)
            # the target is followed by whoever commands
            loop = replace(setup.loop, feed_forward=None, sensors=self._roomy(setup.loop.sensors))
            case = Case(
                loop,
                setup.state,
                jnp.asarray(scenario.simulation.steps),
                array(scenario.arm.length),
            )
        return Drawn(prepared, case, setup)

    def _roomy(self, sensors: tuple[Sensor, ...]) -> tuple[Sensor, ...]:
        """Return sensors with room for as many samples as the longest delay has under way."""
        return tuple(
            replace(each, kept=max(each.kept, self._kept.get(each.name, 0))) for each in sensors
        )

    def _refuse(self, values: Mapping[str, Any], trait: Any, what: str) -> None:
        """Refuse values that change what all episodes share, naming one that does."""
        wanted = trait(self.scenario)
        for key, value in values.items():
            try:
                changes = trait(self.scenario.with_values({key: value})) != wanted
            except ScenarioError:  # it goes only with what else is changed
                changes = True
            if changes:
                break
        text = f"got {shown(value)}, which changes {what}; takes a scenario of its own"
        raise ScenarioError([Mistake(key, text)])


def _no_command(plan: Plan) -> Given:
    return Given(jnp.zeros(len(plan.inputs)))


def _limits(scenario: Scenario) -> Any:
    return scenario.base.channels.model_dump(), scenario.chamber, scenario.tendon


def _options(options: Mapping[str, Any] | None) -> dict[str, Mapping[str, Any]]:
    given = {"set": {}, "draw": {}} | dict(options or {})
    for name, values in given.items():
        if name not in OPTIONS:
            _wrong(f"options: {name}", f"unknown, takes {one_of(OPTIONS)}")
        if not isinstance(values, Mapping):
            _wrong(f"options: {name}", f"got {shown(values)}, takes dotted keys with values")
    return given


def _checked(where: str, ranges: Any) -> dict[str, tuple[float, float]]:
    """Return ranges by key, as numbers."""
    if not isinstance(ranges or {}, Mapping):
        _wrong(where, f"got {shown(ranges)}, takes dotted keys, each with a smallest and a largest")
    found = {}
    for key, pair in (ranges or {}).items():
        try:
            low, high = map(float, pair)
            fine = math.isfinite(low) and math.isfinite(high) and low <= high
        except (TypeError, ValueError):
            fine = False
        if not fine:
            told = f"got {shown(pair)}, takes two numbers, the smaller one first"
            _wrong(f"{where}: {key}", told)
        found[str(key)] = low, high
    return found


def _wrong(key: str, text: str) -> None:
    raise ScenarioError([Mistake(key, text)])
