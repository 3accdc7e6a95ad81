"""The dataset of a run: names, units, and derived quantities."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.actuation import Input
from crinoid.dynamics import LengthControlledThreads, System
from crinoid.elements import ENERGIES, WORKS
from crinoid.foundation.axes import ANGLES, AXES, CHANNELS
from crinoid.foundation.result_variables import Content, large_names, of_dimension, quantity
from crinoid.foundation.version import __version__
from crinoid.results.chunks import unwrap_from
from crinoid.results.record import Record
from crinoid.scenario import Scenario

if TYPE_CHECKING:
    from crinoid.recording import SolidSurface  # slow to load, and few need it

Series = Float[np.ndarray, " time"]
Vectors = Float[np.ndarray, "time node axis"]

_PER = {"channel_max_speed": ", per s", "channel_max_acceleration": ", per s2"}
FORWARD = {2: "x forward, z up", 3: "x forward, y to port, z up"}


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


def described(rows: Sequence[tuple[str, str, str, Any, str]]) -> dict[str, tuple[Any, ...]]:
    """Return variables from rows of name, dimensions, unit or "", values, and meaning or ""."""
    found = {}
    for name, dims, unit, values, meaning in rows:
        about = {"units": unit, "long_name": meaning}
        found[name] = dims.split(), values, {key: text for key, text in about.items() if text}
    return found


def chosen(dataset: xr.Dataset, names: Sequence[str] | None) -> xr.Dataset:
    """Leave out the variables along the arm that are not in ``names``; None keeps all."""
    if names is None:
        return dataset
    large = set(large_names(dataset.sizes["axis"]))
    return dataset.drop_vars(large & set(dataset.data_vars) - set(names))


class Instants:
    """Saved instants, and the variables of a result (`crinoid.foundation.result_variables`).

    In the plane the angle of the tip turns on and on from that at the instant ``before`` (rad).
    """

    def __init__(self, system: System, kept: Record, before: float | None = None) -> None:
        if system.forces.stretch is None:
            raise ValueError("no element resists stretching; elements must include a Stretch")
        self.system, self.kept = system, kept
        self._stretch, self._before = system.forces.stretch, before
        self.origin = np.asarray(system.forces.origin)
        self.dimension = kept.position.shape[-1]
        edges = np.diff(kept.position, axis=1)
        self._lengths = np.linalg.norm(edges, axis=2, keepdims=True)
        self.tangent = edges / self._lengths
        self.relative_flow = np.asarray(kept.flow_velocity - kept.velocity)
        self.tip, self.target = kept.tip[:, : self.dimension], kept.reference[:, : self.dimension]

    @property
    def position(self) -> Vectors:
        """Positions of the nodes in the world (m)."""
        return np.asarray(self.kept.position + self.origin)

    @property
    def tension(self) -> Float[np.ndarray, "time edge"]:
        """Axial force in the edges, elastic and viscous (N)."""
        rest_length = np.asarray(self._stretch.rest_length)
        stretching = np.sum(self.tangent * np.diff(self.kept.velocity, axis=1), axis=2)
        strain = self._lengths[..., 0] / rest_length - 1
        viscous = np.asarray(self._stretch.material.damping_time) * stretching / rest_length
        tension = np.asarray(self._stretch.EA) * (strain + viscous)
        branches = self.kept.branch_tension
        return tension if branches is None else tension + np.asarray(branches)

    @property
    def bending_moment(self) -> Float[np.ndarray, "time node ..."]:
        """Bending moment at the nodes, in the axes of the edge beyond (N m)."""
        found = self._across(np.asarray(self.kept.moment)[:, :-1])
        return np.concatenate([found, np.zeros_like(found[:, :1])], axis=1)  # none at the tip

    @property
    def shear_force(self) -> Float[np.ndarray, "time edge ..."]:
        """Force across the edges, of the arm beyond on the arm before (N).

        It balances the moments on the two ends of an edge, whose mass does not resist turning.
        """
        change = self._across(np.diff(np.asarray(self.kept.moment), axis=1))
        return -change / (self._lengths if change.ndim == 3 else self._lengths[..., 0])

    def _across(self, moment: Float[np.ndarray, "time edge turns"]) -> np.ndarray:
        """Return moments on the edges as bending; in space toward m_1 and toward m_2 (N m)."""
        if self.dimension == 2:
            return moment[..., 0]
        first = np.asarray(self.kept.director)
        second = np.cross(self.tangent, first)
        return np.stack([np.sum(moment * second, axis=2), -np.sum(moment * first, axis=2)], axis=2)

    @property
    def twist(self) -> Float[np.ndarray, "time edge"]:
        """Twist of the edges, the mean of their two nodes (rad/m)."""
        assert self.kept.twist is not None
        return np.asarray(self.kept.twist[:, 1:] + self.kept.twist[:, :-1]) / 2

    @property
    def angle(self) -> Series:
        """Direction of a planar tip (rad)."""
        return unwrap_from(np.asarray(self.kept.tip[:, 2]), self._before)

    @property
    def elevation(self) -> Series:
        """Angle of a tip in space above the level plane (rad)."""
        direction = self.kept.tip[:, 3:]
        return np.arctan2(direction[:, 2], np.hypot(direction[:, 0], direction[:, 1]))

    def estimated_tip(self, part: str) -> Float[np.ndarray, "time pose"]:
        """Return the estimated pose of the tip (m, rad, 1), or its ``"std"``.

        The angle of a planar one is in the turn of the true one.
        """
        assert self.kept.estimate is not None
        found = np.array(getattr(self.kept.estimate.tip, part))
        if part == "value" and self.dimension == 2:
            off = found[:, 2] - self.angle
            found[:, 2] -= 2 * np.pi * np.round(off / (2 * np.pi))
        return found

    @property
    def tip_error(self) -> Series:
        """Distance of the tip from where it should be (m)."""
        return np.linalg.norm(self.tip - self.target, axis=1)

    @property
    def flow_speed(self) -> Float[np.ndarray, "time node"]:
        """Speed of the undisturbed water (m/s)."""
        return np.linalg.norm(self.kept.flow_velocity, axis=2)

    @property
    def limits(self) -> Float[np.ndarray, "limit channel"]:
        """Ends of the travel, greatest speed and acceleration; 0 of a channel that stays put."""
        servo = self.system.base.servo
        there = np.asarray(servo.lower) < np.asarray(servo.upper)
        values = (servo.lower, servo.upper, servo.max_speed, servo.max_acceleration)
        return np.stack([np.where(there, np.asarray(value), 0.0) for value in values])


def build_dataset(run: Instants, diameters: Sequence[float], *more: Content) -> xr.Dataset:
    """Build the dataset of saved instants, with names, units and derived quantities.

    ``diameters`` (m) are the hydrodynamic ones of the nodes. The dataset contains ``more`` too.
    """
    count, kept, system = run.dimension, run.kept, run.system
    missing = {
        "obstacles": kept.touch,
        "bodies": kept.obstacle_spin,
        "tool": kept.held,
        "vortices": kept.vortices,
        "self": kept.self_touch,
        "hull": kept.hull_touch,
        "vehicle": kept.vehicle,
        "estimate": kept.estimate,
        "shape": kept.estimate and kept.estimate.position,
        "current": kept.estimate and kept.estimate.flow_velocity,
    }
    without = [name for name, found in missing.items() if found is None]
    there = of_dimension(count, without=without)
    found = {
        name: quantity(name, variable.of(run), count)
        for name, variable in there.items()
        if variable.of is not None
    }
    along = coordinates(
        count,
        np.asarray(kept.time),
        np.concatenate([np.zeros(1), np.cumsum(np.asarray(system.reference.rest_length))]),
        np.asarray(diameters),
    )
    for each in more:
        found |= each.variables
        along |= each.coordinates
    return with_comments(xr.Dataset(found, along))


def signals(
    kept: Record,
    inputs: Sequence[Input],
    readings: Sequence[tuple[str, str]],
    lines: LengthControlledThreads | None = None,
) -> Content:
    """Return the signals of saved instants: readings, actuators, loads of lines.

    The base's channels, the first of the inputs, have variables of their own.
    """
    values: dict[str, Any] = {"sensor_reading": kept.reading}
    rows: list[tuple[str, str, str, Any, str]] = [
        ("reading", "reading", "", [name for name, _ in readings], "sensor and value"),
        ("reading_unit", "reading", "", [unit for _, unit in readings], "unit of sensor_reading"),
    ]
    others = inputs[kept.servo.shape[-1] :]
    if lines is not None and kept.line is not None:
        wound = [others[drive].name for drive in lines.drives]
        names = [name + "_opposite" * (name in wound[:at]) for at, name in enumerate(wound)]
        units = ["Pa" if fluid else "N" for fluid in lines.fluid]
        values["line_load"] = kept.line
        rows += [
            ("line", "line", "", names, "tendon of given length or chamber of given volume"),
            ("line_unit", "line", "", units, "unit of line_load"),
        ]
    if kept.drive is not None:
        values |= {"actuator_command": kept.drive_command, "actuator_state": kept.drive}
        units = [each.unit for each in others]
        rows += [
            ("input", "input", "", [each.name for each in others], "input of an actuator"),
            ("input_unit", "input", "", units, "unit of actuator_command and actuator_state"),
            ("input_lower", "input", "", [float(each.lower) for each in others], "lower limit"),
            ("input_upper", "input", "", [float(each.upper) for each in others], "upper limit"),
        ]
    found = {}
    for name, each in values.items():
        dims, data, about = quantity(name, np.asarray(each), 2)
        found[name] = dims, data, about | {"comment": f"in {dims[-1]}_unit"}  # CF has no mixture
    return Content(found, described(rows))


def solids(surfaces: "Mapping[str, SolidSurface]") -> Content:
    """Return the surfaces of solids from files, by table ``obstacle.0``, if there are any."""
    if not surfaces:
        return Content({}, {})
    counts = [len(each.points) for each in surfaces.values()]
    firsts = np.cumsum([0, *counts[:-1]])
    facets = [each.facets + at for each, at in zip(surfaces.values(), firsts, strict=True)]
    owners = [np.full(len(s.facets), int(k.rpartition(".")[2])) for k, s in surfaces.items()]
    points = np.concatenate([each.points for each in surfaces.values()]).astype("f4")
    values = points, *(np.concatenate(each).astype("i4") for each in (facets, owners))
    names = ("surface_point", "surface_facet", "facet_obstacle")
    return Content({n: quantity(n, v, 3) for n, v in zip(names, values, strict=True)}, {})


def coordinates(
    dimension: int,
    time: Series,
    arc_length: Float[np.ndarray, " node"],
    diameter: Float[np.ndarray, " node"],
) -> dict[str, tuple[Any, ...]]:
    """Return the coordinates of a result, for xarray."""
    channels = CHANNELS[dimension]
    units = ["rad" if channel in ANGLES else "m" for channel in channels]
    rows: list[tuple[str, str, str, Any, str]] = [
        ("time", "time", "s", time, "time"),
        ("axis", "axis", "", list(AXES[dimension]), FORWARD[dimension]),
        ("channel", "channel", "", list(channels), "base channel"),
        ("kind", "kind", "", [*ENERGIES, *WORKS], "kind of energy or work"),
        ("arc_length", "node", "m", arc_length, "distance from the root along the arm at rest"),
        ("diameter", "node", "m", diameter, "diameter that the water sees"),
        ("channel_unit", "channel", "", units, "unit of base_command, base_servo and base_pose"),
    ]
    if dimension == 3:
        about = "bending toward the directors m_1 and m_2"
        rows.append(("bending", "bending", "", ["kappa_1", "kappa_2"], about))
    found = described(rows)
    found["time"][2]["axis"] = "T"
    return found


def with_comments(dataset: xr.Dataset) -> xr.Dataset:
    """Say of which unit what differs between channels is: CF has none for a mixture."""
    channels = [str(channel) for channel in dataset["channel"].values]
    shifts = [channel for channel in channels if channel not in ANGLES]
    turns = [channel for channel in channels if channel in ANGLES]
    mixed = f"{_listed(shifts)} in m, {_listed(turns)} in rad: see channel_unit"
    for name, data in dataset.data_vars.items():
        if "channel" in data.dims:
            data.attrs["comment"] = mixed + _PER.get(str(name), "")
    return dataset


def _listed(names: Sequence[str]) -> str:
    return " and ".join(", ".join(names).rsplit(", ", 1))
