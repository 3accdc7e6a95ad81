"""How an arm vibrates and what flow it is in: natural frequencies, dimensionless numbers."""

from __future__ import annotations

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.dynamics import Modes
from crinoid.scenario import Scenario

Nodal = Float[np.ndarray, "time node"]
Vectors = Float[np.ndarray, "time node axis"]


def with_dimensionless(dataset: xr.Dataset, scenario: Scenario, modes: Modes | None) -> xr.Dataset:
    """Add the numbers to a whole run; ``modes`` are those of the state that it starts from.

    What would have no meaning is left out: frequencies without modes, flow numbers without water
    or diameter, the reduced velocity of an arm that does not swing back.
    """
    found: dict[str, tuple[tuple[str, ...], np.ndarray, str, str]] = {}
    if modes is not None:
        number = ("mode", np.arange(1, modes.frequency.size + 1), {"long_name": "slowest first"})
        dataset = dataset.assign_coords(mode=number)
        found["natural_frequency"] = (
            ("mode",),
            modes.frequency,
            "Hz",
            "natural frequencies of the arm as it starts",
        )
        found["mode_shape"] = (
            ("mode", "node", "axis"),
            modes.shape,
            "1",
            "how the nodes move in a mode, 1 at most",
        )
    diameter = dataset["diameter"].values
    if scenario.water.density > 0 and diameter.min() > 0:
        speed, normal = np.linalg.norm(_relative(dataset), axis=2), normal_velocity(dataset)
        found["reynolds_number"] = (
            ("time", "node"),
            speed * diameter / scenario.water.kinematic_viscosity,
            "1",
            "Reynolds number of the water's velocity relative to the arm",
        )
        if modes is not None and modes.frequency[0] > 0:
            found["reduced_velocity"] = (
                ("time", "node"),
                np.abs(normal) / (modes.frequency[0] * diameter),
                "1",
                "relative velocity across the arm over first natural frequency and diameter",
            )
        found["keulegan_carpenter"] = (
            ("node",),
            keulegan_carpenter(normal, dataset["time"].values, diameter),
            "1",
            "Keulegan-Carpenter number of the swings of the relative velocity across the arm",
        )
    return dataset.assign(
        {
            name: (dims, values, {"units": units, "long_name": meaning})
            for name, (dims, values, units, meaning) in found.items()
        }
    )


def normal_velocity(dataset: xr.Dataset) -> Nodal:
    """Return the water's velocity relative to the arm, along its normals (m/s)."""
    return np.sum(_relative(dataset) * node_normal(dataset["tangent"].values), axis=2)


def _relative(dataset: xr.Dataset) -> Vectors:
    return dataset["flow_velocity"].values - dataset["velocity"].values


def node_normal(tangent: Float[np.ndarray, "time edge axis"]) -> Vectors:
    """Return the unit normals at the nodes, each between those of the edges beside it."""
    before = np.concatenate([tangent[:, :1], tangent], axis=1)
    after = np.concatenate([tangent, tangent[:, -1:]], axis=1)
    along = before + after
    turned = np.stack([-along[..., 1], along[..., 0]], axis=-1)
    return turned / np.linalg.norm(turned, axis=2, keepdims=True)


def keulegan_carpenter(
    velocity: Nodal, time: Float[np.ndarray, " time"], diameter: Float[np.ndarray, " node"]
) -> Float[np.ndarray, " node"]:
    """Return ``2 pi A / d``, with the amplitude ``A`` of the water's swings relative to the arm.

    Of a velocity ``U sin(2 pi t / T)`` it is ``U T / d`` (Sumer and Fredsoe 2006, chapter 3). Of
    any other, ``U`` is the root of twice the variance and ``T = 2 pi sqrt(m0 / m2)``, the mean
    period between upward crossings of the mean (Rice 1945, of a Gaussian process), with the
    spectral moments ``m0`` and ``m2``: the variances of the velocity and of its rate of change.
    """
    if time.size < 2:
        return np.zeros_like(diameter)
    step = np.diff(time)[:, None]
    middle = 0.5 * (velocity[1:] + velocity[:-1])
    mean = np.average(middle, axis=0, weights=step[:, 0])
    # trapezoid rule: the last step may be a short one
    squares = 0.5 * ((velocity[1:] - mean) ** 2 + (velocity[:-1] - mean) ** 2)
    m0 = np.average(squares, axis=0, weights=step[:, 0])
    m2 = np.average((np.diff(velocity, axis=0) / step) ** 2, axis=0, weights=step[:, 0])
    swings = m2 > 0
    period = 2 * np.pi * np.sqrt(np.divide(m0, m2, out=np.zeros_like(m0), where=swings))
    return np.sqrt(2 * m0) * period / diameter
