"""Built-in policies compared with PID and LQG, on arms and in water outside of their training.

    python benchmarks/policies.py [plane] [space] [reach]

`plane` and `space`: `station-keeping` and `station-keeping-3d` on 20 seeds, each with a Young's
modulus within 30 % and half to one and a half times the currents; then in one and a half times the
largest of these currents, beyond the training of the policies. LQG knows the true stiffness of each
arm and the size of its currents, PID and policy do not. Prints the RMS error of the tip (mean over
the runs, and largest), the ratio of the policy's to the others', the number of lost runs (a tip
more than a tenth of the arm's length off at some time), and the speeds of the inputs. `reach`: 100
draws of load, target, stiffness and current in `reach-under-load`, and how often the tip stays
within 2 % of the arm's length for the last two seconds.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

import numpy as np

import crinoid
from crinoid.results.metrics import input_speed, tip_error
from crinoid.results.result import Result
from crinoid.scenario import Scenario
from crinoid.simulation.batch import run_batch

KINDS = ("pid", "lqg", "neural")
STATION = {"plane": "station-keeping", "space": "station-keeping-3d"}
SEEDS, TRIALS = 20, 100
LARGEST = 1.5
"""Largest drawn currents, over those of the scenario."""
LOST = 0.1
NEAR, LAST = 0.02, 2.0

Measures = tuple[float, float, list[float]]


def currents(scenario: Scenario, factor: float) -> dict[str, float]:
    """Return the values of all currents times a factor."""
    found = {}
    for index, flow in enumerate(scenario.to_dict()["flow"]):
        name = "amplitude" if "amplitude" in flow else "mean"
        found |= {f"flow.{index}.{name}.{k}": factor * x for k, x in enumerate(flow[name])}
    return found


def measures(result: Result) -> Measures:
    """Return RMS (m) and largest error over the length, and RMS speeds of the commands."""
    error = tip_error(result)
    length = result.scenario.arm.length
    return error.rms, error.maximum / length, list(input_speed(result).values())


def station(which: str) -> None:
    """Print the errors of each controller in station keeping."""
    scenario = crinoid.load(STATION[which]).with_values({"control.compare": False})
    random = np.random.default_rng(2026)
    stiffness = scenario.arm.youngs_modulus * random.uniform(0.7, 1.3, SEEDS)
    drawn = random.uniform(0.5, LARGEST, SEEDS)
    for words, factors in (
        ("drawn currents", drawn),
        ("1.5 times the largest of them", np.full(SEEDS, 1.5 * LARGEST)),
    ):
        print(f"{STATION[which]}, {words}")
        found = {}
        for kind in KINDS:
            cases = [
                scenario.with_values(
                    {"control.kind": kind, "seed": seed, "arm.youngs_modulus": modulus}
                    | currents(scenario, factor)
                )
                for seed, (modulus, factor) in enumerate(zip(stiffness, factors, strict=True))
            ]
            found[kind] = measure(cases)
            print(f"    {kind:8}" + row_of(found[kind]), flush=True)
        ours = np.mean([each[0] for each in found["neural"]])
        for kind in KINDS[:-1]:
            print(
                f"    neural over {kind}: {ours / np.mean([each[0] for each in found[kind]]):.3f}"
            )


def measure(cases: Sequence[Scenario]) -> list[Measures]:
    """Run arms, and return the measures of each."""
    arms = [arm.taken for arm in run_batch(cases, measures)]
    assert all(arm is not None for arm in arms), "a run failed"
    return [arm for arm in arms if arm is not None]


def row_of(found: Sequence[Measures]) -> str:
    """Return a row of the table."""
    errors = 1e3 * np.array([each[0] for each in found])
    lost = sum(each[1] > LOST for each in found)
    effort = " ".join(f"{1e3 * x:.4g}" for x in np.mean([each[2] for each in found], axis=0))
    row = f"RMS error (mm): mean {errors.mean():.3g}, worst {errors.max():.3g}; lost {lost}"
    return f"{row}; speeds (mm/s, mrad/s): {effort}"


def reach() -> None:
    """Print the number of trials in which each controller reaches the target and stays there."""
    scenario = crinoid.load("reach-under-load").with_values({"control.compare": False})
    random = np.random.default_rng(2026)

    def near(result: Result) -> float:
        data = result.dataset
        last = data["time"] >= data["time"][-1] - LAST
        return float(data["tip_error"][last].max()) / result.scenario.arm.length

    draws = [
        {
            "seed": seed,
            "tool.mass": random.uniform(0.001, 0.3),
            "target.to.0": random.uniform(0.35, 0.47),
            "target.to.1": random.uniform(-10.4, -10.2),
            "arm.youngs_modulus": random.uniform(2.8e6, 5.2e6),
            "flow.0.mean.0": random.uniform(0.05, 0.25),
        }
        for seed in range(TRIALS)
    ]
    print("reach-under-load")
    for kind in KINDS:
        cases = [scenario.with_values({"control.kind": kind} | values) for values in draws]
        arms = [arm.taken for arm in run_batch(cases, near)]
        farthest = np.array([np.inf if arm is None else arm for arm in arms])
        print(
            f"    {kind:8}within {NEAR:.0%} of the length in {np.sum(farthest <= NEAR)} of "
            f"{TRIALS}; median {np.median(farthest):.2%}, worst {farthest.max():.2%}",
            flush=True,
        )


if __name__ == "__main__":
    for name in sys.argv[1:] or [*STATION, "reach"]:
        reach() if name == "reach" else station(name)
