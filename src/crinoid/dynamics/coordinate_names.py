"""Names and units of the coordinates of a linearised time step."""

import equinox as eqx
import jax

from crinoid.dynamics.transition import LocalCoordinates, numbers_of
from crinoid.foundation.axes import AXES

Names = list[tuple[str, str]]
"""Names, each with its unit; "" for an unknown one."""

_RATES = (("", ""), ("v", " s-1"), ("a", " s-2"), ("auxiliary_", " s-3"))
"""Prefix and unit of position, velocity, acceleration and auxiliary acceleration."""
_FIELDS = {
    "position": "",
    "drive": "",
    "held": "",
    "velocity": " s-1",
    "acceleration": " s-2",
    "mean": " s-2",
}
"""Fields of the states of actuators, and their units after that of the input."""


def arm_names(coordinates: LocalCoordinates) -> Names:
    """Return the names of the coordinates of the arm, with obstacles and vehicle.

    The root is node 0; an edge has the number of the node at its start.
    """
    forces, rows = coordinates.system.forces, coordinates.state.motion.position
    nodes, width = forces.nodes(rows).shape[0], rows.shape[1]
    shifts = [(axis, "m") for axis in AXES[forces.axes]]
    turns = ["turn"] if forces.axes == 2 else [f"turn_{axis}" for axis in AXES[3]]
    rotations = [(turn, "rad") for turn in turns]
    count = 0 if forces.obstacles is None else forces.obstacles.count
    bodies = [f"obstacle_{index}" for index in range(count)]
    others = [(shifts, body) for body in bodies]
    if forces.turns:
        others += [(rotations, body) for body in bodies]
    if forces.vehicle is not None:
        others += [(shifts, "vehicle"), (rotations, "vehicle")]
    # the ghost behind the root is the first row
    places = [
        [
            *((name, unit, f"node_{row - 1}") for name, unit in shifts),
            ("spin", "rad", f"edge_{row - 2}"),
        ]
        for row in range(nodes)
    ]
    places += [
        [*((name, unit, body) for name, unit in each), ("", "", "")] for each, body in others
    ]
    flat = [each for row in places for each in row[:width]]
    moving = [flat[entry] for entry in coordinates.entries]
    memory = numbers_of(coordinates.state.memory)[0].size
    return [
        *(
            (f"{sign}{name}_{place}", unit + per)
            for sign, per in _RATES
            for name, unit, place in moving
        ),
        *((f"memory_{index}", "") for index in range(memory)),
    ]


def actuator_names(coordinates: LocalCoordinates) -> Names:
    """Return the names of the numbers in the states of the servos and the other actuators."""
    found, state = [], coordinates.state
    followers, states = coordinates.system.followers, (state.servo, *state.actuators)
    for index, (one, own) in enumerate(zip(followers, states, strict=True)):
        kind = "servo" if index == 0 else "actuator"
        for path, leaf in jax.tree_util.tree_leaves_with_path(own):
            if not eqx.is_inexact_array(leaf):
                continue
            field = jax.tree_util.keystr(path, simple=True, separator="_")
            if field in _FIELDS and leaf.size == len(one.inputs):
                unit = _FIELDS[field]
                found += [(f"{kind}_{each.name}_{field}", each.unit + unit) for each in one.inputs]
            else:
                found += [(f"{kind}_{index}_{field}_{place}", "") for place in range(leaf.size)]
    return found
