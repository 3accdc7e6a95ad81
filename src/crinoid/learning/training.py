"""Training: from a scenario to a policy, update by update; it can be stopped and gone on with."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.assembly.description import PHYSICAL, Description
from crinoid.assembly.known import fastest
from crinoid.assembly.observables import named
from crinoid.assembly.weights import write_policy
from crinoid.control import Neural
from crinoid.control.policy import Policy
from crinoid.dataset import describe
from crinoid.environment.draws import Draws
from crinoid.environment.program import Form, numbers_of
from crinoid.learning.imitation import imitated
from crinoid.learning.learner import AWRY, Pace, new_learner
from crinoid.learning.network import new_policy
from crinoid.learning.ppo import SPREAD
from crinoid.learning.price import Price
from crinoid.learning.settings import METHODS, Settings
from crinoid.learning.stage import Crew, Stage
from crinoid.learning.stretch import Course, trial
from crinoid.replacement import replacing
from crinoid.scenario import Mistake, Scenario, ScenarioError, shown
from crinoid.simulation import closed_loop
from crinoid.version import __version__

LOOKS = 25
"""Updates between two looks at how the policy does."""
_PATIENCE = 24
"""Looks without an improvement after which training ends."""
_STRETCH = 0.64
"""Length of a stretch (s)."""
_AHEAD = 1.5
"""Time in which what is to come loses its weight (s)."""
_TAUGHT, _HELD = 8, 32
"""Episodes of the imitation, and those that a policy is judged by."""
_WORSE, _SLOWER = 1.2, 0.5
"""Cost over the least so far from which on a policy is given up, and the learning rate after that,
over the one before: it has lost arms that it held."""
_APART = 1_000_000
"""Seeds of training are this far apart; what is held out comes before the first of them."""
_COST = "mean cost of a time step, over that of the imitation"


class Training:
    """The training of a policy, and what it has come to.

    Parameters
    ----------
    scenario
        What to train for; its controller counts no more than that of ``settings.teacher``.
    settings
        How.
    """

    def __init__(self, scenario: Scenario, settings: Settings) -> None:
        self.scenario, self.settings = scenario, settings
        self._draws = Draws(scenario, settings.draw)
        self._plan = plan = self._draws.first.setup.plan
        self._observables = observables = self._draws.observables
        self._random = np.random.default_rng(settings.seed)
        speed = fastest(plan)[np.array(observables.driven)]
        entries = len(observables.entries)
        self._blank = new_policy(entries, speed, plan.period, self._random)
        step = float(plan.system.time_step)
        self._course = Course(
            observables.observation,
            Price.of(plan, observables),
            jnp.asarray(np.exp(-step / _AHEAD)),
            jax.random.key(settings.seed),
            min(max(2, round(_STRETCH / step)), scenario.simulation.steps),
        )
        self._improve, rate, steps = METHODS[settings.method]
        self._pace, self._crew = Pace(rate, max(1, steps * settings.updates)), Crew()
        first = _APART * (1 + settings.seed)
        neural = Neural(observables.observation, self._blank)
        self._stage = Stage(self._draws, settings.arms, neural, first)
        self._held = [self._stage.drawn(first - 1 - k) for k in range(_HELD)]
        self._before = first - 1 - _HELD
        """Seed of the first arm of the imitation; the others come before it."""
        self.updates, self.lost = 0, 0
        """Updates that were made, and arms that could not go on."""
        self.rows: list[tuple[float, float, float]] = []
        """Updates, cost and RMS error (m) at each look at the policy, on arms that are held out."""
        self.learner = self.good = new_learner(self._blank, SPREAD, self._pace, self._random)
        """The learner as it is, and as it was at the look that cost least."""

    def begin(self) -> None:
        """Imitate the teacher, and look at how that does."""
        values = {"control.kind": self.settings.teacher}
        loop, _ = closed_loop(self.scenario.with_values(values))
        pupil = Neural(self._course.observation, self._blank)
        steps, seed = self.scenario.simulation.steps, self.settings.seed
        try:
            arms = [self._stage.drawn(self._before - k) for k in range(_TAUGHT)]
            policy = imitated(loop.controller, pupil, arms, steps, seed, self._crew)
        except FloatingPointError as error:
            text = f"under the teacher {error}; try a smaller simulation.time_step"
            raise RuntimeError(text) from error
        cost, _ = self._look(policy)
        if np.isfinite(cost):  # what the imitation costs is one from here on
            self._set_unit(cost)
        self.learner = self.good = eqx.tree_at(lambda x: x.policy, self.learner, policy)
        self._judge()

    def _set_unit(self, cost: float) -> None:
        price = eqx.tree_at(lambda p: p.unit, self._course.price, jnp.asarray(cost))
        self._course = replace(self._course, price=price)

    @property
    def kept(self) -> int:
        """The look of which the policy is kept: the first of those that cost least."""
        costs = [cost if np.isfinite(cost) else np.inf for _, cost, _ in self.rows]
        return int(np.argmin(costs))

    @property
    def least(self) -> float:
        """Cost of the policy that is kept; infinite or no number where none could be run."""
        return self.rows[self.kept][1]

    @property
    def over(self) -> bool:
        """Whether all updates were made, or have not helped for long."""
        since = len(self.rows) - 1 - self.kept
        return self.updates >= self.settings.updates or since >= _PATIENCE

    def update(self) -> None:
        """Improve the policy by a stretch of all arms."""
        self.updates += 1
        arms = self._stage.arms
        self.learner, found = self._improve(
            self._pace, self._course, self.learner, arms, self._crew, self.updates
        )
        lost = np.array([not np.isfinite(np.asarray(each.cost)).all() for each in found])
        self.lost += int(lost.sum())
        astray = np.array([not np.mean(np.asarray(each.cost)) < AWRY for each in found])
        self._stage.go_on([each.end for each in found], self._course.steps, astray)
        if self.updates % LOOKS == 0 or self.updates == self.settings.updates:
            self._judge()

    def _look(self, policy: Policy) -> tuple[float, float]:
        """Return the cost of a policy in episodes that are held out, and its RMS error (m)."""
        course = replace(self._course, steps=self.scenario.simulation.steps)
        found = self._crew.each(trial, (course, policy), self._held)
        cost = np.mean([float(each.cost) for each in found])
        return float(cost), float(np.sqrt(np.mean([float(each.error) for each in found])))

    def _judge(self) -> None:
        self.rows.append((self.updates, *self._look(self.learner.policy)))
        if self.kept == len(self.rows) - 1:
            self.good = self.learner
        elif not self.rows[-1][1] <= _WORSE * self.least:
            self.learner = replace(self.good, share=_SLOWER * self.learner.share)

    @property
    def best(self) -> Policy:
        """The policy of the look that cost least."""
        return self.good.policy

    @property
    def description(self) -> Description:
        """Observations and commands of the policy, and where it was trained."""
        observables = self._observables
        return Description(
            named(observables.entries),
            named(observables.actions),
            self.scenario.control_rate_hz,
            self._blank.kept.size,
            [layer.bias.size for layer in self._blank.layers],
            {key: each for key, each in self.scenario.to_dict().items() if key in PHYSICAL},
            {key: list(pair) for key, pair in self._draws.ranges.items()},
        )

    def write(self, path: Path) -> None:
        """Write the best policy so far."""
        write_policy(path, self.best, self.description)

    def dataset(self, status: str) -> xr.Dataset:
        """Return how training went."""
        update, cost, error = np.array(self.rows, float).T
        settings = {name: value for name, value in asdict(self.settings).items() if name != "draw"}
        return xr.Dataset(
            {
                "cost": ("look", cost, {"units": "1", "long_name": _COST}),
                "error": ("look", error, {"units": "m", "long_name": "RMS error of the tip"}),
            },
            {"update": ("look", update.astype(int))},
            describe(self.scenario)
            | settings
            | {
                "status": status,
                "draw": json.dumps(self._draws.ranges),
                "lost": self.lost,
            },
        )

    def save(self, path: Path) -> None:
        """Save all that it takes to go on later: numbers only, no code."""
        state: dict[str, Any] = {
            "about": np.frombuffer(json.dumps(self._about).encode(), np.uint8),
            "counts": np.array([self.updates, self.lost]),
            "unit": np.asarray(self._course.price.unit),
            "rows": np.array(self.rows, float),
            **{f"learner_{k}": x for k, x in enumerate(numbers_of(self.learner))},
            **{f"good_{k}": x for k, x in enumerate(numbers_of(self.good))},
            **{f"stage_{name}": x for name, x in self._stage.saved().items()},
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **state)

    def restore(self, path: Path) -> None:
        """Go on from what was saved."""
        if about_in(path):
            self.check_same(path, "no --resume")
        try:
            with np.load(path, allow_pickle=False) as file:
                self._take(dict(file))
        except Exception as error:  # numpy and zipfile tell of damage in many ways
            text = f"cannot be gone on with ({error!r}); leave out --resume to begin anew"
            raise ScenarioError([Mistake(str(path), text)]) from error

    def check_same(self, path: Path, instead: str) -> None:
        """Refuse what was saved by another training, naming what differs."""
        about = about_in(path)
        for key, got in self._about.items():
            takes = about.get(key)
            if key == "scenario" and got != takes:
                text = "is of another scenario: takes the same, with the same --set"
            elif got != takes:
                text = f"is of another training: got {key} {shown(got)}, takes {shown(takes)}"
            else:
                continue
            raise ScenarioError([Mistake(str(path), f"{text}, or {instead}")])

    def _take(self, saved: dict[str, np.ndarray]) -> None:
        self.learner = _filled(self.learner, saved, "learner")
        self.good = _filled(self.good, saved, "good")
        self.updates, self.lost = map(int, saved["counts"])
        self.rows = [(update, cost, error) for update, cost, error in saved["rows"].tolist()]
        self._set_unit(float(saved["unit"]))
        prefix = "stage_"
        self._stage.restore(
            {name.removeprefix(prefix): x for name, x in saved.items() if name.startswith(prefix)}
        )

    @property
    def _about(self) -> dict[str, Any]:
        given = {f"--{name}": each for name, each in asdict(self.settings).items()}
        draw = {key: list(pair) for key, pair in self._draws.ranges.items()}
        about = {"crinoid": __version__, "scenario": self.scenario.to_toml()}
        return about | given | {"--draw": draw}


def about_in(path: Path) -> dict[str, Any]:
    """Return scenario and settings of what was saved; nothing if it is not of a training."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(json.loads(file["about"].tobytes()))
    except Exception:  # numpy and zipfile tell of damage in many ways
        return {}


def _filled(tree: Any, saved: dict[str, Float[np.ndarray, ...]], name: str) -> Any:
    form = Form(tree)
    return form.tree([jnp.asarray(saved[f"{name}_{k}"]) for k in range(len(form.shapes))])


def trained(
    training: Training, report: Callable[[Training], None], stop: Callable[[], bool]
) -> bool:
    """Train until it is over or to be stopped; return whether it was stopped."""
    while not training.over:
        if stop():
            return True
        training.update()
        report(training)
    return False
