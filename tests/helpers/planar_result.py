"""Results of planar arms that look like runs, made without one."""

import tomllib

import numpy as np

from helpers.made_results import moving_run, with_obstacles


def swaying_arm(
    *,
    records=201,
    duration=20.0,
    nodes=21,
    length=0.5,
    tilt_deg=0.0,
    sway=0.05,
    flow=0.2,
    gust=0.06,
    driven=True,
    moving_target=False,
    seed=0,
    status="ok",
):
    """Make a result that looks like an arm swaying in its first bending mode in a current."""
    rng = np.random.default_rng(seed)
    time = np.linspace(0.0, duration, records) if records > 1 else np.zeros(1)
    arc = np.linspace(0.0, length, nodes)
    edge = length / (nodes - 1)
    frequency = np.array([0.11, 0.23, 0.41, 0.63, 0.9, 1.3])[:, None]
    waves = np.sin(2 * np.pi * (frequency * time + rng.uniform(size=(6, 1))))
    unsteady = (waves / (1 + 2 * frequency)).sum(axis=0)
    amplitude = sway * (0.4 + 0.6 * unsteady)
    slide = 0.3 * amplitude if driven else np.zeros_like(time)
    tilt = -0.8 * amplitude / length if driven else np.zeros_like(time)

    # Edge angles grow like those of a cantilever, so the arm keeps its length exactly.
    middle = (np.arange(nodes - 1) + 0.5) / (nodes - 1)
    mode = 3 * middle - 3 * middle**2 + middle**3
    angle = np.deg2rad(tilt_deg) + tilt[:, None] + 1.4 * amplitude[:, None] / length * mode
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    base = np.stack([slide, np.full_like(time, -10.0)], axis=-1)[:, None]
    position = np.concatenate([base, base + edge * np.cumsum(tangent, axis=1)], axis=1)
    curvature = np.zeros((records, nodes))
    curvature[:, 1:-1] = np.diff(angle, axis=1) / edge

    tip = position[:, -1]
    target = np.broadcast_to(tip[0], tip.shape).copy()
    if moving_target:
        target += 0.04 * np.stack([np.sin(0.6 * time), np.cos(0.6 * time) - 1], axis=-1)
    current = np.zeros((records, nodes, 2))
    if flow:
        current[..., 0] = flow * (1 + 0.3 * arc / length) + gust * unsteady[:, None]
        current[..., 1] = 0.5 * gust * np.roll(unsteady, 7)[:, None]
    pose = np.stack([slide, np.zeros_like(time), tilt], axis=-1)
    return moving_run(
        time,
        arc,
        position,
        {1: -1e-4 * time, 2: 2e-3 * slide, 4: 1e-4 * (unsteady - unsteady[0])},
        tangent=tangent,
        curvature=curvature,
        tip_target=target,
        tip_angle=angle[:, -1],
        tip_angle_target=np.full(records, angle[0, -1]),
        base_command=np.roll(pose, -2, axis=0),
        base_pose=pose,
        base_force=np.stack([0.2 + amplitude, -0.3 + 0.5 * amplitude], axis=-1),
        base_moment=0.05 * amplitude,
        flow_velocity=current,
        attrs={
            "title": "Station keeping in a turbulent current",
            "scenario": f"[base]\ntilt_deg = {tilt_deg:.1f}\n",
            "seed": seed,
            "status": status,
        },
    )


OBSTACLES = """
obstacle = [
  {kind="sphere", position=[0.3, -9.9], radius=0.03, mass=0.1},
  {kind="cylinder", position=[0.2, -10.1], radius=0.02},
  {kind="cylinder", position=[0.6, -10.0], radius=0.02, axis=[0.1, 0.0, 1.0]},
  {kind="capsule", position=[0.4, -10.2], radius=0.02, length=0.1, axis=[1.0, 0.0, 1.0]},
  {kind="plane", position=[0.0, -10.3], normal=[0.1, 1.0]},
]
"""


def among_obstacles(*, drift=0.01, touching=True, **changes):
    """Put one obstacle of each kind beside a swaying arm; all drift, the first two touch it."""
    dataset = swaying_arm(**changes)
    time = dataset["time"].values
    start = np.array([table["position"] for table in tomllib.loads(OBSTACLES)["obstacle"]])
    force = np.zeros((time.size, len(start), 2))
    if touching:
        force[time.size // 3 : time.size // 2, 0] = [0.5, 2.0]
        force[time.size // 2 :, 1, 1] = -1.0
    velocity = np.tile(drift * np.array([0.3, 1.0]), (len(start), 1))
    return with_obstacles(dataset, start, velocity, force).assign_attrs(scenario=OBSTACLES)


THREADS = """
[[chamber]]
max_pressure = 80e3
area = 1e-4
offset = 0.01
span = [0.5, 1.0]
[[tendon]]
name = "lower"
max_tension = 4.0
pretension = 0.5
offset = 0.012
angle_deg = 180.0
"""


def with_threads(dataset):
    """Add a chamber at shares that rise from 0 to 1, and a tendon at shares that fall to 0."""
    share = np.linspace(0.0, 1.0, dataset.sizes["time"])
    state = np.stack([share, 1.0 - share], axis=1)
    added = {"actuator_state": state, "actuator_command": np.zeros_like(state)}
    names = {"input": ["chamber_0", "lower"], "input_unit": ("input", ["1", "1"])}
    arrays = {name: (("time", "input"), values) for name, values in added.items()}
    return (
        dataset.assign(arrays)
        .assign_coords(names)
        .assign_attrs(scenario=dataset.attrs["scenario"] + THREADS)
    )
