"""Random arms that curl up among obstacles, onto themselves and onto a floating hull.

``python tests/dynamics/test_random_contacts.py 200`` runs so many of them, and prints what their
contacts cost: iterations of Newton's method over those of the same run without contact.
"""

import sys

import numpy as np
import pytest

import crinoid

RUNS = 4
"""Number of runs of the test, in space; by hand every second run is in the plane."""
pytestmark = pytest.mark.usefixtures("optimised")

RADIUS, NODES, DEPTH = 0.01, 13, 10.0


def tables(dimension, seed):
    """Return the tables of a random run; all of a dimension have the same structure.

    Every second arm in space winds onto itself and the hull; currents carry the others past them.
    """
    random = np.random.default_rng([dimension, seed])

    def place(low, high):
        found = random.uniform(low, high, 3) - [0.0, 0.0, DEPTH]
        return [float(x) for x in (found[[0, 2]] if dimension == 2 else found)]

    pressure, friction = random.uniform(5e4, 2.5e5), random.uniform(0.0, 0.5)
    height = float(random.uniform(0.15, 0.25))
    direction = random.normal(size=dimension)
    current = 0.3 * random.uniform() * direction / np.linalg.norm(direction)
    chamber = {
        "name": "curl",
        "offset": 0.6 * RADIUS,
        "area": 0.6 * RADIUS**2,
        "angle_deg": 180.0,
        "max_pressure": float(pressure),
        "time_constant": 0.05,
        "schedule": {"time": [0.0, float(random.uniform(0.1, 0.4))], "share": [0.0, 1.0]},
    }
    found = {
        "arm": {
            "dimension": dimension,
            "length": 0.55,
            "nodes": NODES,
            "radius": RADIUS,
            "density": 1080.0,
            "rest_curvature": float(random.uniform(7.0, 9.0)),
            "youngs_modulus": float(random.uniform(0.5e6, 1.5e6)),
            "damping_time": 0.02,
        },
        "base": {"position": [0.0] * (dimension - 1) + [-DEPTH]},
        "vehicle": {
            "mass": float(random.uniform(2.0, 10.0)),
            "inertia": 0.1,
            "offset": [-0.15] + [0.0] * (dimension - 1),
            "hold": "thrusters",
            "hull": {"length": 0.4, "diameter": 0.1},
        },
        "contact": {"self": True, "friction": float(friction)},
        "obstacle": [
            {
                "kind": "sphere",
                "position": place([-0.02, -0.02, 0.09], [0.03, 0.02, 0.13]),
                "radius": float(random.uniform(0.02, 0.03)),
                "mass": float(random.uniform(0.05, 0.5)),
                "friction": float(friction),
            },
            {
                "kind": "plane",
                "position": [0.0] * (dimension - 1) + [-DEPTH - height],
                "normal": [0.0] * (dimension - 1) + [1.0],
                "friction": float(friction),
            },
        ],
        "flow": [{"kind": "uniform", "velocity": current.tolist(), "ramp_time": 0.2}],
        "chamber": [chamber],
        "simulation": {"duration": 0.8, "time_step": 0.01, "start": "rest"},
    }
    if dimension == 3 and seed % 2:
        wind(found)
    return found


def wind(given):
    """Let the arm wind up in a plane, by nearly two turns, onto itself and the hull alone."""
    arm, chamber = given["arm"], given["chamber"][0]
    stiffness = arm["youngs_modulus"] * np.pi / 4 * RADIUS**4
    moment = (20.0 - arm["rest_curvature"]) * stiffness
    chamber["max_pressure"] = moment / (chamber["area"] * chamber["offset"])
    given["flow"][0]["velocity"][1] = 0.0
    given["obstacle"][0]["position"][0] += 0.6  # out of its way


def iterations(data):
    """Return the sum of the iterations of Newton's method."""
    return int(data["newton_iterations"].values.sum())


def without(given, *names):
    """Return tables without some of them."""
    left = {key: value for key, value in given.items() if key not in names}
    vehicle = {key: value for key, value in given["vehicle"].items() if key not in names}
    return left | {"vehicle": vehicle}


def faults(data):
    """Return what is wrong with a run, in words."""
    found = [] if data.attrs["status"] == "ok" else [f"it ended: {data.attrs['status']}"]
    for name in ("self_gap", "hull_gap", "contact_closest"):
        deep = -float(data[name].min()) / RADIUS if name in data else 0.0
        if deep > 0.05:
            found.append(f"{name} is {100 * deep:.1f} % of the radius deep")
    return found


def run(given):
    return crinoid.simulate(crinoid.Scenario.from_dict(given)).dataset


@pytest.mark.release
def test_random_runs_with_every_contact_neither_fail_nor_penetrate():
    runs = [run(tables(3, seed)) for seed in range(RUNS)]
    assert not [fault for data in runs for fault in faults(data)]
    for name in ("hull_force", "self_force", "contact_time"):
        assert max(float(np.abs(data[name]).max()) for data in runs) > 0  # some touch


if __name__ == "__main__":
    ratios, failed = [], 0
    for index in range(int(sys.argv[1])):
        given = tables(2 + index % 2, index // 2)
        touching = without(given, "obstacle")
        every, some, none = map(run, (given, touching, without(touching, "contact", "hull")))
        ratios.append([iterations(data) / iterations(none) for data in (every, some)])
        wrong = [*faults(every), *faults(some)]
        failed += bool(wrong)
        print(index, *wrong, *(f"{ratio:.1f}" for ratio in ratios[-1]), flush=True)
    print(f"runs with a fault: {failed}. Iterations over those without contact:")
    for name, each in zip(
        ("every contact", "itself and the hull"), np.array(ratios).T, strict=True
    ):
        median, most = np.median(each), each.max()
        print(f"{name}: median {median:.1f}, most {most:.1f}, over 5 in {np.sum(each > 5)} runs")
