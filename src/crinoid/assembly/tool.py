"""The numbers of a tool, and the element that they make."""

from __future__ import annotations

from dataclasses import replace

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from crinoid.assembly.numbers import array, from_table
from crinoid.assembly.obstacle import edges_within
from crinoid.dynamics import Grasp
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
    """From when on and until when it is held; infinite if for good (s). Where touches decide, the
    times between which they count."""
    touched: Bool[Array, " edge"] | None
    """Which edges take it up, or let it go, at a touch; None where times decide."""
    take: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is taken up."""
    drop: int | None = eqx.field(static=True)
    """The obstacle at whose touch it is let go."""

    @staticmethod
    def of(tool: Table, nodes: int) -> ToolParameters:
        """Return the numbers of the tool of an arm."""
        until = np.inf if tool.until is None else tool.until
        return from_table(
            ToolParameters,
            tool,
            held=Onset(*map(array, (tool.from_, 0.0, until))),
            touched=edges_within(tool.touched, nodes) if tool.touches else None,
            take=tool.take_at_touch,
            drop=tool.drop_at_touch,
        )

    def grasp(self) -> Grasp | None:
        """Return the touches that decide when it is held, if any do."""
        if self.touched is None:
            return None
        return Grasp(self.take, self.drop, self.touched, self.held)

    def element(self, rod: Rod, density: Array, gravity: Array) -> Tool:
        """Build the tool at the tip of a rod in water of a density (kg/m3); traceable."""
        # not there before a touch: a window without length
        stop = self.held.stop if self.take is None else self.held.start
        return Tool.of(
            rod,
            mass=self.mass,
            density=density,
            gravity=gravity,
            inertia=self.inertia,
            volume=self.volume,
            added_mass=self.added_mass,
            drag_area=self.drag_area,
            offset=self.offset,
            held=replace(self.held, stop=stop),
        )
