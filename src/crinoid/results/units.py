"""Units and numbers of tables and figures."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Unit(NamedTuple):
    """A unit to plot in: multiply SI values by `factor`, and write `name`."""

    factor: float
    name: str

    def number(self, value: float) -> str:
        """Write a value in SI with three digits, in this unit but without its name."""
        scaled = value * self.factor
        return f"{scaled:.0f}" if 1e3 <= abs(scaled) < 1e6 else f"{scaled:.3g}"

    def text(self, value: float) -> str:
        """Write a value in SI with three digits, in this unit."""
        return f"{self.number(value)} {self.name}".strip()


DEGREES = Unit(180.0 / np.pi, "deg")
SLOWEST = 1e-6  # frequency below which a mode does not oscillate (Hz)


def largest(*values: Float[np.ndarray, " ..."]) -> float:
    """Largest finite magnitude; 0 without any."""
    finite = (np.abs(array[np.isfinite(array)]).max(initial=0.0) for array in values)
    return float(max(finite, default=0.0))


def round_down(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)) * power:.3g}")


def length_unit(magnitude: float) -> Unit:
    """Metres, or millimetres for less than half a metre; exact zero is in millimetres."""
    if magnitude >= 0.5:
        return Unit(1.0, "m")
    return Unit(1e3, "mm") if magnitude >= 5e-4 or magnitude == 0.0 else Unit(1e6, "µm")


def without_round_off(
    values: Float[np.ndarray, "*shape"], size: float
) -> Float[np.ndarray, "*shape"]:
    """Return values with zeros in place of those below a millionth of a size."""
    return np.where(np.abs(values) < 1e-6 * size, 0.0, values)


def length_text(length: float) -> str:
    """Write a length in SI with three digits, in the unit to read it in; "-" for none."""
    return "-" if math.isnan(length) else length_unit(length).text(length)


def si_unit(magnitude: float, name: str) -> Unit:
    """Choose the unit, or its thousandth, millionth or billionth, to read numbers around one."""
    if magnitude < 1e-9 or magnitude >= 0.1:  # tables write less, which is round-off, as 0
        return Unit(1.0, name)
    for factor, prefix in ((1e3, "m"), (1e6, "µ")):
        if magnitude * factor >= 0.1:
            return Unit(factor, prefix + name)
    return Unit(1e9, "n" + name)


def power_of_ten(power: int) -> str:
    """Write a power of ten with a raised exponent."""
    raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}"


def no_swing(ratio: float) -> str:
    """Return the text for a mode without a frequency, by its damping ratio."""
    return "overdamped" if ratio >= 1 else "no swing"
