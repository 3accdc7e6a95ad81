"""Response amplitude operators (RAOs) of a vessel: from a table, or from a file of capytaine.

Of a wave with the elevation ``Re a exp(i (k x - omega t))`` a motion is ``Re a H exp(-i omega t)``
at the place of the vessel: the argument of ``H`` is the lag of the motion behind the crest.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr
from jaxtyping import Complex, Float

from crinoid.recording.axes import find, only_dimension
from crinoid.recording.numbers import check_count, finite_numbers, labels_of, numbers_of
from crinoid.recording.readers import read_dataset
from crinoid.recording.texts import REMARKS, listed, short
from crinoid.recording.units import angle_factor, factor, no_unit, time_factor
from crinoid.scenario import Scenario, SurfaceWaves, got, percent, refusal, shown
from crinoid.scenario.base_motion import VESSEL, ResponseMotion, signed
from crinoid.scenario.errors import missing

_Read = tuple[np.ndarray, np.ndarray, np.ndarray]
_FactorOf = Callable[[str], float | None]
_MIRRORED = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of the motions of a mirrored vessel: sway, roll and yaw turn round."""
_WIDEST = np.deg2rad(90) + 1e-6
"""Widest gap between two headings that is interpolated (rad)."""
_SAME = 1e-6
"""Difference of headings that are one (rad)."""
_BEYOND = 0.05
"""Largest share of the energy of waves outside of the frequencies of the file."""
_RARE = 5.0
"""Standard deviations that a first-order motion hardly exceeds."""
_RADIANS = re.compile(r"rad(ian)?s?(/|\s?\*?\s?)(s|sec|second)(\^?-1|\*\*-1)?")


@dataclass(frozen=True)
class VesselResponse:
    """First-order motions of a vessel per amplitude of the waves."""

    file: str
    """Name of the file."""
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

        Complex numbers, not amplitudes and phases: a phase jumps by a turn, and has no value where
        the amplitude is 0. Outside of the frequencies those of the nearest one.

        Raises
        ------
        ScenarioError
            If waves travel between two headings of the file that are far apart.
        """
        first, count = self.heading[0], self.heading.size
        ring = np.append(self.heading, first + 2 * np.pi)
        angle = first + np.mod(heading - first, 2 * np.pi)
        nearest = np.abs(angle[:, None] - ring).argmin(axis=1)
        apart = np.abs(angle - ring[nearest])
        place = np.interp(angle, ring, np.arange(count + 1))
        place = np.where(apart < _SAME, nearest, place)
        left = np.minimum(place.astype(int), count - 1)
        lost = (apart >= _SAME) & (np.diff(ring)[left] > _WIDEST)
        if lost.any():
            text = f"waves travel at {np.rad2deg(angle[lost][0]):.0f} degrees from the bow, and "
            text += f"{self.file} has no headings within 90 degrees on both sides"
            hint = "Set symmetric = true for a vessel whose port and starboard are alike."
            raise refusal("file", text, "cover the headings of all waves", hint)
        at = np.interp(frequency, self.frequency, np.arange(self.frequency.size))
        low = at.astype(int)
        found = np.zeros((angle.size, 6), complex)
        for row, of_row in (
            (low, 1 - at + low),
            (np.minimum(low + 1, self.frequency.size - 1), at - low),
        ):
            for column, of_column in ((left, 1 - place + left), (left + 1, place - left)):
                found += (of_row * of_column)[:, None] * self.values[row, column % count]
        return found

    def beyond(
        self, frequency: Float[np.ndarray, " m"], amplitude: Float[np.ndarray, " m"]
    ) -> str | None:
        """Return a note on waves outside of the frequencies of the file, or refuse too many."""
        first, last = self.frequency[[0, -1]]
        energy = amplitude**2 / np.sum(amplitude**2)
        share = float(
            energy[(frequency < first * (1 - _SAME)) | (frequency > last * (1 + _SAME))].sum()
        )
        text = (
            f"{percent(share)} of the energy of the waves is outside of {first:.4g} to {last:.4g}"
        )
        text += " rad/s"
        if share > _BEYOND:
            hint = "Add frequencies to the file."
            raise refusal("file", text, f"be at most {percent(_BEYOND)}", hint)
        return f"{text}: the RAOs of the nearest frequency count there" if share else None


def response_readers(scenario: Scenario) -> dict[str, Callable[[], VesselResponse]]:
    """Return a reader of the RAOs of each vessel of a scenario, by the key of its table."""
    return {
        f"base.motion.{index}": lambda motion=motion: read_response(motion, scenario)
        for index, motion in enumerate(scenario.base.motion)
        if isinstance(motion, ResponseMotion)
    }


def read_response(motion: ResponseMotion, scenario: Scenario) -> VesselResponse:
    """Read the RAOs of a vessel.

    Raises
    ------
    ScenarioError
        If the file does not fit the keys, or leaves a unit or a convention open.
    """
    columns = motion.columns.given(scenario.arm.dimension)
    if not any(sign for sign, _ in columns.values()):
        raise refusal("columns", "every motion is 0", "name a column")
    with read_dataset(motion.file) as dataset:
        remarks: list[str] = dataset.attrs.get(REMARKS, "").splitlines()
        read = _of_hydrodynamics if "radiating_dof" in dataset.dims else _of_table
        frequency, heading, values = read(dataset, motion, columns)
    if not frequency.size or not (frequency[0] > 0 and np.isfinite(frequency[-1])):
        text = f"frequencies are {listed([f'{each:.4g}' for each in frequency])} rad/s"
        raise refusal("frequency_column", text, "be above 0")
    if not np.isfinite(values).all():
        raise refusal("file", f"{short(motion.file)} has a missing RAO", "have one for each wave")
    values = values if motion.phase_is != "lead" else values.conj()
    heading, values = _turned(motion, heading, values)
    deviation = sum(
        flow.state.deviation
        for flow in scenario.flow
        if isinstance(flow, SurfaceWaves) and flow.state is not None
    )
    shift, turn = (np.linalg.norm(part, axis=2) for part in (values[..., :3], values[..., 3:]))
    gain = float(np.max(shift + turn * np.linalg.norm(motion.offset)))
    name = short(motion.file)
    return VesselResponse(
        name, frequency, heading, values, _RARE * deviation * gain, tuple(remarks)
    )


def _turned(
    motion: ResponseMotion, heading: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return headings as directions of travel, increasing within a turn, and their motions."""
    if motion.direction_is == "from":
        heading = heading + np.pi
    if motion.symmetric:
        side = np.sin(heading)
        if side.max() > _SAME and side.min() < -_SAME:
            text = "got true for a file with headings of port and starboard"
            raise refusal("symmetric", text, "be left out")
        aside = np.abs(side) > _SAME
        heading = np.concatenate([heading, -heading[aside]])
        values = np.concatenate([values, _MIRRORED * values[:, aside]], axis=1)
    heading = np.mod(heading + _SAME, 2 * np.pi) - _SAME
    order = np.argsort(heading, kind="stable")
    heading, values = heading[order], values[:, order]
    again = np.flatnonzero(np.diff(heading) < 2 * _SAME)
    if not np.allclose(values[:, again], values[:, again + 1], rtol=1e-3, atol=1e-9):
        text = f"{np.rad2deg(heading[again[0]]):.0f} degrees has two rows with other values"
        raise refusal("heading_column", text, "have each heading once")
    return np.delete(heading, again), np.delete(values, again, axis=1)


def _of_table(
    dataset: xr.Dataset, motion: ResponseMotion, columns: dict[str, tuple[float, str]]
) -> _Read:
    """Return frequencies, headings and motions of a table with a row for each pair."""
    for key, senses in (("phase_is", '"lag" or "lead"'), ("direction_is", '"to" or "from"')):
        if getattr(motion, key) is None:
            raise refusal(key, missing(f"be {senses} for a table, as its source defines it"))

    def column(name: str, key: str, factor_of: _FactorOf, must: str) -> np.ndarray:
        variable = dataset[find(dataset, name, key, motion.file)]
        only_dimension(variable, key)
        units = str(variable.attrs.get("units", "")).strip()
        scale = factor_of(units) if units else None
        if scale is None:
            text = f"{name} is in {shown(units)}" if units else f"{name} names no unit"
            raise refusal(key, text, f"be in {must}")
        return scale * finite_numbers(variable, key, "a number in each row").astype(float)

    key, known = "frequency_column", ("frequency", "period")
    name = motion.frequency_column or next((n for n in known if n in dataset.variables), known[0])
    variable = dataset[find(dataset, name, key, motion.file)]
    if time_factor(str(variable.attrs.get("units", ""))):
        with np.errstate(divide="ignore"):
            rate = 2 * np.pi / column(name, key, time_factor, "s")
    else:
        rate = column(name, key, _rate, "rad/s, Hz or s")
    sign, name = signed(motion.heading_column)
    angle = column(name, "heading_column", angle_factor, "deg or rad")
    frequency, row = np.unique(rate, return_inverse=True)
    heading, place = np.unique(sign * angle, return_inverse=True)
    check_count(frequency.size * heading.size * 6, motion.file, "RAOs")
    count = np.zeros((frequency.size, heading.size), int)
    np.add.at(count, (row, place), 1)
    if (count != 1).any():
        i, j = np.argwhere(count != 1)[0]
        pair = f"{frequency[i]:.4g} rad/s and {np.rad2deg(heading[j]):.4g} degrees"
        text = f"{short(motion.file)} has {count[i, j] or 'no'} rows of {pair}"
        raise refusal("file", text, "have one row for each frequency and heading")
    values = np.zeros((*count.shape, 6), complex)
    for name, (reverse, given) in columns.items():
        if not reverse:
            continue
        key, number = f"columns.{name}", VESSEL.index(name)
        shifts = number < 3
        scale, must = (
            (no_unit, "m/m") if shifts else (_turn, "deg/m or rad/m of the wave amplitude")
        )
        amplitude = column(given, key, scale, must)
        phases = [
            each for each in (f"{given} phase", f"{given}_phase") if each in dataset.variables
        ]
        phase = column((phases or [f"{given} phase"])[0], key, angle_factor, "deg or rad")
        values[row, place, number] = reverse * amplitude * np.exp(1j * phase)
    return frequency, heading, values


def _of_hydrodynamics(
    dataset: xr.Dataset, motion: ResponseMotion, columns: dict[str, tuple[float, str]]
) -> _Read:
    """Return frequencies, headings and motions from a dataset of capytaine.

    Those of its variable RAO, or ``X`` of ``(-omega^2 (M + A) - i omega B + C) X = F``.
    """
    for key, default in (("frequency_column", None), ("heading_column", "heading")):
        if (given := getattr(motion, key)) != default:
            raise refusal(key, got(given, "be left out for a file of capytaine"))
    if np.any(dataset.get("forward_speed", 0.0)):
        raise refusal(
            "file", f"{short(motion.file)} is of a vessel that travels", "be of one at rest"
        )
    rate = dataset[find(dataset, "omega", "file", motion.file)]
    if rate.ndim == 1 and rate.dims != ("omega",):  # periods, or wave numbers, are the index
        dataset = dataset.swap_dims({rate.dims[0]: "omega"})

    def array(name: str, *dims: str) -> xr.DataArray:
        variable = dataset[find(dataset, name, "file", motion.file)]
        found = variable.copy(data=numbers_of(variable, "file", "numbers").astype(float))
        if "complex" in found.dims:
            found = found.isel(complex=0, drop=True) + 1j * found.isel(complex=1, drop=True)
        single = [each for each in found.dims if each not in dims and found.sizes[each] == 1]
        found = found.squeeze(single, drop=True)
        if {*found.dims} != {*dims}:
            text = f"{name} has dimensions {listed(list(map(str, found.dims)))}"
            raise refusal("file", text, f"have {listed(list(dims))}")
        return found.transpose(*dims)

    over, dofs = ("omega", "wave_direction"), ("influenced_dof", "radiating_dof")
    names = [str(name) for name in dataset.variables if str(name).lower() == "rao"]
    omega, heading = array("omega", "omega"), array("wave_direction", "wave_direction").values
    if names:
        values = array(names[0], *over, "radiating_dof").values
    else:
        inertia = array("inertia_matrix", *dofs) + array("added_mass", "omega", *dofs)
        damping = array("radiation_damping", "omega", *dofs)
        stiffness = array("hydrostatic_stiffness", *dofs)
        parts = ["excitation_force"]
        if parts[0] not in dataset.variables:
            parts = ["Froude_Krylov_force", "diffraction_force"]
        force = sum(array(part, *over, "influenced_dof") for part in parts)
        whole = -(omega**2) * inertia - 1j * omega * damping + stiffness
        matrix = whole.transpose("omega", *dofs).values[:, None]
        values = np.linalg.solve(matrix, np.asarray(force)[..., None])[..., 0]
    labels = [label.lower() for label in labels_of(dataset["radiating_dof"])]
    chosen = np.zeros((*values.shape[:2], 6), complex)
    for name, (sign, given) in columns.items():
        if sign and given.lower() not in labels:
            text = f"got {shown(given)}, no such degree of freedom in {short(motion.file)}"
            raise refusal(f"columns.{name}", f"{text}; it contains {listed(labels)}")
        if sign:
            chosen[..., VESSEL.index(name)] = sign * values[..., labels.index(given.lower())]
    chosen[..., VESSEL.index("pitch")] *= -1  # a right-handed turn about y lowers the bow
    order = np.argsort(omega.values)
    order = order[np.isfinite(omega.values[order]) & (omega.values[order] > 0)]
    return omega.values[order], heading, chosen[order]


def _rate(units: str) -> float | None:
    """Return the factor to rad/s from a unit of frequencies, of which a library knows no turns."""
    if _RADIANS.fullmatch(units.lower()):
        return 1.0
    hertz = factor(units, "Hz") if units.lower().endswith(("hz", "hertz")) else None
    return None if hertz is None else 2 * np.pi * hertz


def _turn(units: str) -> float | None:
    """Return the factor to rad/m; from a turn per wave slope there is none."""
    return factor(units, "rad/m") if "/" in units or "m" in units else None
