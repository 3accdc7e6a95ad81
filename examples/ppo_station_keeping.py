"""PPO of Stable-Baselines3 on crinoid's vector environment, compared with crinoid's controllers.

    pip install "crinoid[learn]" stable-baselines3
    python examples/ppo_station_keeping.py [POLICY]

Trains on `station-keeping`, then prints the RMS error of the tip on ten held-out seeds, for PPO,
PID, LQG, and for POLICY, a file of ``crinoid train``, if given.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

import crinoid

TASK = "station-keeping"
ARMS, STEPS = 32, 1_000_000
FIRST_SEED = 1000
"""Seed of the first draw in training."""
HELD_OUT = range(200, 210)
"""Seeds of the comparison, used neither in training nor to choose settings."""
SETTINGS = {
    "n_steps": 256,
    "batch_size": 1024,
    "n_epochs": 6,
    "gamma": 0.99,
    "learning_rate": lambda left: 1e-3 * left,
    # noise that depends on the observation: a servo would average out noise of single steps
    "use_sde": True,
    "policy_kwargs": {"log_std_init": -4.0},
}
"""Chosen by nine trainings, on seeds 0 to 9 and 100 to 109."""


class Adapter(VecEnv):
    """A vector environment of Gymnasium for Stable-Baselines3, with actions from -1 to 1.

    In Gymnasium the next episode starts a step after the last one; Stable-Baselines3 expects it to
    start in the same step. So if all arms end together, as with a time limit, the next step
    follows immediately. An arm that ends alone keeps its last observation for one more step, whose
    action has no effect and whose reward is 0, as the other arms cannot wait.
    """

    def __init__(self, env: VectorEnv, seed: int) -> None:
        space = env.single_action_space
        self.env, self._seed = env, seed
        self._low, self._range = space.low.astype(float), space.high - space.low.astype(float)
        moves = gymnasium.spaces.Box(-1.0, 1.0, space.shape, np.float32)
        super().__init__(env.num_envs, env.single_observation_space, moves)

    def reset(self) -> np.ndarray:
        seen, _ = self.env.reset(seed=self._seed)
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        self._commands = self._low + (actions + 1.0) / 2.0 * self._range

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        seen, reward, terminated, truncated, info = self.env.step(self._commands)
        over = terminated | truncated
        infos = [{"error": error} for error in info["error"]]
        for arm in np.flatnonzero(over):
            infos[arm]["terminal_observation"] = seen[arm]
            infos[arm]["TimeLimit.truncated"] = bool(truncated[arm] and not terminated[arm])
        if over.all():
            seen, *_ = self.env.step(self._commands)
        return seen, reward, over, infos

    def close(self) -> None:
        self.env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise NotImplementedError("arms share their attributes")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **given: Any) -> Any:
        raise NotImplementedError("arms share their methods")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


def learned() -> tuple[PPO, VecNormalize]:
    """Train."""
    arms = Adapter(crinoid.make_vec_env(TASK, ARMS, draws=4 * ARMS), FIRST_SEED)
    arms = VecNormalize(arms, gamma=SETTINGS["gamma"])
    model = PPO("MlpPolicy", arms, **SETTINGS, seed=0, device="cpu")
    model.learn(STEPS)
    return model, arms


def errors_of(model: PPO, scaling: VecNormalize) -> np.ndarray:
    """Return the RMS error of the tip in each held-out episode (m)."""
    count = len(HELD_OUT)
    arms = Adapter(crinoid.make_vec_env(TASK, count, draws=count), HELD_OUT[0])
    seen, over, errors = arms.reset(), np.zeros(count, bool), []
    while not over.any():
        actions, _ = model.predict(scaling.normalize_obs(seen), deterministic=True)
        seen, _, over, infos = arms.step(actions)
        errors.append([info["error"] for info in infos])
    assert over.all(), "a run failed"
    return np.sqrt(np.mean(np.square(errors), axis=0))


def main(policy: str | None = None) -> None:
    before = time.perf_counter()
    found = {"ppo": errors_of(*learned())}
    print(f"trained for {STEPS} steps in {time.perf_counter() - before:.0f} s")
    for kind in ("none", "pid", "lqg", *(["neural"] if policy else [])):
        given = {"control.kind": kind, "control.compare": False, "control.neural.weights": policy}
        runs = crinoid.simulate_batch(crinoid.load(TASK).with_values(given), seeds=list(HELD_OUT))
        found[kind] = runs["rms_error"].values
    for kind, errors in found.items():
        mean, worst = 1e3 * errors.mean(), 1e3 * errors.max()
        print(f"{kind:7}RMS tip error {mean:6.2f} mm, worst {worst:6.2f} mm")


if __name__ == "__main__":
    main(*sys.argv[1:])
