"""Dimensionless numbers of the flow past an arm, with its natural frequencies."""

from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float, Inexact

from crinoid.dynamics import Modes
from crinoid.foundation.result_variables import Content, quantity
from crinoid.results.chunks import pieces
from crinoid.results.scene.mesh import at_nodes
from crinoid.scenario import Scenario

Vectors = Float[np.ndarray, "time node axis"]

MOTION = ("flow_velocity", "velocity", "tangent")
"""Variables that give the velocity of the water relative to the arm."""


def dimensionless(
    flow: Vectors,
    tangent: Float[np.ndarray, "time edge axis"],
    diameter: Float[np.ndarray, " node"],
    scenario: Scenario,
    modes: Modes | None,
) -> Content:
    """Return natural frequencies and dimensionless numbers of instants of a run.

    Frequencies need modes, flow numbers water and a diameter, the reduced velocity a restoring
    force; else they are left out.

    ``flow`` is the velocity of the water at the nodes relative to the arm (m/s), ``tangent`` the
    direction of the edges, ``diameter`` the hydrodynamic one (m). The modes are those at the start.
    """
    found: dict[str, Any] = {}
    first, axes, numbered = 0.0, flow.shape[2], {}
    if modes is not None:
        found = {"natural_frequency": modes.frequency, "mode_shape": modes.shape[..., :axes]}
        spin = None
        if modes.shape.shape[2] > axes:
            spin = found["mode_spin"] = modes.shape[:, 1:, axes]
        number = np.arange(1, modes.frequency.size + 1)
        numbered = {"mode": ("mode", number, {"long_name": "slowest first"})}
        moving = modes.frequency[~spinning(found["mode_shape"], spin, diameter)]
        first = float(moving[0]) if moving.size else 0.0
    if scenario.water.density > 0 and diameter.min() > 0:
        speed = np.linalg.norm(flow, axis=2)
        found["reynolds_number"] = speed * diameter / scenario.water.kinematic_viscosity
        if first > 0:
            across_it = np.linalg.norm(across(flow, tangent), axis=2)
            found["reduced_velocity"] = across_it / (first * diameter)
    return Content({name: quantity(name, found[name], axes) for name in found}, numbered)


def with_velocity_moments(dataset: xr.Dataset) -> xr.Dataset:
    """Add the Keulegan-Carpenter number to a run that has Reynolds numbers."""
    if "reynolds_number" not in dataset:
        return dataset
    parts = (
        VelocityMoments.of(normal_velocity(piece), piece["time"].values)
        for piece in pieces(dataset, MOTION, overlap=True)
    )
    moments = reduce(VelocityMoments.followed_by, parts)
    number = moments.keulegan_carpenter(dataset["diameter"].values)
    name = "keulegan_carpenter"
    return dataset.assign({name: quantity(name, number, dataset.sizes["axis"])})


def spinning(
    shape: Inexact[np.ndarray, "mode node axis"],
    spin: Inexact[np.ndarray, "mode edge"] | None,
    diameter: Float[np.ndarray, " node"],
) -> Bool[np.ndarray, " mode"]:
    """Return which modes move the arm's surface more by its spin than by its displacement."""
    if spin is None:
        return np.zeros(shape.shape[0], bool)
    going = np.linalg.norm(shape, axis=2).max(axis=1)
    return np.asarray(going < np.abs(spin).max(axis=1) * diameter.max() / 2)


def bending(
    shape: Inexact[np.ndarray, "mode node axis"],
    spin: Inexact[np.ndarray, "mode edge"] | None,
    tangent: Float[np.ndarray, "edge axis"],
    diameter: Float[np.ndarray, " node"],
) -> Bool[np.ndarray, " mode"]:
    """Return which modes move the arm mostly across itself, neither by stretch nor by twist."""
    normal = np.linalg.norm(across(shape, tangent[None]), axis=2)
    bends = np.sum(normal**2, axis=1) > 0.5 * np.sum(np.abs(shape) ** 2, axis=(1, 2))
    return np.asarray(bends & ~spinning(shape, spin, diameter))


def normal_velocity(dataset: xr.Dataset) -> Float[np.ndarray, "time node across"]:
    """Return the component of the relative velocity of the water across the arm (m/s)."""
    flow = dataset["flow_velocity"].values - dataset["velocity"].values
    return across(flow, dataset["tangent"].values)


def across(
    vectors: Inexact[np.ndarray, "_ node axis"], tangent: Float[np.ndarray, "_ edge axis"]
) -> Inexact[np.ndarray, "_ node across"]:
    """Return the components of vectors at the nodes across the arm.

    The tangent at a node is the mean of those of its edges. In the plane the result is the
    component along the normal, from x toward z; in space a vector.
    """
    along = at_nodes(tangent)
    if along.shape[2] == 2:
        x, z = along[..., 0], along[..., 1]
        across_it = (vectors[..., 1] * x - vectors[..., 0] * z) / np.sqrt(x**2 + z**2)
        return np.asarray(across_it[..., None])
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    return vectors - np.sum(vectors * along, axis=2, keepdims=True) * along


def length_share(dataset: xr.Dataset) -> Float[np.ndarray, " node"]:
    """Return the share of the arm's length that belongs to each node."""
    arc_length = dataset["arc_length"].values
    return np.convolve(np.diff(arc_length), [0.5, 0.5]) / arc_length[-1]


class VelocityMoments(NamedTuple):
    """Moments of a velocity in time at each node, by the trapezoidal rule."""

    time: float  # length of the time interval (s)
    mean: Float[np.ndarray, "node across"]  # mean velocity (m/s)
    squared_deviation: Float[np.ndarray, "node across across"]
    """Integral of the squared deviation from the mean (m2/s)."""
    rate: Float[np.ndarray, "node across across"]  # integral of the squared rate of change (m2/s3)

    @staticmethod
    def of(
        velocity: Float[np.ndarray, "time node across"], time: Float[np.ndarray, " time"]
    ) -> "VelocityMoments":
        """Return the moments of a velocity (m/s) at some times (s)."""
        step = np.diff(time)
        length = np.ptp(time)
        weight = np.convolve(step, [0.5, 0.5]) if step.size else np.zeros(1)
        mean = np.einsum("t,tni->ni", weight, velocity) / (length or 1.0)
        swing, change = velocity - mean, np.diff(velocity, axis=0)
        return VelocityMoments(
            float(length),
            mean,
            np.einsum("t,tni,tnj->nij", weight, swing, swing),
            np.einsum("t,tni,tnj->nij", 1 / step, change, change),
        )

    def followed_by(self, other: "VelocityMoments") -> "VelocityMoments":
        """Return the moments over both intervals (Chan, Golub and LeVeque 1983)."""
        if not self.time or not other.time:
            return self if self.time else other
        whole = self.time + other.time
        apart = other.mean - self.mean
        between = self.time * other.time / whole * np.einsum("ni,nj->nij", apart, apart)
        return VelocityMoments(
            whole,
            self.mean + other.time / whole * apart,
            self.squared_deviation + other.squared_deviation + between,
            self.rate + other.rate,
        )

    def principal(self) -> Float[np.ndarray, "node across"]:
        """Return the direction along which it swings most: of the largest variance."""
        return np.linalg.eigh(self.squared_deviation)[1][..., -1]

    def keulegan_carpenter(
        self, diameter: Float[np.ndarray, " node"]
    ) -> Float[np.ndarray, " node"]:
        """Return ``2 pi A / d``, with the amplitude ``A`` of the water's swings past the arm.

        Of a velocity ``U sin(2 pi t / T)`` it is ``U T / d`` (Sumer and Fredsoe 2006, chapter 3).
        Of any other, ``U`` is the root of twice the variance and ``T = 2 pi sqrt(m0 / m2)``, the
        mean period between upward crossings of the mean (Rice 1945, of a Gaussian process), with
        the spectral moments ``m0`` and ``m2``: the variances of the velocity and of its rate of
        change, along the principal direction.
        """
        if not self.time:
            return np.zeros_like(diameter)
        along = self.principal()
        m0, m2 = (
            np.einsum("ni,nij,nj->n", along, part, along) / self.time
            for part in (self.squared_deviation, self.rate)
        )
        swings = m2 > 0
        period = 2 * np.pi * np.sqrt(np.divide(m0, m2, out=np.zeros_like(m0), where=swings))
        return np.asarray(np.sqrt(2 * m0) * period / diameter)
