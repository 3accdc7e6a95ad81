"""Random arms that curl up among obstacles, onto themselves and onto a floating hull.

``python tests/dynamics/test_random_contacts.py 200`` runs so many of them.
"""

import sys

import numpy as np
import pytest

import crinoid

RUNS = 6
"""Number of runs for each dimension."""
RADIUS, NODES, DEPTH = 0.012, 12, 10.0


def tables(dimension, seed):
    """Return the tables of a random run; all of a dimension have the same structure."""
    random = np.random.default_rng([dimension, seed])

    def place(low, high):
        found = random.uniform(low, high, 3) - [0.0, 0.0, DEPTH]
        return [float(x) for x in (found[[0, 2]] if dimension == 2 else found)]

    pressure, friction = random.uniform(5e4, 2e5), random.uniform(0.0, 0.5)
    height = float(random.uniform(0.15, 0.25))
    direction = random.normal(size=dimension)
    current = 0.3 * random.uniform() * direction / np.linalg.norm(direction)
    chamber = {
        "name": "curl",
        "offset": [0.6 * RADIUS] * 2,
        "area": 0.2 * RADIUS**2,
        "angle_deg": 180.0,
        "max_pressure": float(pressure),
        "time_constant": 0.1,
        "schedule": {"time": [0.0, float(random.uniform(0.1, 0.4))], "share": [0.0, 1.0]},
    }
    return {
        "arm": {
            "dimension": dimension,
            "length": 0.4,
            "nodes": NODES,
            "radius": RADIUS,
            "density": 1080.0,
            "youngs_modulus": float(random.uniform(1e5, 3e5)),
            "damping_time": 0.02,
        },
        "base": {"position": [0.0] * (dimension - 1) + [-DEPTH]},
        "vehicle": {
            "mass": float(random.uniform(2.0, 10.0)),
            "inertia": 0.1,
            "offset": [-0.15] + [0.0] * (dimension - 1),
            "hold": "thrusters",
            "hull": {"length": 0.3, "diameter": 0.08},
        },
        "contact": {"self": True, "friction": float(friction)},
        "obstacle": [
            {
                "kind": "sphere",
                "position": place([0.1, -0.05, 0.06], [0.35, 0.05, 0.12]),
                "radius": float(random.uniform(0.02, 0.035)),
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


def iterations(data):
    """Return the sum of the iterations of Newton's method."""
    return int(data["newton_iterations"].values.sum())


def faults(dimension, seed):
    """Return what is wrong with a run, in words."""
    touching = tables(dimension, seed)
    alone = {key: touching[key] for key in touching if key not in ("contact", "obstacle")}
    alone["vehicle"] = {key: touching["vehicle"][key] for key in alone["vehicle"] if key != "hull"}
    data, free = (
        crinoid.simulate(crinoid.Scenario.from_dict(each)).dataset for each in (touching, alone)
    )
    found = []
    if data.attrs["status"] != "ok":
        found.append(f"it ended: {data.attrs['status']}")
    for name in ("self_gap", "hull_gap", "contact_closest"):
        deep = -float(data[name].min()) / RADIUS
        if deep > 0.05:
            found.append(f"{name} is {100 * deep:.1f} % of the radius deep")
    ratio = iterations(data) / iterations(free)
    if ratio > 5.0:
        found.append(f"it needs {ratio:.1f} times as many iterations as without contact")
    pressed = [np.abs(data[name].values).max() for name in ("self_force", "hull_force")]
    return found, [*pressed, float(data["contact_time"].max()), ratio]


@pytest.mark.slow
@pytest.mark.parametrize("dimension", [2, 3])
def test_random_runs_with_every_contact_neither_fail_nor_penetrate(dimension):
    found = {seed: faults(dimension, seed) for seed in range(RUNS)}
    wrong = {seed: what for seed, (what, _) in found.items() if what}
    assert not wrong
    assert max(most[0] for _, most in found.values()) > 0  # arms touch themselves
    assert max(most[2] for _, most in found.values()) > 0  # and obstacles


if __name__ == "__main__":
    for index in range(int(sys.argv[1])):
        dimension, seed = 2 + index % 2, index // 2
        print(dimension, seed, *faults(dimension, seed), flush=True)
