"""Spectra of surface waves: of frequency, or of frequency and direction."""

import re
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from jaxtyping import Float

from crinoid.numerics.sea_statistics import SeaStatistics
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
    "sea_surface_wave_variance_spectral_density efth spectral_wave_density density S",
    "frequency": "sea_surface_wave_frequency wave_frequency frequency freq f",
    "direction": "sea_surface_wave_to_direction sea_surface_wave_from_direction direction dir",
}
"""Standard names and usual names by role, the first ones first."""
_HARMONICS = ("mean_wave_dir", "principal_wave_dir", "wave_spectrum_r1", "wave_spectrum_r2")
"""Directions and sizes of both harmonics of the direction, in files of NDBC."""
_ANGLE = re.compile(r"rad|deg|\N{DEGREE SIGN}", re.IGNORECASE)
_TURN, _RATIO, _FAST, _DENSE = 2 * np.pi + 0.005, 1.005, 1e3, 1e6
"""Greatest direction (rad), ratio, frequency (Hz) and density (m2 s)."""
_FINE, _COUNT, _SHARPEST = 2000, 180, 0.995
"""Frequencies between which a density is linear, and of one that has harmonics the directions, and
the greatest first harmonic."""


def read_spectrum(table: SpectrumFile) -> Sea:
    """Read a spectrum of the elevation at one place and one time."""
    with read_dataset(table.file) as dataset:
        remarks: list[str] = dataset.attrs.get(REMARKS, "").splitlines()
        name, across, around = (_named(dataset, table, key) for key in _NAMES)
        for key, each in (("density", name), ("frequency", across)):
            if not each:
                text = f"{short(table.file)} contains {listed([*map(str, dataset.variables)])}"
                raise refusal(key, text, f"name the variable of the {key}")
        kept = [only_dimension(dataset[across], "frequency")]
        if around and (
            table.direction or {*dataset[around].dims} & {*dataset[name].dims} - {*kept}
        ):
            kept.append(only_dimension(dataset[around], "direction"))
        directed = len(kept) > 1
        both = not directed and {*_HARMONICS} <= {*dataset.variables}
        harmonics = _HARMONICS if both else ()
        dims = [*map(str, dataset[name].dims)]
        dataset = dataset.drop_vars([each for each in dims if is_labelled(dataset[name], each)])
        dataset = at_place(dataset, table.select, [name, *harmonics], kept)
        numbers = partial(_numbers, dataset, remarks)
        frequency = numbers(kept[:1], Column("frequency", across, _hertz, "Hz", _FAST))
        if directed and not dataset[name].attrs.get("units"):
            must = "name its unit, such as m2 s rad-1 or m2 s degree-1"
            raise refusal("density", f"{name} names no unit", must)
        per, unit = (_per_angle, "m2 s rad-1") if directed else (_per_hertz, "m2/Hz")
        density = numbers(kept, Column("density", name, per, unit, _DENSE))
        attributes: Mapping[Any, Any] = {"standard_name": "from"}
        if directed:
            attributes = dataset[around].attrs
            column = Column("direction", around, angle_factor, "degrees", _TURN)
            angle = numbers(kept[1:], column)
        elif harmonics:
            roles = [(angle_factor, "degrees", _TURN)] * 2 + [(no_unit, "1", _RATIO)] * 2
            pairs = zip(harmonics, roles, strict=True)
            parts = [numbers(kept, Column("density", each, *role)) for each, role in pairs]
            angle, density = _of_harmonics(density, *parts)
            remarks.append("directions have both harmonics of the file, and most entropy")
    order = np.argsort(frequency)[np.sort(frequency) > 0]
    frequency, density = frequency[order], density[order]
    if frequency.size < 2 or np.diff(frequency).min() <= 0:
        text = f"{across} has a frequency twice, or less than two above 0"
        raise refusal("frequency", text, "contain each of two or more once")
    if not density.any() or density.min() < 0:
        text = f"{name} is {density.min():g} to {density.max():g}"
        raise refusal("density", text, "be 0 or more, and not 0 everywhere")
    text = f"from {frequency[0]:.3g} to {frequency[-1]:.3g} Hz"
    cells = np.arange(frequency.size)
    fine = np.interp(
        np.linspace(0, cells[-1], -(-_FINE // cells[-1]) * cells[-1] + 1), cells, frequency
    )
    density = np.apply_along_axis(lambda each: np.interp(fine, frequency, each), 0, density)
    weights = np.gradient(fine)
    weights[[0, -1]] /= 2
    given: dict[str, Any] = {"frequency": 2 * np.pi * fine}
    if density.ndim > 1:
        given["direction"], density = _travels(table, angle, density, attributes)
        steps = np.diff(given["direction"], append=given["direction"][0] + 2 * np.pi)
        weights = np.outer(weights, 0.5 * (steps + np.roll(steps, 1)))
    for key in ("direction_is", "heading_deg") if density.ndim == 1 else ():
        if (value := getattr(table, key)) is not None:
            raise refusal(key, got(value, f"be left out: {name} has no directions"))
    given["density"] = density / (2 * np.pi)
    statistics = SeaStatistics.of(fine, weights * density, given.get("direction"))
    remarks.append(f"{short(table.file)}: {statistics}, {text}")
    return Sea(short(table.file), statistics, given, None, tuple(remarks))


def _named(dataset: xr.Dataset, table: SpectrumFile, key: str) -> str:
    """Return the variable that a key names, or the first one of a usual name; empty for none."""
    known = {*dataset.variables, *dataset.cf.standard_names}
    name = getattr(table, key) or next((e for e in _NAMES[key].split() if e in known), "")
    return name and find(dataset, name, key, table.file)


def _numbers(
    dataset: xr.Dataset, remarks: list[str], over: list[str], column: Column
) -> np.ndarray:
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
    """Return the factor to Hz; None of rad/s, which the library of units converts as 1/s."""
    return None if "rad" in units else factor(units, to="Hz")


def _per_hertz(units: str) -> float | None:
    return None if _ANGLE.search(units) else factor(units, to="m2 s")


def _per_angle(units: str) -> float | None:
    """Return the factor to m2 s/rad; None of a density per no angle."""
    return factor(units, to="m2 s") if len(_ANGLE.findall(units)) == 1 else None


def _of_harmonics(
    density: Float[np.ndarray, " f"], *harmonics: Float[np.ndarray, " f"]
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
    attributes: Mapping[Any, Any],
) -> tuple[Float[np.ndarray, " once"], Float[np.ndarray, "f once"]]:
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
