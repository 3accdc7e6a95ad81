"""The base of an arm over time, or the submarine that carries it: attitude, place, direction."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from crinoid.foundation.axes import CHANNEL_TABLE
from crinoid.results.scene.data import in_space, read_scenario
from crinoid.results.scene.mesh import Rotations, unit_vectors

_SHIFTS = {row.name: "xyz".index(row.axis) for row in CHANNEL_TABLE if not row.turns}

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


def find_mount(data: xr.Dataset) -> ArmMount:
    """Return how the root of an arm is held at each record."""
    records = data.sizes["time"]
    attitude = attitudes(data)
    servo = data.get("base_servo", data.get("base_pose"))
    shift, rails = np.zeros((records, 3)), []
    if servo is not None and "channel" in data.coords:
        for name, axis in _SHIFTS.items():
            shift[:, axis] = _channel(servo, name)
            if shift[:, axis].any() and "channel_lower" in data:
                low = float(data["channel_lower"].sel(channel=name))
                high = float(data["channel_upper"].sel(channel=name))
                if low < high:
                    rails.append((axis, low, high))
    root = in_space(data.isel(node=0), "position")
    anchor = root - np.einsum("tij,tj->ti", attitude, shift)
    level = _direction(*_set_angles(data))[0]
    direction, floats = base_directions(data), has_vehicle(data)
    size = _vehicle(data).get("hull")
    hull = None if size is None else (float(size["length"]), float(size["diameter"]))
    return ArmMount(anchor, direction, attitude, level, tuple(rails), floats, hull)


def base_word(data: xr.Dataset) -> str:
    """Return the noun for the base of an arm."""
    return "submarine" if _vehicle(data) else "base"


def has_vehicle(data: xr.Dataset) -> bool:
    """Return whether a submarine carries the arm of a result."""
    return "mass" in _vehicle(data)


def base_directions(data: xr.Dataset) -> Path:
    """Return unit vectors along which the base points.

    The scenario and the base's pose give them; without a scenario it is the direction of the first
    edge, which on a pinned mount is only nearly the same.
    """
    if "tilt_deg" not in _base(data):
        first = in_space(data.isel(node=[0, 1]), "position")
        return unit_vectors(first[:, 1] - first[:, 0])
    tilt, pan = _set_angles(data)
    if "base_pose" in data and "channel" in data.coords:
        tilt = tilt + _channel(data["base_pose"], "tilt")
        pan = pan + _channel(data["base_pose"], "pan")
    return np.asarray(np.einsum("tij,tj->ti", attitudes(data), _direction(tilt, pan)))


def attitudes(data: xr.Dataset) -> Rotations:
    """Return the attitudes of the submarine: level unless it floats."""
    if "vehicle_pose" not in data:
        return np.tile(np.eye(3), (data.sizes["time"], 1, 1))
    pan, tilt, roll = (_channel(data["vehicle_pose"], name) for name in ("pan", "tilt", "roll"))
    # a tilt lifts x, which is a negative turn about y
    return Rotation.from_euler("ZYX", np.stack([pan, -tilt, roll], axis=1)).as_matrix()


def _set_angles(data: xr.Dataset) -> tuple[Angles, Angles]:
    """Return tilt and pan of the base in the scenario (rad)."""
    base = _base(data)
    tilt, pan = (np.deg2rad([float(base.get(f"{name}_deg", 0.0))]) for name in ("tilt", "pan"))
    return tilt, pan


def _vehicle(data: xr.Dataset) -> dict[str, Any]:
    vehicle = read_scenario(data).get("vehicle")
    return vehicle if isinstance(vehicle, dict) else {}


def _base(data: xr.Dataset) -> dict[str, Any]:
    base = read_scenario(data).get("base")
    return base if isinstance(base, dict) else {}


def _direction(tilt: Angles, pan: Angles) -> Path:
    level = np.cos(tilt)
    return np.stack([level * np.cos(pan), level * np.sin(pan), np.sin(tilt)], axis=-1)


def _channel(data: xr.DataArray, channel: str) -> Float[np.ndarray, " time"]:
    """Return values of a channel, zero without it."""
    if channel not in data["channel"].values:
        return np.zeros(data.sizes["time"])
    return np.asarray(data.sel(channel=channel).values, float)
