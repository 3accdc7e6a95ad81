"""Rows of the arrays of a state, by name: nodes of the arm, then obstacles, then a vehicle.

Where some obstacles are free, the rotations of all of them follow on their positions.
"""

from typing import Any, NamedTuple

from jaxtyping import Array, Float

Rows = Float[Array, "rows b"]
"""Numbers of all rows."""
GHOST, ROOT = 0, 1
"""Rows of the nodes that the base holds: the ghost behind the root, and the root."""
BOUNDARY_NODES = 2
"""Number of nodes with a prescribed motion: the ghost node and the root."""
CENTRE, ROTATION = -2, -1
"""Rows of a vehicle: its centre of mass, and its rotation since the start of the step."""
VEHICLE_ROWS = 2
SPIN = 3
"""Column of the spin of the edge that ends at a node, in space."""


class RowLayout(NamedTuple):
    """Rows of nodes, obstacles and a vehicle; empty where there are none."""

    nodes: slice
    obstacles: slice
    rotations: slice
    """Rotation of each obstacle since the start, where some are free."""
    vehicle: slice
    obstacle_rows: slice
    """Positions and rotations of the obstacles."""

    @staticmethod
    def of(obstacles: int, *, turning: bool, vehicle: bool) -> "RowLayout":
        """Return the layout for a number of obstacles, some ``turning``, and perhaps a vehicle."""
        last = VEHICLE_ROWS if vehicle else 0
        end, none = -last or None, slice(0, 0)
        middle = obstacles + last if turning else last
        return RowLayout(
            slice(-(obstacles + middle) or None),
            slice(-(obstacles + middle), -middle or None) if obstacles else none,
            slice(-middle, end) if turning else none,
            slice(-last, None) if vehicle else none,
            slice(-(obstacles + middle), end) if obstacles else none,
        )

    def obstacle(self, index: Any) -> Any:
        """Return the row of an obstacle, or the rows of several."""
        return self.obstacles.start + index
