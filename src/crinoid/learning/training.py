"""Training: from a scenario to a policy, update by update; it can be stopped and gone on with."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.assembly.known import fastest
from crinoid.assembly.weights import Description, write_policy
from crinoid.control.neural import Neural
from crinoid.control.policy import Policy
from crinoid.dataset import describe
from crinoid.environment.draws import Draws
from crinoid.learning.gradient import improve_by_gradient
from crinoid.learning.imitation import imitated
from crinoid.learning.learner import Pace, new_learner
from crinoid.learning.network import new_policy
from crinoid.learning.ppo import SPREAD, improve_by_ppo
from crinoid.learning.price import Price
from crinoid.learning.stage import Arm, Crew, Stage, begun
from crinoid.learning.stretch import Course, trial
from crinoid.replacement import replacing
from crinoid.scenario import Mistake, Scenario, ScenarioError, one_of, shown
from crinoid.simulation import closed_loop
from crinoid.status import Status

METHODS = {"gradient": (improve_by_gradient, 3e-4), "ppo": (improve_by_ppo, 1e-4)}
"""How a policy is improved, and the learning rate at first."""
TEACHERS = ("lqg", "mpc", "pid", "none")
LOOKS = 25
"""Updates between two looks at how the policy does."""
_PATIENCE = 24
"""Looks without an improvement after which training ends."""
_STRETCH = 0.64
"""Length of a stretch (s)."""
_AHEAD = 1.5
"""Time in which what is to come loses its weight (s)."""
_TAUGHT, _HELD = 8, 8
"""Episodes of the imitation, and those that a policy is judged by."""
_APART = 1_000_000
"""Seeds of training are this far apart; what is held out comes before the first of them."""
_STRENGTHS = ("velocity", "amplitude", "mean", "standard_deviation", "significant_height")
_ERRORS = ("noise_position", "noise_angle_deg", "delay")
_ROWS = ("update", "cost", "error", "best")


@dataclass(frozen=True)
class Settings:
    """How a policy is trained."""

    method: str = "gradient"
    """One of `METHODS`."""
    teacher: str = "lqg"
    """Kind of controller that is imitated first."""
    arms: int = 16
    """Arms that are run between two updates."""
    updates: int = 1500
    seed: int = 0
    draw: Mapping[str, tuple[float, float]] | None = None
    """Keys of the scenario that each episode draws, with the smallest and the largest value."""

    def __post_init__(self) -> None:
        mistakes = [
            Mistake(f"--{name}", f"got {shown(value)}, takes {one_of(known)}")
            for name, value, known in (
                ("method", self.method, tuple(METHODS)),
                ("teacher", self.teacher, TEACHERS),
            )
            if value not in known
        ]
        mistakes += [
            Mistake(f"--{name}", f"got {value}, takes a number of {least} or more")
            for name, value, least in (
                ("arms", self.arms, 1),
                ("updates", self.updates, 0),
                ("seed", self.seed, 0),
            )
            if value < least
        ]
        if mistakes:
            raise ScenarioError(mistakes)


class Training:
    """The training of a policy, and what it has come to.

    Parameters
    ----------
    scenario
        What to train for; its controller counts no more than that of ``settings.teacher``.
    settings
        How.

    Raises
    ------
    RuntimeError
        If an arm finds no equilibrium to start from.
    ScenarioError
        If anything is wrong with the scenario, the draws or the teacher.
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
            min(max(2, round(_STRETCH / step)), scenario.simulation.steps),
        )
        self._improve, rate = METHODS[settings.method]
        self._pace, self._crew = Pace(rate, max(1, settings.updates)), Crew()
        first = _APART * (1 + settings.seed)
        neural = Neural(observables.observation, self._blank)
        self._stage = Stage(self._draws, settings.arms, neural, first)
        self._taught = [self._stage.episode(first - 1 - k) for k in range(_TAUGHT)]
        held = [self._stage.episode(first - 1 - _TAUGHT - k) for k in range(_HELD)]
        self._held = [Arm(each.loop, begun(each.loop, each.state)) for each in held]
        self.updates, self.lost = 0, 0
        """Updates that were made, and arms that could not go on."""
        self.rows: list[tuple[float, ...]] = []
        self.best = self._blank
        self.least = np.inf
        self._since = 0

    def begin(self) -> None:
        """Imitate the teacher, and look at how that does.

        Raises
        ------
        RuntimeError
            If no episode could be run under the teacher.
        ScenarioError
            If the scenario does not go with the teacher.
        """
        values = {"control.kind": self.settings.teacher}
        loop, _ = closed_loop(self.scenario.with_values(values))
        pupil = Neural(self._course.observation, self._blank)
        steps, seed = self.scenario.simulation.steps, self.settings.seed
        try:
            policy = imitated(loop.controller, pupil, self._taught, steps, seed, self._crew)
        except FloatingPointError as error:
            text = f"under the teacher {error}; try a smaller simulation.time_step"
            raise RuntimeError(text) from error
        cost, _ = self._look(policy)
        if np.isfinite(cost):  # what the imitation costs is one from here on
            price = eqx.tree_at(lambda p: p.unit, self._course.price, jnp.asarray(cost))
            self._course = replace(self._course, price=price)
        self.learner = new_learner(policy, SPREAD, self._pace, self._random)
        self._judge()

    @property
    def over(self) -> bool:
        """Whether all updates were made, or have not helped for long."""
        return self.updates >= self.settings.updates or self._since >= _PATIENCE

    def update(self) -> None:
        """Improve the policy by a stretch of all arms."""
        self.updates += 1
        arms = self._stage.arms
        self.learner, found = self._improve(
            self._pace, self._course, self.learner, arms, self._crew, self.updates
        )
        lost = np.array([not np.isfinite(np.asarray(each.cost)).all() for each in found])
        self.lost += int(lost.sum())
        self._stage.go_on([each.end for each in found], self._course.steps, lost)
        if self.updates % LOOKS == 0 or self.updates == self.settings.updates:
            self._judge()

    def _look(self, policy: Policy) -> tuple[float, float]:
        """Return the cost of a policy in episodes that are held out, and its RMS error (m)."""
        course = replace(self._course, steps=self.scenario.simulation.steps)
        found = self._crew.each(trial, (course, policy), self._held)
        cost = np.mean([float(each.cost) for each in found])
        return float(cost), float(np.sqrt(np.mean([float(each.error) for each in found])))

    def _judge(self) -> None:
        cost, error = self._look(self.learner.policy)
        better = cost < self.least
        self._since = 0 if better else self._since + 1
        if better:
            self.best, self.least = self.learner.policy, cost
        self.rows.append((self.updates, cost, error, self.least))

    @property
    def description(self) -> Description:
        """Observations and commands of the policy, and where it was trained."""
        return Description.of(self._observables, self.scenario, self._draws.ranges)

    def write(self, path: Path) -> None:
        """Write the best policy so far."""
        write_policy(path, self.best, self.description)

    def dataset(self) -> xr.Dataset:
        """Return how training went."""
        update, cost, error, best = np.array(self.rows, float).reshape(-1, len(_ROWS)).T
        finished = Status.OK.value if np.isfinite(self.least) else "no policy could be run"
        settings = {name: value for name, value in asdict(self.settings).items() if name != "draw"}
        return xr.Dataset(
            {
                "cost": (("look",), cost, {"units": "1", "long_name": "mean cost of a time step"}),
                "error": (("look",), error, {"units": "m", "long_name": "RMS error of the tip"}),
                "best": (("look",), best, {"units": "1", "long_name": "least cost so far"}),
            },
            {"update": ("look", update.astype(int))},
            describe(self.scenario)
            | settings
            | {
                "status": finished,
                "draw": json.dumps(self._draws.ranges),
                "lost": self.lost,
                "units_of_cost": "that of the imitation",
            },
        )

    def save(self, path: Path) -> None:
        """Save all that it takes to go on later: numbers only, no code."""
        state: dict[str, Any] = {
            "about": np.frombuffer(self._about.encode(), np.uint8),
            "counts": np.array([self.updates, self.lost, self._since]),
            "least": np.array(self.least),
            "unit": np.asarray(self._course.price.unit),
            "rows": np.array(self.rows, float),
            **{f"learner_{k}": x for k, x in enumerate(_leaves(self.learner))},
            **{f"best_{k}": x for k, x in enumerate(_leaves(self.best))},
            **{f"stage_{name}": x for name, x in self._stage.saved().items()},
        }
        with replacing(path) as temporary, temporary.open("wb") as file:
            np.savez(file, **state)

    def restore(self, path: Path) -> None:
        """Go on from what was saved.

        Raises
        ------
        ScenarioError
            If it is not of this training, or cannot be read.
        """
        try:
            with np.load(path, allow_pickle=False) as file:
                saved = dict(file)
            about = saved["about"].tobytes().decode()
        except Exception as error:  # numpy and zipfile tell of damage in many ways
            text = f"cannot be gone on with ({error}); takes --force to begin anew"
            raise ScenarioError([Mistake(str(path), text)]) from error
        if about != self._about:
            text = "is of other settings or another scenario; takes the same, or --force"
            raise ScenarioError([Mistake(str(path), text)])
        learner = new_learner(self._blank, SPREAD, self._pace, self._random)
        self.learner = _filled(learner, saved, "learner")
        self.best = _filled(self._blank, saved, "best")
        self.updates, self.lost, self._since = map(int, saved["counts"])
        self.least = float(saved["least"])
        self.rows = [tuple(row) for row in saved["rows"]]
        price = eqx.tree_at(lambda p: p.unit, self._course.price, jnp.asarray(saved["unit"]))
        self._course = replace(self._course, price=price)
        prefix = "stage_"
        self._stage.restore(
            {name.removeprefix(prefix): x for name, x in saved.items() if name.startswith(prefix)}
        )

    @property
    def _about(self) -> str:
        return json.dumps([self.scenario.to_toml(), asdict(self.settings)], sort_keys=True)


def usual_draws(scenario: Scenario) -> dict[str, tuple[float, float]]:
    """Return what episodes draw where nothing is said.

    Young's modulus 30 % up and down, and half to one and a half times the currents, the errors and
    the delay of the sensor, and the mass of a tool.
    """
    stiffness = scenario.arm.youngs_modulus
    found = {"arm.youngs_modulus": (0.7 * stiffness, 1.3 * stiffness)}
    document = scenario.to_dict()
    some = {
        f"flow.{index}.{name}": flow[name]
        for index, flow in enumerate(document.get("flow", []))
        for name in _STRENGTHS
        if name in flow
    }
    some |= {f"sensor.{name}": document.get("sensor", {}).get(name, 0.0) for name in _ERRORS}
    some["tool.mass"] = (document.get("tool") or {}).get("mass", 0.0)
    for key, value in some.items():
        parts = (
            {f"{key}.{k}": x for k, x in enumerate(value)}
            if isinstance(value, list)
            else {key: value}
        )
        for each, number in parts.items():
            if number:
                low, high = sorted((0.5 * number, 1.5 * number))
                found[each] = low, high
    return found


def _leaves(tree: Any) -> list[np.ndarray]:
    return [np.asarray(leaf) for leaf in jax.tree.leaves(tree)]


def _filled(tree: Any, saved: dict[str, Float[np.ndarray, ...]], name: str) -> Any:
    leaves, form = jax.tree.flatten(tree)
    arrays = [jnp.asarray(saved[f"{name}_{k}"], x.dtype) for k, x in enumerate(leaves)]
    return jax.tree.unflatten(form, arrays)


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
