"""The plane and space: names of their axes, the base's channels and the tip's coordinates.

By the number of axes, 2 or 3. A planar arm moves in x (forward) and z (up); y is to port.
"""

AXES = {2: ("x", "z"), 3: ("x", "y", "z")}

CHANNELS = {
    2: ("slide", "heave", "tilt"),
    3: ("slide", "sway", "heave", "pan", "tilt", "roll"),
}
"""Shifts of the base along x, y and z, and turns: pan from +x toward +y, tilt from +x toward +z,
roll about the arm from +y toward +z."""

ANGLES = ("pan", "tilt", "roll")
"""The channels that turn the base (rad); the others shift it (m)."""

POSE = {
    2: ("x", "z", "angle"),
    3: ("x", "y", "z", "direction_x", "direction_y", "direction_z"),
}
"""Components of the tip's pose: its position (m) and its direction, in the plane an angle (rad) and
in space a unit vector."""

LARGEST_TURN = 170.0
"""Turn between two edges past which bending means nothing (degrees)."""
