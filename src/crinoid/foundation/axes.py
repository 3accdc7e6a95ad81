"""Names of axes, channels of the base and coordinates of the tip, in the plane and in space.

By the number of axes, 2 or 3. A planar arm moves in x (forward) and z (up); y is to port.
"""

from typing import NamedTuple

AXES = {2: ("x", "z"), 3: ("x", "y", "z")}
"""Names of the axes: x forward, y to port, z up."""


class Channel(NamedTuple):
    """Degree of freedom of the base."""

    name: str
    turns: bool
    """Whether it rotates the base (rad) or shifts it (m)."""
    axis: str
    """Axis along or about which it moves the base."""
    dimensions: tuple[int, ...]
    """Dimensions of the arms whose base has it."""
    partner: dict[int, str]
    """Coordinate of the tip of a rigid arm that it alone moves, one to one, by dimension; rotations
    in space have none."""
    about: str
    """Description of its motion."""


CHANNEL_TABLE = (
    Channel("slide", False, "x", (2, 3), {2: "x", 3: "x"}, "Moves the base along x."),
    Channel("sway", False, "y", (3,), {3: "y"}, "Moves the base along y."),
    Channel("heave", False, "z", (2, 3), {2: "z", 3: "z"}, "Moves the base along z."),
    Channel("pan", True, "z", (3,), {}, "Turns the base from x towards y."),
    Channel("tilt", True, "y", (2, 3), {2: "angle"}, "Turns the base from x to z."),
    Channel("roll", True, "x", (3,), {}, "Turns the base about the arm's root."),
)
"""All channels, in the order in which a pose of the base has them (`crinoid.base.Base`)."""

CHANNELS = {
    axes: tuple(channel.name for channel in CHANNEL_TABLE if axes in channel.dimensions)
    for axes in (2, 3)
}
"""Names of the channels by dimension: shifts, and turns: pan from +x toward +y, tilt from +x toward
+z, roll about the arm from +y toward +z."""

ANGLES = tuple(channel.name for channel in CHANNEL_TABLE if channel.turns)
"""The channels that turn the base (rad); the others shift it (m)."""

PARTNERS = {
    axes: {row.name: row.partner[axes] for row in CHANNEL_TABLE if axes in row.partner}
    for axes in (2, 3)
}
"""Coordinate of the tip that each channel alone moves, by dimension."""

POSE = {2: ("x", "z", "angle"), 3: ("x", "y", "z", "direction_x", "direction_y", "direction_z")}
"""Components of the tip's pose: its position (m) and its direction, in the plane an angle (rad) and
in space a unit vector."""

STEEP = 0.26
"""Cosine of the tilt below which pan and roll of the root are hardly defined."""

LARGEST_TURN = 170.0
"""Largest valid turn between two edges (degrees)."""
