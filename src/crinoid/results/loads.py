"""Loads of the arm on its base, and on itself: curvature, surface strain, cycles of bending.

They count from the start of a run, as an onset loads a structure too.
"""

from collections.abc import Iterable
from functools import partial
from typing import NamedTuple

import numpy as np
import rainflow
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.results.chunks import pieces
from crinoid.results.errors import p95, rms
from crinoid.results.result import Result
from crinoid.results.scene.mesh import at_nodes

_GATE = 0.01  # range of a cycle over the largest one below which it does not count
_STRAIGHT = 1e-6  # range of curvature times the arm's length (rad) that is round-off
_EXPONENT = 4.0
"""Slope of the fatigue life of rubber over strain: cracks grow with the square of the tearing
energy, proportional to the square of the strain (Lake and Lindley 1965)."""


class BaseLoad(NamedTuple):
    """A force (N) or moment (N m) of the arm on its base over the saved instants of a run."""

    maximum: float
    rms: float
    p95: float  # 95th percentile


class Peak(NamedTuple):
    """Largest value along the arm and in time, and its place."""

    value: float
    station: float
    """Distance from the root along the arm at rest (m)."""
    time: float  # s


class ContactExtremes(NamedTuple):
    """Contact with obstacles: the longest, the hardest and the closest, and of which obstacle.

    Forces are those at saved instants; times and gaps are over all time steps.
    """

    time: float  # s
    force: float  # N
    gap: float  # m; negative where they overlap
    obstacles: tuple[int, int, int]  # their obstacles, in this order


class ContactSeries(NamedTuple):
    """Contact of the arm with itself or with the hull, at saved instants."""

    force: Float[np.ndarray, " time"]  # sum of the forces on the edges, each pair counted once (N)
    gap: Float[np.ndarray, " time"]  # smallest distance of the surfaces (m)
    held: Bool[np.ndarray, " interval"]  # whether there is contact from one instant to the next
    time: float  # time in contact (s)

    @property
    def largest_force(self) -> float:
        """Largest force (N)."""
        return float(self.force.max())

    @property
    def smallest_gap(self) -> float:
        """Smallest distance (m); negative where surfaces overlap."""
        return float(self.gap.min())


class BendingCycles(NamedTuple):
    """Cycles of the curvature where its range is largest, by rainflow counting (ASTM E1049-85)."""

    station: float  # distance from the root along the arm at rest (m)
    ranges: Float[np.ndarray, " cycle"]
    """Ranges of the cycles (1/m), falling; those below 1 % of the largest do not count."""
    counts: Float[np.ndarray, " cycle"]  # 1 for a whole cycle, 0.5 for a half

    @property
    def number(self) -> float:
        """Number of cycles."""
        return float(self.counts.sum())

    @property
    def equivalent_range(self) -> float:
        """Range of as many equal cycles that do the same damage (1/m), by its fourth power."""
        if not self.ranges.size:
            return 0.0
        mean = np.average((self.ranges / self.ranges[0]) ** _EXPONENT, weights=self.counts)
        return float(self.ranges[0] * mean ** (1 / _EXPONENT))


def _base_load(result: Result, name: str) -> BaseLoad:
    load = result.dataset[name].values
    size = np.linalg.norm(load, axis=1) if load.ndim == 2 else np.abs(load)
    return BaseLoad(float(size.max()), rms(size), p95(size))


base_force, base_moment = (partial(_base_load, name=f"base_{kind}") for kind in ("force", "moment"))
"""Force and moment of the arm on its base, by their magnitudes."""


def base_components(result: Result) -> dict[str, float]:
    """Return the ends of each component of the load on the base, right-handed about each axis.

    They are ``force_x_min`` and ``force_x_max`` (N) with their times ``force_x_min_time`` and
    ``force_x_max_time`` (s), and so on; of a planar arm force in x and z and ``moment_y`` (N m),
    which is positive from z toward x.
    """
    data, found = result.dataset, dict[str, float]()
    for load in ("force", "moment"):
        values = data[f"base_{load}"].values
        planar = values.ndim == 1  # of a moment, which counts from x toward z
        axes = ["y"] if planar else data["axis"].values.tolist()
        parts = [0.0 - values] if planar else [*values.T]
        for axis, part in zip(axes, parts, strict=True):
            for end, at in (("min", int(part.argmin())), ("max", int(part.argmax()))):
                found[f"{load}_{axis}_{end}"] = float(part[at])
                found[f"{load}_{axis}_{end}_time"] = float(data["time"].values[at])
    return found


def contact(result: Result) -> ContactExtremes | None:
    """Return the contact with obstacles; None without any."""
    data = result.dataset
    if "contact_time" not in data:
        return None
    time, gap = data["contact_time"].values[-1], data["contact_closest"].values[-1]
    force = np.linalg.norm(data["contact_force"].values, axis=2).max(axis=0)
    which = int(time.argmax()), int(force.argmax()), int(gap.argmin())
    return ContactExtremes(float(time.max()), float(force.max()), float(gap.min()), which)


def far_contact(result: Result, part: str) -> ContactSeries | None:
    """Return the contact with one of `crinoid.results.metrics.FAR_CONTACTS`; None without any."""
    data, names = result.dataset, [f"{part}_force", f"{part}_gap"]
    if not set(names) <= set(data):
        return None
    forces, gaps = [], []
    for piece in pieces(data, names):
        forces.append(np.linalg.norm(piece[names[0]].values, axis=2).sum(axis=1))
        gaps.append(piece[names[1]].values.min(axis=1))
    # a force between two edges is in the rows of both
    force = np.concatenate(forces) * (0.5 if part == "self" else 1.0)
    held = (force[1:] > 0.0) & (force[:-1] > 0.0)
    lasted = float(np.diff(data["time"].values)[held].sum())
    return ContactSeries(force, np.concatenate(gaps), held, lasted)


self_contact, hull_contact = (partial(far_contact, part=part) for part in ("self", "hull"))
"""Contact of the arm with itself, and with the hull."""


def largest_strain(result: Result) -> Peak | None:
    """Return the largest strain at the surface, from stretch and bending; None if unknown.

    The surface lies half a ``diameter`` from the axis of the arm. The strain counts from the shape
    without load. Twist adds none along the arm.
    """
    data = result.dataset
    if not {"curvature", "position"} <= set(data):
        return None
    radius, given = data["diameter"].values / 2, np.atleast_1d(result.scenario.arm.rest_curvature)
    unloaded = given[0] if data["curvature"].ndim == 2 else _components(given)
    parts = pieces(data, ["curvature", "position"])
    strains = (
        abs(stretch_at_nodes(part)) + radius * _size(part["curvature"].values - unloaded)
        for part in parts
    )
    return _peak(data, strains)


def stretch_of_edges(part: xr.Dataset) -> Float[np.ndarray, "time edge"]:
    """Return the strain of the arm's axis (1)."""
    edges = np.diff(part["position"].values, axis=1)
    return np.asarray(np.linalg.norm(edges, axis=2) / np.diff(part["arc_length"].values) - 1)


def stretch_at_nodes(part: xr.Dataset) -> Float[np.ndarray, "time node"]:
    """Return the strain of the arm's axis at the nodes, the mean of both edges (1)."""
    return at_nodes(stretch_of_edges(part))


def bending_cycles(result: Result) -> BendingCycles | None:
    """Return the cycles of the curvature at the node of its largest range; None if unknown."""
    data = result.dataset
    if "curvature" not in data:
        return None
    span = np.ptp(envelope(data, "curvature"), axis=0)
    if not np.isfinite(span).all():
        return None
    place, nodes = int(np.argmax(span)), len(span)
    station, none = float(data["arc_length"].values[place * nodes // span.size]), np.zeros(0)
    if span.ravel()[place] * float(data["arc_length"].values[-1]) < _STRAIGHT:
        return BendingCycles(station, none, none)
    parts = pieces(data, ["curvature"])
    along = (part["curvature"].values.reshape(part.sizes["time"], -1) for part in parts)
    series = np.concatenate([values[:, place] for values in along])
    ranges, counts = cycles_of(series)
    counted = ranges >= _GATE * ranges.max(initial=0.0)
    return BendingCycles(station, ranges[counted], counts[counted])


def cycles_of(
    series: Float[np.ndarray, " time"],
) -> tuple[Float[np.ndarray, " cycle"], Float[np.ndarray, " cycle"]]:
    """Return the ranges of the cycles of a series, falling, and their counts: 1 or 0.5 of a half.

    By rainflow counting (ASTM E1049-85).
    """
    found = [(size, count) for size, _, count, *_ in rainflow.extract_cycles(series)]
    ranges, counts = np.array(sorted(found, reverse=True)).reshape(-1, 2).T
    return ranges, counts


def envelope(data: xr.Dataset, name: str) -> Float[np.ndarray, "end=2 ..."]:
    """Return the least and the greatest values of a variable over time."""
    parts = (part[name].values for part in pieces(data, [name]))
    ends = np.array([(values.min(axis=0), values.max(axis=0)) for values in parts])
    return np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])


def _components(given: Float[np.ndarray, " part"]) -> Float[np.ndarray, " bending=2"]:
    """Return the bending of a curvature at rest in space: one number is kappa_2."""
    return given[:2] if given.size == 3 else np.array([0.0, given[0]])


def _size(values: Float[np.ndarray, "time place ..."]) -> Float[np.ndarray, "time place"]:
    return np.asarray(np.linalg.norm(values, axis=2) if values.ndim == 3 else abs(values))


def stations_of(data: xr.Dataset, name: str) -> Float[np.ndarray, " place"]:
    """Return the distances from the root of a variable at nodes, or at the middles of edges (m)."""
    nodes = data["arc_length"].values.astype(float)
    return nodes if "node" in data[name].dims else (nodes[1:] + nodes[:-1]) / 2


def _largest(result: Result, name: str) -> Peak | None:
    """Return the largest value of a variable along the arm; None where the result lacks it."""
    data = result.dataset
    if name not in data:
        return None
    sizes = (_size(part[name].values) for part in pieces(data, [name]))
    return _peak(data, sizes, stations_of(data, name))


largest_curvature, largest_bending_moment, largest_shear_force = (
    partial(_largest, name=name) for name in ("curvature", "bending_moment", "shear_force")
)
"""Largest curvature (1/m), bending moment (N m), and shear force at the middle of an edge (N)."""


def _peak(
    data: xr.Dataset,
    parts: Iterable[Float[np.ndarray, "time place"]],
    stations: Float[np.ndarray, " place"] | None = None,
) -> Peak:
    """Return the largest value of pieces of time, by default at the nodes."""
    most, instant, place, first = -np.inf, 0, 0, 0
    for values in parts:
        at = divmod(int(np.argmax(values)), values.shape[1])
        if not (np.isnan(most) or values[at] <= most):  # the first that is no number stays
            most, instant, place = float(values[at]), first + at[0], at[1]
        first += len(values)
    along = data["arc_length"].values if stations is None else stations
    return Peak(most, float(along[place]), float(data["time"].values[instant]))
