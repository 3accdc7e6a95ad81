"""An input: one number that a controller commands."""

from typing import Literal

import equinox as eqx
from jaxtyping import Array, Float

InputKind = Literal["shift", "turn", "pressure", "tension", "share"]
"""Kinds of input: shifts (m) and turns (rad) of the base, pressure (Pa), tension (N), a share."""


class Input(eqx.Module):
    """One entry of a command: its name, unit, kind and limits."""

    name: str = eqx.field(static=True)
    """Its name in results and in `crinoid.Plan.mapping`."""
    unit: str = eqx.field(static=True)
    """Unit of its commands and limits."""
    kind: InputKind = eqx.field(static=True)
    """Kind of quantity: a shift (m) or turn (rad) of the base, a pressure (Pa), a tension (N), or
    a share."""
    lower: Float[Array, "*many"]
    """Smallest value that the actuator follows, in ``unit``."""
    upper: Float[Array, "*many"]
    """Largest value that the actuator follows, in ``unit``."""
