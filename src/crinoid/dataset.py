"""The dataset of a run: names, units, and what follows from the motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from crinoid.base import Servo
from crinoid.dynamics import System, Touch
from crinoid.elements import ENERGIES, WORKS
from crinoid.pieces import turned_on
from crinoid.record import Record
from crinoid.scenario import Scenario
from crinoid.space import ANGLES, AXES, CHANNELS
from crinoid.version import __version__

_Quantities = dict[str, tuple[tuple[str, ...], ArrayLike, str, str]]
"""Dimensions, values, unit and meaning by name."""

_LIMITS = ("channel_lower", "channel_upper", "channel_max_speed", "channel_max_acceleration")
_FORWARD = {2: "x forward, z up", 3: "x forward, y to port, z up"}


def describe(scenario: Scenario) -> dict[str, Any]:
    """Return the attributes that every result of a scenario has."""
    return {
        "Conventions": "CF-1.11",
        "title": scenario.title or "crinoid simulation",
        "source": f"crinoid {__version__}",
        "crinoid_version": __version__,
        "scenario": scenario.to_toml(),
        "seed": scenario.seed,
    }


def join(parts: Sequence[xr.Dataset]) -> xr.Dataset:
    """Put the stretches of one run after each other; what only the first one holds is left out."""
    if len(parts) == 1:
        return parts[0]
    parts = [part[list(parts[-1].data_vars)] for part in parts]
    return xr.concat(parts, "time", data_vars="minimal", coords="minimal", compat="override")


def build_dataset(
    system: System, diameters: Sequence[float], kept: Record, before: float | None = None
) -> xr.Dataset:
    """Turn saved instants into a dataset with names, units and what follows from the motion.

    Parameters
    ----------
    system
        The arm.
    diameters
        Diameters that the water sees, one a node (m).
    kept
        What was saved.
    before
        Angle of the tip at the instant before these (rad), from which it turns on and on in the
        plane.
    """
    stretch = system.forces.stretch
    if stretch is None:
        raise ValueError("nothing resists stretching: elements takes a Stretch")
    origin = np.asarray(system.forces.origin)
    edges = np.diff(kept.position, axis=1)
    lengths = np.linalg.norm(edges, axis=2, keepdims=True)
    tangent = edges / lengths
    stretching = np.sum(tangent * np.diff(kept.velocity, axis=1), axis=2)
    rest_length, EA = np.asarray(stretch.rest_length), np.asarray(stretch.EA)
    strain = lengths[..., 0] / rest_length - 1
    tension = EA * (strain + np.asarray(stretch.damping_time) * stretching / rest_length)
    count = kept.position.shape[-1]
    axes, channels = AXES[count], CHANNELS[count]
    tip, target = kept.tip[:, :count], kept.wanted[:, :count]

    quantities: _Quantities = {
        "position": (
            ("time", "node", "axis"),
            kept.position + origin,
            "m",
            "position of the nodes",
        ),
        "velocity": (("time", "node", "axis"), kept.velocity, "m s-1", "velocity of the nodes"),
        "acceleration": (
            ("time", "node", "axis"),
            kept.acceleration,
            "m s-2",
            "acceleration of the nodes",
        ),
        "tangent": (("time", "edge", "axis"), tangent, "1", "direction of the edges"),
        **_bending(kept),
        "tension": (("time", "edge"), tension, "N", "axial force in the edges, tension positive"),
        "tip_position": (("time", "axis"), tip, "m", "position of the tip"),
        "tip_target": (("time", "axis"), target, "m", "where the tip should be"),
        **_pointing(kept, before),
        "tip_error": (
            ("time",),
            np.linalg.norm(tip - target, axis=1),
            "m",
            "distance of the tip from where it should be",
        ),
        "flow_velocity": (
            ("time", "node", "axis"),
            kept.flow_velocity,
            "m s-1",
            "velocity of the undisturbed water at the nodes",
        ),
        "flow_speed": (
            ("time", "node"),
            np.linalg.norm(kept.flow_velocity, axis=2),
            "m s-1",
            "speed of the undisturbed water at the nodes",
        ),
        "base_command": (
            ("time", "channel"),
            kept.command,
            "",
            "command of the base channels, from the set pose",
        ),
        "base_servo": (
            ("time", "channel"),
            kept.servo,
            "",
            "displacement of the servos of the base channels",
        ),
        "base_pose": (
            ("time", "channel"),
            kept.pose,
            "",
            "displacement of the base channels from the set pose, prescribed motion included",
        ),
        **_limits(system.base.servo),
        "base_force": (("time", "axis"), kept.base_force, "N", "force of the arm on the submarine"),
        "base_moment": (
            ("time", "axis")[: kept.base_moment.ndim],
            kept.base_moment,
            "N m",
            "moment of the arm on the submarine about the root, "
            + ("positive from x toward z" if count == 2 else "right-handed"),
        ),
        "energy": (
            ("time", "kind"),
            kept.energy,
            "J",
            "stored energies, and works done on the arm since the start",
        ),
        "steps": (("time",), kept.steps, "1", "time steps since the instant before"),
        "newton_iterations": (
            ("time",),
            kept.iterations,
            "1",
            "Newton iterations since the instant before",
        ),
        "residual": (
            ("time",),
            kept.residual,
            "N",
            "largest force imbalance of a node since the instant before",
        ),
        "step_error": (
            ("time",),
            kept.error,
            "m",
            "largest estimated local error of a step since the instant before",
        ),
    }
    if kept.touch is not None:
        quantities |= _contact(kept, kept.touch, origin)
    dataset = xr.Dataset(
        {
            name: (dims, values, {"units": units, "long_name": meaning})
            for name, (dims, values, units, meaning) in quantities.items()
        },
        coords={
            "time": ("time", kept.time, {"units": "s", "long_name": "time", "axis": "T"}),
            "axis": ("axis", list(axes), {"long_name": _FORWARD[count]}),
            "channel": ("channel", list(channels), {"long_name": "base channel"}),
            "kind": ("kind", [*ENERGIES, *WORKS], {"long_name": "kind of energy or work"}),
            "arc_length": (
                "node",
                np.concatenate([np.zeros(1), np.cumsum(np.asarray(system.reference.rest_length))]),
                {"units": "m", "long_name": "distance from the root along the arm at rest"},
            ),
            "diameter": (
                "node",
                np.asarray(diameters),
                {"units": "m", "long_name": "diameter that the water sees"},
            ),
            "channel_unit": (
                "channel",
                ["rad" if channel in ANGLES else "m" for channel in channels],
                {"long_name": "unit of base_command, base_servo and base_pose"},
            ),
        },
    )
    dataset["flow_speed"].attrs["standard_name"] = "sea_water_speed"
    shifts = [channel for channel in channels if channel not in ANGLES]
    turns = [channel for channel in channels if channel in ANGLES]
    for name in ("base_command", "base_servo", "base_pose", *_LIMITS):
        del dataset[name].attrs["units"]  # CF has no unit for a mixture
        dataset[name].attrs["comment"] = (
            f"{_listed(shifts)} in m, {_listed(turns)} in rad: see channel_unit"
        )
    for name, per in zip(_LIMITS[2:], ("s", "s2"), strict=True):
        dataset[name].attrs["comment"] += f", per {per}"
    if count == 3:
        names = ["kappa_1", "kappa_2"]
        about = {"long_name": "bending toward the directors m_1 and m_2"}
        dataset = dataset.assign_coords(bending=("bending", names, about))
    return dataset


def _listed(names: Sequence[str]) -> str:
    return " and ".join(", ".join(names).rsplit(", ", 1))


def _limits(servo: Servo) -> _Quantities:
    """Return the limits of the channels; those of one that stays put are 0."""
    there = np.asarray(servo.lower) < np.asarray(servo.upper)
    values = (servo.lower, servo.upper, servo.max_speed, servo.max_acceleration)
    words = (
        "lower end of the travel",
        "upper end of the travel",
        "greatest speed",
        "greatest acceleration",
    )
    return {
        name: (
            ("channel",),
            np.where(there, np.asarray(value), 0.0),
            "",
            f"{word} of the servos of the base channels",
        )
        for name, value, word in zip(_LIMITS, values, words, strict=True)
    }


def _bending(kept: Record) -> _Quantities:
    """Return how the arm is bent, and in space how it is twisted and turned about itself."""
    if kept.twist is None or kept.director is None:
        return {
            "curvature": (
                ("time", "node"),
                kept.curvature,
                "m-1",
                "curvature, positive from x toward z",
            )
        }
    return {
        "curvature": (
            ("time", "node", "bending"),
            kept.curvature,
            "m-1",
            "curvature, positive toward the directors m_1 and m_2",
        ),
        "twist": (
            ("time", "edge"),
            (kept.twist[:, 1:] + kept.twist[:, :-1]) / 2,
            "rad m-1",
            "twist, positive from m_1 toward m_2 on the way to the tip",
        ),
        "director": (
            ("time", "edge", "axis"),
            kept.director,
            "1",
            "director m_1 of the edges, which turns with the arm's material",
        ),
    }


def _pointing(kept: Record, before: float | None) -> _Quantities:
    """Return where the tip points and where it should."""
    if kept.tip.shape[1] == 3:
        angle = turned_on(np.asarray(kept.tip[:, 2]), before)
        return {
            "tip_angle": (("time",), angle, "rad", "direction of the tip"),
            "tip_angle_target": (
                ("time",),
                kept.wanted[:, 2],
                "rad",
                "where the tip should point",
            ),
        }
    direction, target = kept.tip[:, 3:], kept.wanted[:, 3:]
    return {
        "tip_direction": (("time", "axis"), direction, "1", "where the tip points"),
        "tip_direction_target": (("time", "axis"), target, "1", "where the tip should point"),
        "tip_angle": (
            ("time",),
            np.arctan2(direction[:, 2], np.hypot(direction[:, 0], direction[:, 1])),
            "rad",
            "angle of the tip above the level plane",
        ),
    }


def _contact(kept: Record, touch: Touch, origin: np.ndarray) -> _Quantities:
    """Return what there is to know of the obstacles."""
    vectors, numbers = ("time", "obstacle", "axis"), ("time", "obstacle")
    assert kept.obstacle_position is not None
    assert kept.obstacle_velocity is not None
    assert kept.gap is not None
    return {
        "obstacle_position": (
            vectors,
            kept.obstacle_position + origin,
            "m",
            "position of the obstacles",
        ),
        "obstacle_velocity": (
            vectors,
            kept.obstacle_velocity,
            "m s-1",
            "velocity of the obstacles",
        ),
        "contact_force": (vectors, touch.force, "N", "force of the obstacles on the arm"),
        "contact_impulse": (
            vectors,
            touch.impulse,
            "N s",
            "impulse of the obstacles on the arm since the start",
        ),
        "contact_time": (
            numbers,
            touch.duration,
            "s",
            "time that the obstacles have been in contact since the start",
        ),
        "contact_gap": (
            numbers,
            kept.gap.min(axis=-1),
            "m",
            "distance of the obstacles from the arm's surface",
        ),
        "contact_closest": (
            numbers,
            touch.closest,
            "m",
            "smallest distance of the obstacles from the arm's surface since the start",
        ),
    }
