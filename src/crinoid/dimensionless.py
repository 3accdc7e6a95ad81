"""How an arm vibrates and what flow it is in: natural frequencies, dimensionless numbers."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from jaxtyping import Bool, Float

from crinoid.dynamics import Modes
from crinoid.pieces import pieces
from crinoid.scenario import Scenario
from crinoid.variables import Content, quantity

Vectors = Float[np.ndarray, "time node axis"]

MOTION = ("flow_velocity", "velocity", "tangent")
"""Variables that tell how the water moves past the arm."""


def dimensionless(
    flow: Vectors,
    tangent: Float[np.ndarray, "time edge axis"],
    diameter: Float[np.ndarray, " node"],
    scenario: Scenario,
    modes: Modes | None,
) -> Content:
    """Return the numbers of instants of a run.

    What would have no meaning is left out: frequencies without modes, flow numbers without water
    or diameter, the reduced velocity of an arm that does not swing back.

    Parameters
    ----------
    flow
        Velocity of the water at the nodes, relative to the arm (m/s).
    tangent
        Direction of the edges.
    diameter
        That the water sees, of each node (m).
    scenario
        What is run.
    modes
        Those of the state that it starts from.
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


def with_swings(dataset: xr.Dataset) -> xr.Dataset:
    """Add the Keulegan-Carpenter number to a whole run, where it has a meaning."""
    if "reynolds_number" not in dataset:
        return dataset
    swings = Swings.of_nothing()
    for piece in pieces(dataset, MOTION, overlap=True):
        swings = swings.followed_by(Swings.of(normal_velocity(piece), piece["time"].values))
    number = swings.keulegan_carpenter(dataset["diameter"].values)
    name = "keulegan_carpenter"
    return dataset.assign({name: quantity(name, number, dataset.sizes["axis"])})


def spinning(
    shape: Float[np.ndarray, "mode node axis"],
    spin: Float[np.ndarray, "mode edge"] | None,
    diameter: Float[np.ndarray, " node"],
) -> Bool[np.ndarray, " mode"]:
    """Return which modes move the arm's surface more by its spin than by where it goes."""
    if spin is None:
        return np.zeros(shape.shape[0], bool)
    going = np.linalg.norm(shape, axis=2).max(axis=1)
    return np.asarray(going < np.abs(spin).max(axis=1) * diameter.max() / 2)


def normal_velocity(dataset: xr.Dataset) -> Float[np.ndarray, "time node across"]:
    """Return the part of the water's velocity relative to the arm that is across it (m/s)."""
    flow = dataset["flow_velocity"].values - dataset["velocity"].values
    return across(flow, dataset["tangent"].values)


def across(
    vectors: Float[np.ndarray, "_ node axis"], tangent: Float[np.ndarray, "_ edge axis"]
) -> Float[np.ndarray, "_ node across"]:
    """Return the parts of vectors at the nodes that are across the arm.

    That is normal to the direction between those of the edges beside a node: in the plane a
    component along the one normal, from x toward z; in space a vector.
    """
    before = np.concatenate([tangent[:, :1], tangent], axis=1)
    after = np.concatenate([tangent, tangent[:, -1:]], axis=1)
    along = before + after
    if along.shape[2] == 2:
        x, z = along[..., 0], along[..., 1]
        across_it = (vectors[..., 1] * x - vectors[..., 0] * z) / np.sqrt(x**2 + z**2)
        return np.asarray(across_it[..., None])
    along = along / np.linalg.norm(along, axis=2, keepdims=True)
    return vectors - np.sum(vectors * along, axis=2, keepdims=True) * along


class Swings(NamedTuple):
    """How a velocity swings at each node: its moments over time, by the trapezoid rule."""

    time: float
    """Length of the time that they are of (s)."""
    mean: Float[np.ndarray, "node across"]
    """Mean velocity (m/s)."""
    spread: Float[np.ndarray, "node across across"]
    """Integral of the squares of what it is off its mean (m2/s)."""
    rate: Float[np.ndarray, "node across across"]
    """Integral of the squares of its rate of change (m2/s3)."""

    @staticmethod
    def of_nothing() -> Swings:
        """Return the moments of no time."""
        return Swings(0.0, np.zeros(()), np.zeros(()), np.zeros(()))

    @staticmethod
    def of(
        velocity: Float[np.ndarray, "time node across"], time: Float[np.ndarray, " time"]
    ) -> Swings:
        """Return the moments of a velocity (m/s) at some times (s)."""
        step = np.diff(time)
        length = np.ptp(time)
        weight = np.convolve(step, [0.5, 0.5]) if step.size else np.zeros(1)
        mean = np.einsum("t,tni->ni", weight, velocity) / (length or 1.0)
        swing, change = velocity - mean, np.diff(velocity, axis=0)
        return Swings(
            float(length),
            mean,
            np.einsum("t,tni,tnj->nij", weight, swing, swing),
            np.einsum("t,tni,tnj->nij", 1 / step, change, change),
        )

    def followed_by(self, other: Swings) -> Swings:
        """Return the moments of both (Chan, Golub and LeVeque 1983, of variances in parts)."""
        if not self.time or not other.time:
            return self if self.time else other
        whole = self.time + other.time
        apart = other.mean - self.mean
        between = self.time * other.time / whole * np.einsum("ni,nj->nij", apart, apart)
        return Swings(
            whole,
            self.mean + other.time / whole * apart,
            self.spread + other.spread + between,
            self.rate + other.rate,
        )

    def principal(self) -> Float[np.ndarray, "node across"]:
        """Return the direction along which it swings most: of the largest variance."""
        return np.linalg.eigh(self.spread)[1][..., -1]

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
            for part in (self.spread, self.rate)
        )
        swings = m2 > 0
        period = 2 * np.pi * np.sqrt(np.divide(m0, m2, out=np.zeros_like(m0), where=swings))
        return np.asarray(np.sqrt(2 * m0) * period / diameter)
