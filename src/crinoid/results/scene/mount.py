"""The base of an arm over time, or the submarine that carries it: attitude, place, direction."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from crinoid.foundation.axes import CHANNEL_TABLE
from crinoid.results.scene.data import in_space
from crinoid.results.scene.mesh import Rotations, unit_vectors
from crinoid.scenario import Scenario

if TYPE_CHECKING:
    from crinoid.results.result import Result

_SHIFTS = {row.name: "xyz".index(row.axis) for row in CHANNEL_TABLE if not row.turns}

_POSES = {"base_servo", "base_pose", "vehicle_pose"}

Path = Float[np.ndarray, "time axis=3"]
Angles = Float[np.ndarray, " time"]


@dataclass(frozen=True)
class ArmMount:
    """The base, or the submarine, and the clamp that hold the arm's root."""

    anchor: Path  # place of the root while its servos are at rest (m)
    direction: Path  # direction of the clamp
    attitude: Rotations  # attitude of the submarine
    level_direction: Float[np.ndarray, "axis=3"]
    """Direction in which the arm leaves a submarine that is level, its servos at rest."""
    rails: tuple[tuple[int, float, float], ...] = ()
    """Axis of the submarine and ends of the travel (m) of each servo that shifts the root."""
    floats: bool = False
    """Whether a submarine carries the arm, rather than a base that is fixed or moved."""
    hull: tuple[float, float] | None = None
    """Length and diameter of the hull that the arm can touch (m)."""

    @property
    def has_hull(self) -> bool:
        """Whether a hull is drawn: of a submarine, or one that the arm can touch."""
        return self.floats or self.hull is not None


def find_mount(result: "Result") -> ArmMount:
    """Return how the root of an arm is held at each record."""
    data = result.dataset
    poses, travel = {}, {}
    if "channel" in data.coords:
        for name in map(str, data["channel"].values):
            for kind in _POSES & set(data):
                poses[kind, name] = np.asarray(data[kind].sel(channel=name).values, float)
            ends = (data[f"channel_{end}"].sel(channel=name) for end in ("lower", "upper"))
            low, high = map(float, ends)
            travel[name] = low, high
    scenario, _ = result.readable  # without one the base points along the first edge
    return mount_of(scenario, in_space(data.isel(node=[0, 1]), "position"), poses, travel)


def mount_of(
    scenario: Scenario | None,
    root: Float[np.ndarray, "time node=2 axis=3"],
    poses: Mapping[tuple[str, str], Angles],
    travel: Mapping[str, tuple[float, float]],
) -> ArmMount:
    """Return how the root of an arm is held, from its first two nodes.

    ``poses`` has the values over time of ``base_servo``, ``base_pose`` and ``vehicle_pose`` by the
    channel, ``travel`` the ends of the travel of channels.
    """
    zero = np.zeros(len(root))

    def values(kind: str, channel: str) -> Angles:
        return poses.get((kind, channel), zero)

    servo = "base_servo" if any(kind == "base_servo" for kind, _ in poses) else "base_pose"
    pan, tilt, roll = (values("vehicle_pose", name) for name in ("pan", "tilt", "roll"))
    # a tilt lifts x, which is a negative turn about y
    attitude = Rotation.from_euler("ZYX", np.stack([pan, -tilt, roll], axis=1)).as_matrix()
    shift, rails = np.zeros((len(root), 3)), []
    for name, axis in _SHIFTS.items():
        shift[:, axis] = values(servo, name)
        low, high = travel.get(name, (0.0, 0.0))
        if shift[:, axis].any() and low < high:
            rails.append((axis, low, high))
    anchor = root[:, 0] - np.einsum("tij,tj->ti", attitude, shift)
    if scenario is None:  # on a pinned mount only nearly the direction of the base
        direction = unit_vectors(root[:, 1] - root[:, 0])
        return ArmMount(anchor, direction, attitude, direction[0], tuple(rails))
    tilt, pan = np.deg2rad([[scenario.base.tilt_deg], [scenario.base.pan_deg]])
    turned = _direction(tilt + values("base_pose", "tilt"), pan + values("base_pose", "pan"))
    direction = np.asarray(np.einsum("tij,tj->ti", attitude, turned))
    vehicle, hull = scenario.vehicle, None
    if vehicle is not None and vehicle.hull is not None:
        hull = vehicle.hull.length, vehicle.hull.diameter
    floats = vehicle is not None and vehicle.floats
    level = _direction(tilt, pan)[0]
    return ArmMount(anchor, direction, attitude, level, tuple(rails), floats, hull)


def _direction(tilt: Angles, pan: Angles) -> Path:
    level = np.cos(tilt)
    return np.stack([level * np.cos(pan), level * np.sin(pan), np.sin(tilt)], axis=-1)
