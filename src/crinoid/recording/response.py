"""Response amplitude operators (RAOs) of a vessel: from a table, or from a file of capytaine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr
from jaxtyping import Complex, Float

from crinoid.recording.axes import find, only_dimension
from crinoid.recording.numbers import check_count, finite_numbers, labels_of, numbers_of
from crinoid.recording.readers import read_dataset
from crinoid.recording.texts import REMARKS, listed, short
from crinoid.recording.units import angle_factor, factor, no_unit, time_factor
from crinoid.scenario import Scenario, SurfaceWaves, percent, refusal, shown
from crinoid.scenario.base_motion import VESSEL, ResponseMotion
from crinoid.scenario.errors import missing

if TYPE_CHECKING:
    from crinoid.flow import Waves  # JAX: slow to load, not for reading

_Table = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Angular frequencies (rad/s), headings (rad), and complex motions over both."""
_WIDEST, _SAME = np.deg2rad(90) + 1e-6, 1e-6
"""Widest gap between two headings that is interpolated, and difference of equal ones (rad)."""
_LITTLE, _MOST = 5e-3, 0.05
"""Share of the energy of waves outside of the frequencies that has a note, and that is refused."""
_RATES = {"rad/s": 1.0, "rad s-1": 1.0, "hz": 2 * np.pi}
_PER_METRE = partial(factor, to="rad/m")


@dataclass(frozen=True)
class VesselResponse:
    """First-order motions of a vessel per amplitude of the waves.

    In waves with the elevation ``Re a exp(i (k x - omega t))`` a motion is
    ``Re a H exp(-i omega t)`` at x = 0: the argument of ``H`` is its lag behind the crest.
    """

    file: str
    frequency: Float[np.ndarray, " f"]
    """Angular frequencies (rad/s), increasing."""
    heading: Float[np.ndarray, " h"]
    """Directions of travel from the bow toward port (rad), increasing from 0 to a turn."""
    values: Complex[np.ndarray, "f h 6"]
    """Surge, sway, heave (m/m), roll, pitch and yaw (rad/m), by the signs of a vessel's log."""
    farthest: float
    """Shift of the arm's root that the waves of the scenario hardly exceed (m)."""
    notes: tuple[str, ...]

    def at(
        self, frequency: Float[np.ndarray, " m"], heading: Float[np.ndarray, " m"]
    ) -> Complex[np.ndarray, "m 6"]:
        """Return the motions in waves, interpolated linearly over frequency and heading.

        Complex numbers, not amplitudes and phases: a phase has jumps, and no value where the
        amplitude is 0. Outside of the frequencies those of the nearest one.
        """
        ring = np.append(self.heading, self.heading[0] + 2 * np.pi)
        angle = ring[0] + np.mod(heading - ring[0], 2 * np.pi)
        gap = np.diff(ring)[np.searchsorted(ring[1:-1], angle, side="right")]
        lost = (gap > _WIDEST) & (np.abs(angle[:, None] - ring).min(axis=1) > _SAME)
        if lost.any():
            text = f"waves travel at {np.rad2deg(angle[lost][0]):.0f} degrees from the bow, between"
            must = "have headings at most 90 degrees apart there"
            hint = "Set symmetric = true for a vessel whose port and starboard are alike."
            raise refusal("file", f"{text} headings of {self.file} that are far apart", must, hint)
        over = np.apply_along_axis(partial(np.interp, frequency, self.frequency), 0, self.values)
        rows = zip(angle, np.append(over, over[:, :1], axis=1), strict=True)
        return np.array([[np.interp(at, ring, each) for each in row.T] for at, row in rows])

    def beyond(self, waves: Waves) -> str:
        """Return a note on waves outside of the frequencies, empty for few; refuse too many."""
        low, high = self.frequency[[0, -1]] * [1 - _SAME, 1 + _SAME]
        frequency, amplitude = np.asarray(waves.frequencies), np.asarray(waves.amplitudes)
        outside = (frequency < low) | (frequency > high)
        share = np.sum(amplitude[outside] ** 2) / np.sum(amplitude**2)
        text = f"{percent(share)} of the energy of the waves is outside of {low:.4g} to {high:.4g}"
        if share > _MOST:
            hint = "Add frequencies to the file."
            raise refusal("file", f"{text} rad/s", f"be at most {percent(_MOST)}", hint)
        return f"{text} rad/s: there the RAOs are those of the end" if share > _LITTLE else ""


def read_response(motion: ResponseMotion, scenario: Scenario) -> VesselResponse:
    """Read the RAOs of a vessel; refuse a file that leaves a unit or a convention open."""
    columns = motion.columns.given(scenario.arm.dimension)
    if not any(sign for sign, _ in columns.values()):
        raise refusal("columns", "every motion is 0", "name a column")
    name = short(motion.file)
    with read_dataset(motion.file) as dataset:
        notes = tuple(dataset.attrs.get(REMARKS, "").splitlines())
        read = _of_hydrodynamics if "radiating_dof" in dataset.dims else _of_table
        frequency, heading, values = read(dataset, motion, columns)
    if not (np.isfinite(values).all() and np.all(frequency > 0) and np.isfinite(frequency).all()):
        text = f"{name} has a frequency that is not above 0, or lacks a row of a pair"
        raise refusal("file", text, "have a row for each frequency and heading")
    values = values.conj() if motion.phase_is == "lead" else values
    heading = heading + np.pi if motion.direction_is == "from" else heading
    if motion.symmetric:
        side = np.sin(heading)
        if side.max() > _SAME and side.min() < -_SAME:
            text = "got true for a file with headings of port and starboard"
            raise refusal("symmetric", text, "be left out")
        heading = np.append(heading, -heading)
        values = np.append(values, values * [1, -1, 1, -1, 1, -1], axis=1)
    turn = np.round(2 * np.pi, 12)
    heading, index = np.unique(np.round(heading % turn, 12) % turn, return_index=True)
    values = values[:, index]
    shift, turns = (np.linalg.norm(part, axis=2) for part in np.split(values, 2, axis=2))
    gain = np.max(shift + turns * np.linalg.norm(motion.offset), axis=1)
    waves = (flow.state for flow in scenario.flow if isinstance(flow, SurfaceWaves))
    farthest = sum(  # five standard deviations, or more
        1.25 * state.height * float(np.interp(2 * np.pi / state.period, frequency, gain))
        for state in waves
        if state is not None
    )
    return VesselResponse(name, frequency, heading, values, farthest, notes)


def _of_table(
    dataset: xr.Dataset, motion: ResponseMotion, columns: dict[str, tuple[float, str]]
) -> _Table:
    """Return the motions of a table with a row for each frequency and heading."""
    for key, senses in (("phase_is", '"lag" or "lead"'), ("direction_is", '"to" or "from"')):
        if getattr(motion, key) is None:
            raise refusal(key, missing(f"be {senses} for a table, as its source defines it"))

    def column(
        key: str, name: str, factor_of: Callable[[str], float | None], must: str
    ) -> Float[np.ndarray, " row"]:
        variable = dataset[find(dataset, name, key, motion.file)]
        only_dimension(variable, key)
        units = str(variable.attrs.get("units", "")).strip()
        scale = factor_of(units) if units else None
        if scale is None:
            text = f"{name} is in {shown(units)}" if units else f"{name} names no unit"
            raise refusal(key, text, f"be in {must}")
        return scale * finite_numbers(variable, key, "a number in each row").astype(float)

    if "period" in dataset.variables:
        with np.errstate(divide="ignore"):
            rate = 2 * np.pi / column("file", "period", time_factor, "s")
    else:
        rate = column("file", "frequency", lambda units: _RATES.get(units.lower()), "rad/s or Hz")
    angle = column("file", "heading", angle_factor, "deg or rad")
    rows = pd.MultiIndex.from_arrays([rate, angle])
    if rows.has_duplicates:
        text = f"{short(motion.file)} has two rows of one frequency and heading"
        raise refusal("file", text, "have each pair once")
    check_count(6 * rows.levshape[0] * rows.levshape[1], motion.file, "RAOs")
    found = np.zeros((rate.size, 6), complex)
    for name, (sign, given) in columns.items():
        if sign:
            key, place = f"columns.{name}", VESSEL.index(name)
            scale, must = (no_unit, "m/m") if place < 3 else (_PER_METRE, "deg/m or rad/m")
            amplitude = column(key, given, scale, must)
            joined = f"{given}_phase"
            phase = joined if joined in dataset.variables else f"{given} phase"
            lag = column(key, phase, angle_factor, "deg or rad")
            found[:, place] = sign * amplitude * np.exp(1j * lag)
    whole = pd.DataFrame(found, rows).reindex(pd.MultiIndex.from_product(rows.levels))
    frequency, heading = map(np.asarray, rows.levels)
    return frequency, heading, whole.to_numpy().reshape(*rows.levshape, 6)


def _of_hydrodynamics(
    dataset: xr.Dataset, motion: ResponseMotion, columns: dict[str, tuple[float, str]]
) -> _Table:
    """Return the motions of a dataset of capytaine.

    Those of its variable RAO, or ``X`` of ``(-omega^2 (M + A) - i omega B + C) X = F``.
    """
    if np.any(dataset.get("forward_speed", 0.0)):
        raise refusal("file", f"{short(motion.file)} is of a vessel under way", "be of one at rest")

    def array(name: str, *dims: str) -> xr.DataArray:
        variable = dataset[find(dataset, name, "file", motion.file)]
        found = variable.copy(data=numbers_of(variable, "file", "numbers").astype(float))
        if "complex" in found.dims:  # real and imaginary part, in this order
            found = found.isel(complex=0, drop=True) + 1j * found.isel(complex=1, drop=True)
        if {*found.dims} != {*dims}:
            text = f"{name} has dimensions {listed(list(map(str, found.dims)))}"
            raise refusal("file", text, f"have {listed(list(dims))}")
        return found.transpose(*dims)

    waves, dofs = ("omega", "wave_direction"), ("influenced_dof", "radiating_dof")
    omega, heading = array("omega", "omega"), array("wave_direction", "wave_direction").values
    if "RAO" in dataset.variables:
        values = array("RAO", *waves, "radiating_dof").values
    else:
        inertia = array("inertia_matrix", *dofs) + array("added_mass", "omega", *dofs)
        damping = array("radiation_damping", "omega", *dofs)
        whole = array("hydrostatic_stiffness", *dofs) - omega * (omega * inertia + 1j * damping)
        force = sum(
            array(name, *waves, "influenced_dof").values
            for name in ("Froude_Krylov_force", "diffraction_force")
        )
        matrix = whole.transpose("omega", *dofs).values[:, None]
        values = np.linalg.solve(matrix, np.asarray(force)[..., None])[..., 0]
    labels = [label.lower() for label in labels_of(dataset["radiating_dof"])]
    found = np.zeros((*values.shape[:2], 6), complex)
    for name, (sign, given) in columns.items():
        if sign and given.lower() not in labels:
            text = f"got {shown(given)}, no such degree of freedom in {short(motion.file)}"
            raise refusal(f"columns.{name}", f"{text}; it contains {listed(labels)}")
        if sign:
            found[..., VESSEL.index(name)] = sign * values[..., labels.index(given.lower())]
    found[..., VESSEL.index("pitch")] *= -1  # a right-handed turn about y lowers the bow
    order = np.argsort(omega.values)
    return omega.values[order], heading, found[order]
