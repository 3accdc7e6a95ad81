"""Results in space that look like runs, for tests of what reads them."""

import tomllib

import numpy as np

from crinoid.foundation.result_variables import quantity
from crinoid.recording.solid_shapes import sheet
from helpers.made_results import moving_run, with_obstacles


def frame(pan, tilt, roll):
    """Columns t, m_1 and m_2 of the base, by the angles (rad) of one instant."""
    ahead = np.array([np.cos(tilt) * np.cos(pan), np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    port = np.array([-np.sin(pan), np.cos(pan), 0.0])
    up = np.cross(ahead, port)
    first = np.cos(roll) * port + np.sin(roll) * up
    return np.stack([ahead, first, np.cross(ahead, first)], axis=1)


def rotation(vector):
    """Matrix of a turn by a vector (rad; Rodrigues)."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle if angle > 0 else vector
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def curling_arm(
    *,
    records=61,
    duration=12.0,
    nodes=31,
    length=0.5,
    pan_deg=0.0,
    tilt_deg=0.0,
    bend=(1.2, 2.2),
    twist=5.0,
    flow=(0.15, 0.25, 0.0),
    driven=True,
    moving_target=False,
    status="ok",
):
    """Make a result of an arm that curls both ways and twists more and more, on a moving base."""
    time = np.linspace(0.0, duration, records) if records > 1 else np.zeros(1)
    part = time / duration if duration else np.ones(1)
    arc = np.linspace(0.0, length, nodes)
    edge = length / (nodes - 1)
    grown = 0.3 + 0.7 * part + 0.12 * np.sin(2 * np.pi * 0.4 * time)
    along = 1 - 0.4 * arc / length
    curls = bend * np.stack([np.sin(2.5 * part), grown], axis=-1)
    kappa = curls[:, None] * along[:, None]
    twists = twist * np.multiply.outer(part, 1 - arc / length)
    swings = np.array([0.03, 0.05, 0.0, 0.20, -0.15, 0.30]) if driven else np.zeros(6)
    pose = swings * np.sin(np.outer(time, [0.8, 0.5, 0.0, 0.4, 0.6, 0.3]))
    position, tangent, director = (np.zeros((records, n, 3)) for n in (nodes, nodes - 1, nodes - 1))
    for record in range(records):
        pan, tilt, roll = pose[record, 3:] + np.deg2rad([pan_deg, tilt_deg, 0.0])
        turned = frame(pan, tilt, roll)
        position[record, 0] = np.array([0.0, 0.0, -10.0]) + pose[record, :3]
        for k in range(nodes - 1):
            # a turn about m_2 bends toward m_1, one about -m_1 toward m_2
            rate = [twists[record, k], -kappa[record, k, 1], kappa[record, k, 0]]
            step = edge if k else edge / 2
            turned = turned @ rotation(step * np.array(rate))
            tangent[record, k], director[record, k] = turned[:, 0], turned[:, 1]
            position[record, k + 1] = position[record, k] + edge * turned[:, 0]

    target = np.tile(position[0, -1], (records, 1))
    if moving_target:
        swing = np.stack([0 * time, np.sin(0.6 * time), np.cos(0.6 * time) - 1], axis=-1)
        target = target + 0.1 * length * swing
    direction = tangent[:, -1]
    unsteady = sum(np.sin(f * time + p) for f, p in [(0.7, 0.0), (1.9, 1.0), (4.3, 2.0)]) / 3
    profile = 1 + 0.4 * (position[..., 2:] + 10.0) / length
    water = np.asarray(flow) * profile * (1 + 0.3 * unsteady[:, None, None])
    force = np.stack([0.2 * unsteady, 0.5 + 0.1 * unsteady, -0.3 + 0.0 * time], axis=-1)
    return moving_run(
        time,
        arc,
        position,
        {1: -1e-4 * time},
        tangent=tangent,
        director=director,
        curvature=kappa,
        twist=(twists[:, 1:] + twists[:, :-1]) / 2,
        tip_target=target,
        tip_direction=direction,
        tip_direction_target=np.tile(direction[0], (records, 1)),
        tip_angle=np.arcsin(direction[:, 2]),
        base_command=np.roll(pose, -1, axis=0),
        base_pose=pose,
        base_force=force,
        base_moment=0.3 * np.roll(force, 1, axis=1),
        flow_velocity=water,
        flow_speed=np.linalg.norm(water, axis=-1),
        attrs={
            "title": "An arm curls and twists in a cross current",
            "scenario": "[arm]\ndimension = 3\n"
            f"[base]\ntilt_deg = {tilt_deg}\npan_deg = {pan_deg}\n",
            "seed": 0,
            "status": status,
        },
    )


OBSTACLES = """
obstacle = [
  {kind="sphere", position=[0.42, 0.12, -9.9], radius=0.045, mass=0.1},
  {kind="cylinder", position=[0.30, 0.24, -10.0], radius=0.02, axis=[0.0, 0.0, 1.0]},
  {kind="capsule", position=[0.2, -0.16, -9.95], radius=0.025, length=0.2, axis=[1.0, 1.0, 0.5]},
  {kind="plane", position=[0.0, 0.0, -10.2], normal=[0.0, 0.0, 1.0]},
]
"""
LOW, HIGH = np.array([-0.3, -0.4, -10.3]), np.array([0.7, 0.4, -9.5])
"""Corners of a box about the arm (m)."""


def among_obstacles(*, drift=0.004, obstacles=OBSTACLES, **changes):
    """Put obstacles around a curling arm; those that can, drift, and the first touches it."""
    dataset = curling_arm(**changes)
    time = dataset["time"].values
    tables = tomllib.loads(obstacles)["obstacle"]
    start = np.array([table["position"] for table in tables])
    free = np.array([table["kind"] in ("sphere", "capsule") for table in tables], dtype=float)
    velocity = drift * free[:, None] * np.array([0.5, 2.0, 1.0])
    force = np.zeros((time.size, len(start), 3))
    force[time.size // 3 : time.size // 2, 0] = [0.5, -0.3, 2.0]
    return with_obstacles(dataset, start, velocity, force).assign_attrs(
        scenario=obstacles + dataset.attrs["scenario"]
    )


SOLIDS = """
obstacle = [
  {kind="mesh", file="rock.stl", position=[0.35, 0.25, -10.1]},
  {kind="seabed", file="bed.nc", height="z", position=[0.0, 0.0, -10.4]},
  {kind="capsule", position=[0.2, -0.2, -9.95], radius=0.03, length=0.2, mass=0.4, axis=[1, 0, 0]},
]
"""
HULL = "[contact]\nself = true\n[vehicle.hull]\nlength = 0.6\ndiameter = 0.16\n"
ROCK = 0.08 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])


def among_solids(**changes):
    """Put a rock, a bed and a capsule that turns around a curling arm at a hull."""
    data = among_obstacles(obstacles=SOLIDS, **changes)
    rock = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    across = np.linspace(-0.6, 0.9, 7)
    points, facets = sheet(across, across, 0.05 * np.sin(9 * across)[:, None] * np.ones(7))
    turn = 1.5 * data["time"].values / data["time"].values[-1]
    axis = np.tile([1.0, 0.0, 0.0], (turn.size, 3, 1))
    axis[:, 2] = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    found = {
        "surface_point": np.concatenate([ROCK, points]),
        "surface_facet": np.concatenate([rock, facets + len(ROCK)]),
        "facet_obstacle": np.repeat([0, 1], [len(rock), len(facets)]),
        "obstacle_axis": axis,
    }
    data = data.assign({name: quantity(name, value, 3) for name, value in found.items()})
    return data.assign_attrs(scenario=data.attrs["scenario"] + HULL)
