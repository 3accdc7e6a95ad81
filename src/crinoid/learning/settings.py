"""How a policy is trained."""

from collections.abc import Mapping
from dataclasses import dataclass

from crinoid.learning.gradient import improve_by_gradient
from crinoid.learning.ppo import STEPS, improve_by_ppo
from crinoid.scenario import Mistake, ScenarioError, one_of, shown

METHODS = {"gradient": (improve_by_gradient, 3e-4, 1), "ppo": (improve_by_ppo, 1e-4, STEPS)}
"""How a policy is improved, the learning rate at first, and the steps of an update."""
TEACHERS = ("lqg", "mpc", "pid", "none")
_LARGEST = 1_000_000
"""Largest seed of a training."""


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
    """Keys of the scenario that each episode draws, with the smallest and the largest value; none
    if left out (`crinoid.learning.usual.usual_draws` is what the command takes)."""

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
        if self.seed > _LARGEST:
            text = f"got {self.seed}, takes a number up to {_LARGEST}"
            mistakes.append(Mistake("--seed", text))
        if mistakes:
            raise ScenarioError(mistakes)
