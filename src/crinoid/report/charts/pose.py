"""Where the submarine and the base of the arm point, over time."""

from __future__ import annotations

import contextlib
import math
import tomllib
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float, Int

from crinoid.report.view import in_space

Records = Sequence[int] | Int[np.ndarray, " record"]


def read_scenario(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the tables of the scenario in a result; none where it holds no readable one."""
    with contextlib.suppress(KeyError, tomllib.TOMLDecodeError):
        return tomllib.loads(str(dataset.attrs["scenario"]))
    return {}


def base_directions(dataset: xr.Dataset, records: Records) -> Float[np.ndarray, "record axis=3"]:
    """Return unit vectors along which the base points at some records.

    The scenario and the base's pose say it; failing that, the first edge does, which on a pinned
    mount is only nearly the same.
    """
    set_pose = read_scenario(dataset).get("base", {})
    if isinstance(set_pose, dict) and isinstance(set_pose.get("tilt_deg"), int | float):
        tilt, pan = (_turn(dataset, records, channel, set_pose) for channel in ("tilt", "pan"))
        level = np.cos(tilt)
        ahead = np.stack([level * np.cos(pan), level * np.sin(pan), np.sin(tilt)], axis=-1)
        return np.asarray(np.einsum("rij,rj->ri", attitudes(dataset, records), ahead))
    first = in_space(dataset.isel(time=records, node=[0, 1]), "position")
    edge = first[:, 1] - first[:, 0]
    length = np.linalg.norm(edge, axis=1, keepdims=True)
    return np.asarray(edge / np.where(length > 0.0, length, 1.0))


def attitudes(dataset: xr.Dataset, records: Records) -> Float[np.ndarray, "record axis=3 axis=3"]:
    """Return matrices by which a submarine that floats is turned at some records."""
    if "vehicle_pose" not in dataset:
        return np.tile(np.eye(3), (len(records), 1, 1))
    pose = dataset["vehicle_pose"].isel(time=records)
    pan, tilt, roll = (channel_of(pose, name) for name in ("pan", "tilt", "roll"))
    none = np.zeros(len(records))
    level = np.stack([np.cos(pan), np.sin(pan), none], axis=-1)
    port = np.stack([-np.sin(pan), np.cos(pan), none], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    ahead = np.cos(tilt)[:, None] * level + np.sin(tilt)[:, None] * up
    above = np.cos(tilt)[:, None] * up - np.sin(tilt)[:, None] * level
    left = np.cos(roll)[:, None] * port + np.sin(roll)[:, None] * above
    return np.stack([ahead, left, np.cross(ahead, left)], axis=2)


def channel_of(data: xr.DataArray, channel: str) -> Float[np.ndarray, " record"]:
    """Return values of a channel, zero of one that there is not."""
    if channel not in data["channel"].values:
        return np.zeros(data.sizes["time"])
    return np.asarray(data.sel(channel=channel).values, float)


def _turn(
    dataset: xr.Dataset, records: Records, channel: str, set_pose: dict[str, Any]
) -> Float[np.ndarray, " record"]:
    """Angles (rad) that the base is turned by, its set pose and its channel together."""
    angle = np.full(len(records), math.radians(set_pose.get(f"{channel}_deg", 0.0)))
    if "base_pose" in dataset and "channel" in dataset.coords:
        angle = angle + channel_of(dataset["base_pose"].isel(time=records), channel)
    return angle
