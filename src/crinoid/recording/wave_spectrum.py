"""Spectra of surface waves: of frequency, or of frequency and direction."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.numerics.sea_statistics import SeaStatistics, trapezoids
from crinoid.recording.axes import find, only_dimension
from crinoid.recording.numbers import Column, check_count, quantity
from crinoid.recording.readers import read_dataset
from crinoid.recording.sea import Sea
from crinoid.recording.selection import at_place, is_labelled, left_over
from crinoid.recording.texts import REMARKS, listed, short
from crinoid.recording.units import angle_factor, factor, no_unit
from crinoid.scenario.errors import got, missing, refusal
from crinoid.scenario.sea_file import SpectrumFile

_NAMES = {
    "density": "sea_surface_wave_directional_variance_spectral_density "
    "sea_surface_wave_variance_spectral_density efth spectral_wave_density waveEnergyDensity "
    "density S",
    "frequency": "sea_surface_wave_frequency wave_frequency frequency freq waveFrequency f",
    "direction": "sea_surface_wave_to_direction sea_surface_wave_from_direction direction dir "
    "theta",
}
"""Standard names and usual names by role, the first ones first."""
_MOMENTS = ("mean_wave_dir", "principal_wave_dir", "wave_spectrum_r1", "wave_spectrum_r2")
"""Directions and sizes of both harmonics of the direction, in files of NDBC."""
_ANGLE = re.compile(r"rad|deg|\N{DEGREE SIGN}", re.IGNORECASE)
_TURN, _RATIO, _FAST, _DENSE = 2 * np.pi + 0.005, 1.005, 1e3, 1e6
"""Greatest direction (rad), ratio, frequency (Hz) and density (m2 s)."""
_COUNT, _SHARPEST = 360, 0.995
"""Directions of a density that has harmonics, and its greatest first harmonic."""
_FINE = 4000
"""Frequencies at which a density is interpolated for its statistics."""


def read_spectrum(table: SpectrumFile) -> Sea:
    """Read a spectrum of the elevation at one place and one time."""
    with read_dataset(table.file) as dataset:
        remarks: list[str] = dataset.attrs.get(REMARKS, "").splitlines()
        name, frequencies = (_named(dataset, table, key) for key in ("density", "frequency"))
        directions = _directions(dataset, table, name, frequencies)
        kept = [only_dimension(dataset[frequencies], "frequency")]
        kept += [only_dimension(dataset[directions], "direction")] if directions else []
        moments = [] if directions or not {*_MOMENTS} <= {*dataset.variables} else [*_MOMENTS]
        labels = [d for d in dataset[name].dims if is_labelled(dataset[name], str(d))]
        dataset = at_place(dataset.drop_vars(labels), table.select, [name, *moments], kept)

        def numbers(column: Column, over: list[str]) -> Float[np.ndarray, ...]:
            return _numbers(dataset, column, over, remarks)

        frequency = numbers(Column("frequency", frequencies, _hertz, "Hz", _FAST), kept[:1])
        attributes: dict[str, Any] = {"standard_name": "from"}
        if directions:
            attributes = dataset[directions].attrs
            column = Column("direction", directions, angle_factor, "degrees", _TURN)
            angle = numbers(column, kept[1:])
            if not dataset[name].attrs.get("units"):
                must = "name its unit, such as m2 s rad-1 or m2 s degree-1"
                raise refusal("density", f"{name} names no unit", must)
        per = _per_angle if directions else _per_hertz
        unit = "m2 s rad-1" if directions else "m2/Hz"
        density = numbers(Column("density", name, per, unit, _DENSE), kept)
        if moments:
            roles = [(angle_factor, "degrees", _TURN)] * 2 + [(no_unit, "1", _RATIO)] * 2
            columns = [
                Column("density", *each)
                for each in zip(moments, *zip(*roles, strict=True), strict=True)
            ]
            angle, density = _of_harmonics(density, [numbers(each, kept) for each in columns])
            remarks.append(
                "directions follow from both harmonics of each frequency by the method of most "
                "entropy"
            )
    order = np.argsort(frequency)
    order = order[frequency[order] > 0]
    frequency, density = frequency[order], density[order]
    if frequency.size < 2 or np.diff(frequency).min() <= 0:
        text = f"{frequencies} has a frequency twice, or less than two above 0"
        raise refusal("frequency", text, "contain each of two or more once")
    if not density.any() or density.min() < 0:
        text = f"{name} is {density.min():g} to {density.max():g}"
        raise refusal("density", text, "be 0 or more, and not 0 everywhere")
    given: dict[str, Any] = {"frequency": 2 * np.pi * frequency}
    if density.ndim > 1:
        angle, density = _travels(table, angle, density, attributes)
        given["direction"] = angle
    else:
        for key in ("direction_is", "heading_deg"):
            if (value := getattr(table, key)) is not None:
                raise refusal(key, got(value, f"be left out: {name} has no directions"))
    given["density"] = density / (2 * np.pi)
    statistics = _statistics(frequency, density, given.get("direction"))
    low, high = frequency[[0, -1]]
    remarks.append(f"{short(table.file)}: {statistics}, from {low:.3g} to {high:.3g} Hz")
    return Sea(short(table.file), statistics, given, None, tuple(remarks))


def _statistics(
    frequency: Float[np.ndarray, " f"],
    density: Float[np.ndarray, "f ..."],
    angle: Float[np.ndarray, " direction"] | None,
) -> SeaStatistics:
    """Return the statistics of a density (m2 s, per rad) that is linear between frequencies."""
    if angle is not None:
        steps = np.diff(angle, append=angle[0] + 2 * np.pi)
        density = density * 0.5 * (steps + np.roll(steps, 1))
    cells = frequency.size - 1
    fine = np.interp(
        np.linspace(0, cells, cells * -(-_FINE // cells) + 1), np.arange(cells + 1), frequency
    )
    columns = [np.interp(fine, frequency, each) for each in density.reshape(cells + 1, -1).T]
    variance = trapezoids(fine)[:, None] * np.stack(columns, axis=1)
    return SeaStatistics.of(fine, variance, angle)


def _named(dataset: xr.Dataset, table: SpectrumFile, key: str) -> str:
    """Return the variable that a key names, or the first one of a usual name."""
    known = {*map(str, dataset.variables), *dataset.cf.standard_names}
    usual = next((each for each in _NAMES[key].split() if each in known), None)
    name = getattr(table, key) or usual
    if name is None:
        text = f"{short(table.file)} contains {listed([str(each) for each in dataset.variables])}"
        raise refusal(key, text, f"name the variable of the {key}")
    return find(dataset, name, key, table.file)


def _directions(
    dataset: xr.Dataset, table: SpectrumFile, density: str, frequencies: str
) -> str | None:
    """Return the variable of the directions; None of a density over the frequencies alone."""
    across = {*dataset[density].dims} - {*dataset[frequencies].dims}
    if table.direction is None:
        usual, standard = _NAMES["direction"].split(), dataset.cf.standard_names
        named = [each for name in usual for each in standard.get(name, [name])]
        known = [each for each in named if each in dataset.variables]
        return next((each for each in known if {*dataset[each].dims} & across), None)
    name = _named(dataset, table, "direction")
    if not {*dataset[name].dims} & across:
        text = f"{density} has no dimension of {name}"
        raise refusal("direction", text, "have one for a spectrum with directions")
    return name


def _numbers(
    dataset: xr.Dataset, column: Column, over: list[str], remarks: list[str]
) -> Float[np.ndarray, ...]:
    """Return a variable over dimensions, without gaps, in SI units."""
    variable = dataset[column.name]
    for dimension in [str(each) for each in variable.dims if each not in over]:
        if variable.sizes[dimension] > 1:
            raise left_over(variable, column.name, column.key, dimension, profile=True)
        variable = variable.isel({dimension: 0})
    if lacking := [each for each in over if each not in variable.dims]:
        raise refusal(column.key, f"{column.name} lacks a dimension", f"have {listed(lacking)}")
    check_count(variable.size, column.name, column.name)
    values = quantity(dataset, variable.transpose(*over), column, remarks)
    if lacks := np.count_nonzero(~np.isfinite(values)):
        text = f"{column.name} lacks {lacks} of {values.size} values"
        raise refusal(column.key, text, "have all", "Select another time, or fill them in.")
    return values


def _hertz(units: str) -> float | None:
    """Return the factor to Hz; None also of rad/s, which the library of units takes for 1/s."""
    return None if "rad" in units else factor(units, to="Hz")


def _per_hertz(units: str) -> float | None:
    return None if _ANGLE.search(units) else factor(units, to="m2 s")


def _per_angle(units: str) -> float | None:
    """Return the factor to m2 s/rad; None of a density per no angle."""
    return factor(units, to="m2 s") if len(_ANGLE.findall(units)) == 1 else None


def _of_harmonics(
    density: Float[np.ndarray, " f"], harmonics: list[np.ndarray]
) -> tuple[Float[np.ndarray, " direction"], Float[np.ndarray, "f direction"]]:
    """Return directions (rad) and the density per angle with two harmonics and most entropy.

    After Lygre and Krogstad (1986, J. Phys. Oceanogr. 16). Harmonics that no density can have are
    brought nearer to each other.
    """
    alpha1, alpha2, r1, r2 = (each[:, None] for each in harmonics)
    first = np.clip(r1, 0.0, _SHARPEST) * np.exp(1j * alpha1)
    left, apart = 1 - np.abs(first) ** 2, r2 * np.exp(2j * alpha2) - first**2
    second = first**2 + apart * np.minimum(1, _SHARPEST * left / np.maximum(np.abs(apart), 1e-12))
    one = (first - second * first.conj()) / left
    two = second - first * one
    angle = np.linspace(0, 2 * np.pi, _COUNT, endpoint=False)
    shape = np.abs(1 - one * np.exp(-1j * angle) - two * np.exp(-2j * angle)) ** -2.0
    return angle, density[:, None] * shape / (shape.mean(axis=1, keepdims=True) * 2 * np.pi)


def _travels(
    table: SpectrumFile,
    angle: Float[np.ndarray, " direction"],
    density: Float[np.ndarray, "f direction"],
    attributes: dict[str, Any],
) -> tuple[Float[np.ndarray, " direction"], Float[np.ndarray, "f direction"]]:
    """Return directions of travel from x towards y, increasing within a turn (rad), and density."""
    named = " ".join(str(attributes.get(key, "")) for key in ("standard_name", "long_name"))
    words = {"to", "from"} & {*re.split(r"[\W_]+", named.lower())}
    if table.direction_is is None and len(words) != 1:
        hint = "The standard name of the directions does not say it."
        raise refusal("direction_is", missing('be "to" or "from", as waves travel', hint))
    if table.heading_deg is None:
        must = "be the compass heading of x (deg), as the spectrum has directions"
        raise refusal("heading_deg", missing(must, "90 for x toward the east."))
    opposite = (table.direction_is or words.pop()) == "from"
    angle = np.mod(np.deg2rad(table.heading_deg) - angle + np.pi * opposite, 2 * np.pi)
    order = np.argsort(angle)
    angle, density = angle[order], density[:, order]
    once = np.diff(angle, append=angle[0] + 2 * np.pi) > 1e-6  # 0 and 360 degrees are one
    if once.sum() < 3:
        raise refusal("direction", f"contains {once.sum()} directions", "contain 3 or more")
    return angle[once], density[:, once]
