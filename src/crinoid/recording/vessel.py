"""Motion of the arm's root on a vessel that shifts and turns."""

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from crinoid.foundation.axes import STEEP


def vessel_motion(
    moved: Mapping[str, Float[np.ndarray, " time"]],
    offset: Sequence[float],
    angles: tuple[float, float, float],
) -> Float[np.ndarray, "time channel"]:
    """Return how the channels of a base move (m, rad) that a vessel carries.

    Parameters
    ----------
    moved
        Surge, heave and pitch of the vessel (m, rad); in space also sway, roll and yaw. It turns by
        yaw about the vertical, by pitch and by roll, in its own axes.
    offset
        Place of the root from the point that has these shifts (m).
    angles
        Pan, tilt and roll of the base in its set pose (rad).

    Returns
    -------
    array
        NaN where the root points so steeply that pan and roll are not defined, while the vessel
        rolls, or pitches about another axis than that of the arm's tilt.
    """
    pitch = moved["pitch"]
    if len(offset) == 2:
        cosine, sine, (x, z) = np.cos(pitch), np.sin(pitch), offset
        slide = moved["surge"] + cosine * x - sine * z - x
        return np.stack([slide, moved["heave"] + sine * x + cosine * z - z, pitch], axis=1)
    turns = np.stack([moved["yaw"], -pitch, moved["roll"]], axis=1)
    vessel = Rotation.from_euler("ZYX", turns)
    shift = np.stack([moved[name] for name in ("surge", "sway", "heave")], axis=1)
    shift = shift + vessel.apply(offset) - offset
    return np.hstack([shift, _turned(vessel, turns * [1, -1, 1], np.array(angles))])


def _turned(
    vessel: Rotation, turns: Float[np.ndarray, "time 3"], angles: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "time 3"]:
    """Return the change of pan, tilt and roll of the root."""
    yaw, pitch, roll = (bool(np.any(turn)) for turn in turns.T)
    if not roll and not (pitch and (yaw or angles[0])):
        return turns  # about the axis of pan, or that of tilt, alone
    signs = np.array([1.0, -1.0, 1.0])
    whole = vessel * Rotation.from_euler("ZYX", angles * signs)
    with warnings.catch_warnings():  # of angles that are not defined, which are nan below
        warnings.simplefilter("ignore")
        first = whole.as_euler("ZYX") * signs
    # of the two triples of angles for one attitude, the one that the set pose belongs to
    if np.cos(angles[1]) < 0:
        first = np.stack([first[:, 0] + np.pi, np.pi - first[:, 1], first[:, 2] + np.pi], axis=1)
    steep = np.abs(np.cos(first[:, 1])) < STEEP
    change = np.unwrap(np.vstack([0.0 * angles, first - angles]), axis=0)[1:]
    return np.where(steep[:, None] & [True, False, True], np.nan, change)
