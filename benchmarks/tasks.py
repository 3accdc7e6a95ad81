"""How well the arm does its tasks under load: each scenario's conditions, over several seeds.

    python benchmarks/tasks.py [--seeds 10] [SCENARIO ...]

``trace``: RMS error over the radius of the circle, after the first 2 s. ``reach``: the longest time
from when a target is given to when the tip stays within 1 % of the arm's length. ``sampling``: the
largest error over 5 s while the tip takes up a load (over the length), the largest force of the
touch, how long it lasted, and the last error after the retreat.
"""

import argparse
from collections.abc import Callable

import numpy as np
import xarray as xr

import crinoid

NEAR = 0.01
"""Error over the arm's length that counts as none."""
TRACED = 0.02
"""RMS error over the radius."""
REACHED = 3.0
"""Time to a target (s)."""
GENTLE = 0.5
"""Force of a touch (N)."""
HOLD = (6.0, 11.0)
TOUCH = (11.0, 17.5)

Found = dict[str, tuple[float, bool]]


def trace(data: xr.Dataset, scenario: crinoid.Scenario) -> Found:
    assert scenario.target.radius is not None
    error = data["tip_error"].values[data["time"].values >= 2.0]
    share = float(np.sqrt(np.mean(error**2))) / scenario.target.radius
    return {"RMS error / radius": (share, share <= TRACED)}


def reach(data: xr.Dataset, scenario: crinoid.Scenario) -> Found:
    time, error = data["time"].values, data["tip_error"].values
    # the path stands still in between: it sets off for a target, and for the next one
    given = np.array(scenario.target.time)[1:-1:2]
    longest = 0.0
    for begin, leave in zip(given, [*given[1:], np.inf], strict=True):
        between = (time >= begin) & (time < leave)
        away = time[between & (error > NEAR * scenario.arm.length)]
        longest = max(longest, float(away[-1]) - begin if away.size else 0.0)
    return {"time to a target (s)": (longest, longest <= REACHED)}


def sampling(data: xr.Dataset, scenario: crinoid.Scenario) -> Found:
    time = data["time"].values
    error = data["tip_error"].values / scenario.arm.length
    force = np.linalg.norm(data["contact_force"].values, axis=-1).reshape(time.size, -1).max(axis=1)
    held = float(error[(time >= HOLD[0]) & (time <= HOLD[1])].max())
    most, outside = float(force.max()), force[(time < TOUCH[0]) | (time > TOUCH[1])]
    touched = float(np.mean(force > 0) * time[-1])
    last = float(error[time >= time[-1] - 1.0].max())
    return {
        "error held / length": (held, held <= NEAR),
        "force of the touch (N)": (most, 0 < most < GENTLE),
        "time of the touch (s)": (touched, touched > 0 and not np.any(outside > 0)),
        "error after / length": (last, last <= NEAR),
    }


TASKS: dict[str, Callable[[xr.Dataset, crinoid.Scenario], Found]] = {
    name + space: task
    for name, task in {"trace": trace, "reach": reach, "sampling": sampling}.items()
    for space in ("", "-3d")
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="*", default=list(TASKS))
    parser.add_argument("--seeds", type=int, default=10)
    given = parser.parse_args()
    for name in given.scenario:
        rows: dict[str, list[tuple[float, bool]]] = {}
        for seed in range(given.seeds):
            scenario = crinoid.load(name).with_values({"seed": seed, "control.compare": False})
            result = crinoid.simulate(scenario)
            done = result.dataset.attrs["status"] == "ok"
            for key, (value, good) in TASKS[name](result.dataset, scenario).items():
                rows.setdefault(key, []).append((value, good and done))
        for key, values in rows.items():
            numbers, good = zip(*values, strict=True)
            print(
                f"{name:12} {key:24} median {np.median(numbers):8.3g}  worst {max(numbers):8.3g}  "
                f"{sum(good)} of {len(good)}",
                flush=True,
            )


if __name__ == "__main__":
    main()
