"""The numbers of a tool, and the element that they make."""

from __future__ import annotations

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from crinoid.assembly.numbers import array, from_table
from crinoid.elements import Tool
from crinoid.onset import Onset
from crinoid.rod import Rod
from crinoid.scenario import Tool as Table


class ToolParameters(eqx.Module):
    """The numbers of ``[tool]``."""

    mass: Float[Array, ""]
    volume: Float[Array, ""]
    drag_area: Float[Array, ""]
    added_mass: Float[Array, ""]
    inertia: Float[Array, ...]
    """One number, or in space three (kg m2)."""
    offset: Float[Array, ""]
    held: Onset
    """From when on and until when it is held; infinite if for good (s)."""

    @staticmethod
    def of(tool: Table) -> ToolParameters:
        """Return the numbers of a tool."""
        until = np.inf if tool.until is None else tool.until
        return from_table(ToolParameters, tool, held=Onset(*map(array, (tool.from_, 0.0, until))))

    def element(self, rod: Rod, density: Array, gravity: Array) -> Tool:
        """Build the tool at the tip of a rod in water of a density (kg/m3); traceable."""
        return Tool.of(rod, density=density, gravity=gravity, **vars(self))
