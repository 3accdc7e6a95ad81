"""Results in space that look like runs, for tests of what reads them."""

import numpy as np

from crinoid.elements import WORKS
from crinoid.variables import quantity
from made_results import of_values


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
    title="An arm curls and twists in a cross current",
    status="ok",
):
    """Make a result of an arm that curls both ways and twists more and more, on a moving base."""
    time = np.linspace(0.0, duration, records) if records > 1 else np.zeros(1)
    part = time / duration if duration else np.ones(1)
    arc = np.linspace(0.0, length, nodes)
    edge = length / (nodes - 1)
    grown = 0.3 + 0.7 * part + 0.12 * np.sin(2 * np.pi * 0.4 * time)
    along = 1 - 0.4 * arc / length
    kappa = np.stack(
        [
            bend[0] * np.multiply.outer(np.sin(2.5 * part), along),
            bend[1] * np.multiply.outer(grown, along),
        ],
        axis=-1,
    )
    twists = twist * np.multiply.outer(part, 1 - arc / length)
    on = 1.0 if driven else 0.0
    pose = on * np.stack(
        [
            0.03 * np.sin(0.8 * time),
            0.05 * np.sin(0.5 * time + 0.4) - 0.05 * np.sin(0.4),
            0.0 * time,
            0.20 * np.sin(0.4 * time),
            -0.15 * np.sin(0.6 * time),
            0.30 * np.sin(0.3 * time),
        ],
        axis=-1,
    )
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

    def rate(values):
        return np.gradient(values, time, axis=0) if records > 1 else np.zeros_like(values)

    tip, target = position[:, -1], np.tile(position[0, -1], (records, 1))
    if moving_target:
        swing = np.stack([0 * time, np.sin(0.6 * time), np.cos(0.6 * time) - 1], axis=-1)
        target = target + 0.1 * length * swing
    direction = tangent[:, -1]
    unsteady = sum(np.sin(f * time + p) for f, p in [(0.7, 0.0), (1.9, 1.0), (4.3, 2.0)]) / 3
    profile = 1 + 0.4 * (position[..., 2:] + 10.0) / length
    water = np.asarray(flow) * profile * (1 + 0.3 * unsteady[:, None, None])
    velocity = rate(position)
    kinetic = 0.5 * edge * (velocity**2).sum(axis=(1, 2))
    elastic = 0.5 * 0.01 * edge * ((kappa**2).sum(axis=(1, 2)) + (twists**2).sum(axis=1))
    potential = 0.6 * edge * (position[..., 2] + 10.0).sum(axis=1)
    total = kinetic + elastic + potential
    works = np.zeros((records, len(WORKS)))
    works[:, 1] = -1e-4 * time
    works[:, 0] = total - total[0] - works.sum(axis=1) - 1e-6 * time
    force = np.stack([0.2 * unsteady, 0.5 + 0.1 * unsteady, -0.3 + 0.0 * time], axis=-1)
    return of_values(
        3,
        time,
        arc,
        np.linspace(0.04, 0.03, nodes),
        position=position,
        velocity=velocity,
        acceleration=rate(velocity),
        tangent=tangent,
        director=director,
        curvature=kappa,
        twist=(twists[:, 1:] + twists[:, :-1]) / 2,
        tension=np.zeros((records, nodes - 1)),
        tip_position=tip,
        tip_target=target,
        tip_direction=direction,
        tip_direction_target=np.tile(direction[0], (records, 1)),
        tip_angle=np.arcsin(direction[:, 2]),
        tip_error=np.linalg.norm(tip - target, axis=-1),
        base_command=np.roll(pose, -1, axis=0),
        base_pose=pose,
        base_force=force,
        base_moment=0.3 * np.roll(force, 1, axis=1),
        flow_velocity=water,
        flow_speed=np.linalg.norm(water, axis=-1),
        energy=np.column_stack([kinetic, elastic, potential, works]),
        newton_iterations=np.full(records, 2),
        steps=np.arange(records),
        residual=np.full(records, 1e-10),
    ).assign_attrs(
        title=title,
        scenario=f"[arm]\ndimension = 3\n[base]\ntilt_deg = {tilt_deg}\npan_deg = {pan_deg}\n",
        crinoid_version="0.1.0",
        seed=0,
        status=status,
        wall_time=1.0,
    )


OBSTACLES = """
[[obstacle]]
kind = "sphere"
position = [0.42, 0.12, -9.9]
radius = 0.045
mass = 0.1
[[obstacle]]
kind = "cylinder"
position = [0.30, 0.24, -10.0]
radius = 0.02
axis = [0.0, 0.0, 1.0]
[[obstacle]]
kind = "capsule"
position = [0.2, -0.16, -9.95]
radius = 0.025
length = 0.2
axis = [1.0, 1.0, 0.5]
velocity = "flow"
[[obstacle]]
kind = "plane"
position = [0.0, 0.0, -10.2]
normal = [0.0, 0.0, 1.0]
"""


def among_obstacles(*, drift=0.004, obstacles=OBSTACLES, **changes):
    """Put obstacles around a curling arm; those that can, drift, and the first touches it."""
    import tomllib

    dataset = curling_arm(**changes)
    time = dataset["time"].values
    tables = tomllib.loads(obstacles)["obstacle"]
    start = np.array([table["position"] for table in tables])
    free = np.array([table["kind"] in ("sphere", "capsule") for table in tables], dtype=float)
    velocity = drift * free[:, None] * np.array([0.5, 2.0, 1.0])
    force = np.zeros((time.size, len(start), 3))
    force[time.size // 3 : time.size // 2, 0] = [0.5, -0.3, 2.0]
    held = np.any(force != 0, axis=2)
    step = time[1] - time[0] if time.size > 1 else 0.0
    gap = np.where(held, 5e-4, 0.1) * np.ones(len(start))
    found = {
        "obstacle_position": start + velocity * time[:, None, None],
        "obstacle_velocity": np.broadcast_to(velocity, (time.size, *velocity.shape)),
        "contact_force": force,
        "contact_impulse": step * np.cumsum(force, axis=0),
        "contact_time": step * np.cumsum(held, axis=0),
        "contact_gap": gap,
        "contact_closest": np.minimum.accumulate(gap, axis=0),
    }
    found = {name: quantity(name, values, 3) for name, values in found.items()}
    text = dataset.attrs["scenario"] + obstacles
    return dataset.assign(found).assign_attrs(scenario=text)
