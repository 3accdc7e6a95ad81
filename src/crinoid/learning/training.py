"""Training of a policy: imitation, gradient updates, evaluations and checkpoints."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.assembly.control_design import max_speeds
from crinoid.assembly.description import PHYSICAL, Description
from crinoid.assembly.neural import named, write_policy
from crinoid.control import Neural
from crinoid.control.neural import Policy
from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.version import __version__
from crinoid.learning.environment.draws import EpisodeSampler, TreeForm, arrays_of
from crinoid.learning.gradient import (
    DIVERGED_COST,
    Optimisers,
    gradient_update,
    new_learner,
    new_policy,
)
from crinoid.learning.imitation import imitate
from crinoid.learning.rollout import EpisodePool, Learners, RolloutSegment, StageCost, evaluate
from crinoid.learning.settings import TrainingSettings
from crinoid.results.dataset import describe
from crinoid.scenario import Scenario, refusal, shown
from crinoid.simulation import closed_loop

EVALUATION_INTERVAL = 25  # updates between two evaluations of the policy
_PATIENCE = 24  # evaluations without an improvement after which training ends
_SEGMENT = 0.64  # length of a segment (s)
_DISCOUNT_TIME = 1.5  # time over which future costs lose their weight (s)
_TAUGHT, _HELD_OUT = 8, 32  # number of episodes of the imitation, and of those of an evaluation
_WORSE, _SLOWER = 1.2, 0.5
"""Cost, over the least one, at which training returns to the best policy; factor on the learning
rate then. The policy has lost arms that it controlled before."""
_SEED_DISTANCE = 1_000_000
"""Distance between the first seeds of two trainings; those of evaluations lie just before."""
_COST = "mean cost of a time step, over that of the imitation"


class Training:
    """Training of a policy for a scenario, of which the controller serves as a teacher only."""

    def __init__(self, scenario: Scenario, settings: TrainingSettings) -> None:
        self.scenario, self.settings = scenario, settings
        self._sampler = EpisodeSampler(scenario, settings.draw)
        plan = self._sampler.first.setup.plan
        self._observables = observables = self._sampler.observables
        random = np.random.default_rng(settings.seed)
        speed = max_speeds(plan)[np.array(observables.driven)]
        entries = len(observables.entries)
        self._blank = new_policy(entries, speed, plan.period, random)
        step = float(plan.system.time_step)
        self._segment = RolloutSegment(
            observables.observation,
            StageCost.of(plan, observables),
            jnp.asarray(np.exp(-step / _DISCOUNT_TIME)),
            min(max(2, round(_SEGMENT / step)), scenario.simulation.steps),
        )
        self._optimisers, self._learners = Optimisers(max(1, settings.updates)), Learners()
        first = _SEED_DISTANCE * (1 + settings.seed)
        neural = Neural(observables.observation, self._blank)
        self._episodes = EpisodePool(self._sampler, settings.arms, neural, first)
        self._held_out = [self._episodes.start(first - 1 - k) for k in range(_HELD_OUT)]
        self._last_taught = first - 1 - _HELD_OUT
        """Largest seed of the imitation; its other seeds come before."""
        self.updates, self.lost = 0, 0  # number of updates, and of segments that failed
        self.rows: list[tuple[float, float, float]] = []
        """Updates, cost and RMS error (m) at each evaluation."""
        self.learner = self.best = new_learner(self._blank, self._optimisers, random)
        """The present learner, and the one of the evaluation of least cost."""

    def begin(self) -> None:
        """Imitate the teacher, and evaluate the result."""
        values = {"control.kind": self.settings.teacher}
        loop, _ = closed_loop(self.scenario.with_values(values))
        pupil = Neural(self._segment.observation, self._blank)
        steps, seed = self.scenario.simulation.steps, self.settings.seed
        try:
            arms = [self._episodes.start(self._last_taught - k) for k in range(_TAUGHT)]
            policy = imitate(loop.controller, pupil, arms, steps, seed, self._learners)
        except FloatingPointError as error:
            text = f"under the teacher {error}; try a smaller simulation.time_step"
            raise RuntimeError(text) from error
        cost, _ = self._mean(policy)
        if np.isfinite(cost):  # the cost of the imitation is the unit of all later costs
            self._set_unit(cost)
        self.learner = self.best = eqx.tree_at(lambda x: x.policy, self.learner, policy)
        self._evaluate()

    def _set_unit(self, cost: float) -> None:
        stage_cost = eqx.tree_at(lambda p: p.unit, self._segment.stage_cost, jnp.asarray(cost))
        self._segment = replace(self._segment, stage_cost=stage_cost)

    @property
    def best_row(self) -> int:
        """Index of the evaluation of least cost, the first of several."""
        costs = [cost if np.isfinite(cost) else np.inf for _, cost, _ in self.rows]
        return int(np.argmin(costs))

    @property
    def least(self) -> float:
        """Cost of the best policy; infinite or not a number if no policy could be run."""
        return self.rows[self.best_row][1]

    @property
    def over(self) -> bool:
        """Whether all updates are done, or improvements have ceased."""
        since = len(self.rows) - 1 - self.best_row
        return self.updates >= self.settings.updates or since >= _PATIENCE

    def run(self, report: Callable[[Training], None], stop: Callable[[], bool]) -> bool:
        """Train until training is over; return whether ``stop`` interrupted it."""
        while not self.over:
            if stop():
                return True
            self.update()
            report(self)
        return False

    def update(self) -> None:
        """Improve the policy by a segment of all arms."""
        self.updates += 1
        self.learner, found = gradient_update(
            self._optimisers, self._segment, self.learner, self._episodes.arms, self._learners
        )
        costs = [np.asarray(each.cost) for each in found]
        self.lost += sum(not np.isfinite(cost).all() for cost in costs)
        diverged = np.array([not np.mean(cost) < DIVERGED_COST for cost in costs])
        self._episodes.advance([each.end for each in found], self._segment.steps, diverged)
        if self.updates % EVALUATION_INTERVAL == 0 or self.updates == self.settings.updates:
            self._evaluate()

    def _mean(self, policy: Policy) -> tuple[float, float]:
        """Return the cost of a policy in the held-out episodes, and its RMS error (m)."""
        segment = replace(self._segment, steps=self.scenario.simulation.steps)
        found = self._learners.run(evaluate, (segment, policy), self._held_out)
        cost, error = np.mean(np.array(found, float), axis=0)
        return float(cost), float(np.sqrt(error))

    def _evaluate(self) -> None:
        self.rows.append((self.updates, *self._mean(self.learner.policy)))
        if self.best_row == len(self.rows) - 1:
            self.best = self.learner
        elif not self.rows[-1][1] <= _WORSE * self.least:
            self.learner = replace(self.best, rate_factor=_SLOWER * self.learner.rate_factor)

    @property
    def description(self) -> Description:
        """Observations and commands of the policy, and the scenario of its training."""
        observables = self._observables
        return Description(
            named(observables.entries),
            named(observables.actions),
            self.scenario.control_rate_hz,
            self._blank.kept.size,
            [layer.bias.size for layer in self._blank.layers],
            {key: each for key, each in self.scenario.to_dict().items() if key in PHYSICAL},
            {key: list(pair) for key, pair in self._sampler.ranges.items()},
        )

    def write(self, path: Path) -> None:
        """Write the best policy."""
        write_policy(path, self.best.policy, self.description)

    def dataset(self, status: str) -> xr.Dataset:
        """Return the course of the training."""
        update, cost, error = np.array(self.rows, float).T
        settings = {name: value for name, value in asdict(self.settings).items() if name != "draw"}
        own = {"status": status, "draw": json.dumps(self._sampler.ranges), "lost": self.lost}
        return xr.Dataset(
            {
                "cost": ("look", cost, {"units": "1", "long_name": _COST}),
                "error": ("look", error, {"units": "m", "long_name": "RMS error of the tip"}),
            },
            {"update": ("look", update.astype(int))},
            describe(self.scenario) | settings | own,
        )

    def save(self, path: Path) -> None:
        """Save a checkpoint: numbers only, no code."""
        state: dict[str, Any] = {
            "about": np.frombuffer(json.dumps(self._header).encode(), np.uint8),
            "counts": np.array([self.updates, self.lost]),
            "unit": np.asarray(self._segment.stage_cost.unit),
            "rows": np.array(self.rows, float),
            **{f"learner_{k}": x for k, x in enumerate(arrays_of(self.learner))},
            **{f"good_{k}": x for k, x in enumerate(arrays_of(self.best))},
            **{f"stage_{name}": x for name, x in self._episodes.arrays().items()},
        }
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **state)

    def restore(self, path: Path) -> None:
        """Continue from a checkpoint."""
        if checkpoint_header(path):
            self.check_same(path, "omit --resume")
        try:
            with np.load(path, allow_pickle=False) as file:
                self._set(dict(file))
        except Exception as error:  # numpy and zipfile raise many exceptions on damage
            text = f"cannot be resumed ({error!r}). Omit --resume to start a new training."
            raise refusal(str(path), text) from error

    def check_same(self, path: Path, remedy: str) -> None:
        """Refuse the checkpoint of another training, naming the difference."""
        header = checkpoint_header(path)
        for key, given in self._header.items():
            saved = header.get(key)
            if given == saved:
                continue
            if key == "scenario":
                text = "is of another scenario. Use the same scenario and --set, or"
            else:
                text = f"is of another training: got {key} {shown(given)}; must be {shown(saved)}."
                text += " Use the same settings, or"
            raise refusal(str(path), f"{text} {remedy}.")

    def _set(self, saved: dict[str, np.ndarray]) -> None:
        self.learner = _restore(self.learner, saved, "learner")
        self.best = _restore(self.best, saved, "good")
        self.updates, self.lost = map(int, saved["counts"])
        self.rows = [(update, cost, error) for update, cost, error in saved["rows"].tolist()]
        self._set_unit(float(saved["unit"]))
        prefix = "stage_"
        self._episodes.restore(
            {name.removeprefix(prefix): x for name, x in saved.items() if name.startswith(prefix)}
        )

    @property
    def _header(self) -> dict[str, Any]:
        settings = {f"--{name}": each for name, each in asdict(self.settings).items()}
        draw = {key: list(pair) for key, pair in self._sampler.ranges.items()}
        header = {"crinoid": __version__, "scenario": self.scenario.to_toml()}
        return header | settings | {"--draw": draw}


def checkpoint_header(path: Path) -> dict[str, Any]:
    """Return scenario and settings of a checkpoint; empty if it is not of a training."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return dict(json.loads(file["about"].tobytes()))
    except Exception:  # numpy and zipfile raise many exceptions on damage
        return {}


def _restore(tree: Any, saved: dict[str, Float[np.ndarray, ...]], name: str) -> Any:
    form = TreeForm(tree)
    arrays = [jnp.asarray(saved[f"{name}_{k}"]) for k in range(len(form.shapes))]
    if [(each.shape, each.dtype) for each in arrays] != form.shapes:
        raise ValueError("arrays of other shapes")
    return form.tree(arrays)
