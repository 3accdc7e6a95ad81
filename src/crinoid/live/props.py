"""Debris to throw at an arm and a pull at its tip, which no scenario describes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.dynamics import State, System
from crinoid.programs import ONCE, compiled
from crinoid.scenario import Scenario, ScenarioError

__all__ = ["PULL", "Debris", "Props", "launched", "path_of", "tip_force"]

PULL = {"ramp_time": 0.1, "lasts": 1.0}
"""How a pull at the tip sets in, and when it ends (s)."""
_LONGEST = 3600.0
"""Simulated time after which a session is over (s)."""
_RADIUS = 0.08
"""Radius of the debris, over the arm's length."""
_FROM = 0.45
"""How far it is thrown from, over the arm's length."""
_SPEED = 1.3
"""How fast, beside the current, over the arm's length a second."""
_AIM = 0.7
"""Which part of the arm it is to hit, over its length from the root."""
_PARKED = 40.0
"""How far from the root it waits, over the arm's length."""
_DEFLECTION = 0.3
"""By how much a pull would bend an arm that was straight in the end, over its length."""
_STILL = 1e-3
"""Speed of the water below which it comes from no side (m/s)."""
_FLIGHT = 0.45
"""How long it flies (s)."""
_LED = 0.3
"""By how much it may be aimed ahead of an arm that moves, over its length."""


@dataclass(frozen=True)
class Debris:
    """A sphere that is as heavy as the water it displaces."""

    radius: float
    mass: float
    parked: tuple[float, ...]
    """Where it waits, in the world (m)."""

    def table(self, position: Any, velocity: Any) -> dict[str, Any]:
        """Return it as a table of a scenario."""
        return {
            "kind": "sphere",
            "radius": self.radius,
            "mass": self.mass,
            "position": [float(each) for each in position],
            "velocity": [float(each) for each in velocity],
        }


@dataclass(frozen=True)
class Props:
    """A load at the tip of no force, and debris that is far away, beside what a scenario has."""

    debris: Debris | None
    """None where the arm has no surface that could be hit."""
    duration: float
    """Simulated time that there is (s): an hour, or what files and tables of the scenario cover."""

    @staticmethod
    def beside(scenario: Scenario) -> Props:
        """Return the props that go with a scenario."""
        length = scenario.arm.length
        radius = max(_RADIUS * length, max(scenario.arm.diameters) / 2)
        parked = list(scenario.base.position)
        parked[0] -= _PARKED * length
        mass = (scenario.water.density or 1000.0) * 4 / 3 * np.pi * radius**3
        debris: Debris | None = Debris(radius, mass, tuple(parked))
        duration = max(_LONGEST, scenario.simulation.duration)
        try:
            Props(None, duration).added(scenario)
        except ScenarioError:  # a table or a file ends before that
            duration = scenario.simulation.duration
        try:
            Props(debris, duration).added(scenario)
        except ScenarioError:
            debris = None
        return Props(debris, duration)

    def added(self, scenario: Scenario) -> Scenario:
        """Return a scenario with them."""
        document, still = scenario.to_dict(), [0.0] * scenario.arm.dimension
        values: dict[str, Any] = {
            "load": [*document.get("load", []), {"kind": "tip", "force": still}],
            "simulation.duration": self.duration,
        }
        if self.debris is not None:
            table = self.debris.table(self.debris.parked, still)
            values["obstacle"] = [*document.get("obstacle", []), table]
        return scenario.with_values(values)


def tip_force(system: System) -> float:
    """Return a force (N) that would bend a straight arm by a good part of its length."""
    stiffness = float(jnp.min(system.forces.bending_stiffness(system.reference)))
    length = float(jnp.sum(system.reference.rest_length))
    return float(f"{3 * stiffness * _DEFLECTION / length**2:.2g}")


def path_of(
    debris: Debris, state: State, length: float, thickness: float
) -> tuple[Float[np.ndarray, " d"], Float[np.ndarray, " d"]]:
    """Return where debris comes from that is to hit an arm (m), and its velocity (m/s).

    It comes across the arm and with the current, from the other side where the arm is in the way,
    to where the arm will be if it goes on as it moves.

    Parameters
    ----------
    debris
        What is thrown.
    state
        The arm.
    length, thickness
        Those of the arm (m); the second at its thickest.
    """
    nodes = np.asarray(state.position)[1:]
    aim = round(_AIM * (len(nodes) - 1))
    along = nodes[min(aim + 1, len(nodes) - 1)] - nodes[aim - 1]
    along /= np.linalg.norm(along)
    water = np.asarray(state.flow_velocity)[1:][aim]
    across = water - (water @ along) * along
    if np.linalg.norm(across) < _STILL:
        down = np.zeros_like(along)
        down[-1] = -1.0
        across = down - (down @ along) * along
        if np.linalg.norm(across) < 0.1:  # the arm hangs
            across = np.eye(len(along))[0]
            across -= (across @ along) * along
    across /= np.linalg.norm(across)
    far = _FROM * length + debris.radius + thickness / 2
    led = _FLIGHT * np.asarray(state.velocity)[1:][aim]
    led *= min(1.0, _LED * length / max(float(np.linalg.norm(led)), 1e-9))
    places = [nodes[aim] + led - side * far * across for side in (1.0, -1.0)]
    room = [np.min(np.linalg.norm(nodes - place, axis=1)) for place in places]
    first = room[0] >= min(room[1], 2 * debris.radius + thickness)
    place, side = (places[0], 1.0) if first else (places[1], -1.0)
    return place, water + side * _SPEED * length * across


@compiled(**ONCE)
def launched(
    system: System, state: State, position: Float[Array, " d"], velocity: Float[Array, " d"]
) -> State:
    """Return a state in which the last obstacle is elsewhere (m) and moves otherwise (m/s)."""
    forces, motion = system.forces, state.motion
    assert forces.obstacles is not None
    row = forces.nodes(motion.position).shape[0] + forces.obstacles.count - 1
    axes = forces.axes
    moved = motion.position.at[row, :axes].set(position)
    return replace(
        state,
        motion=replace(
            motion,
            position=moved,
            velocity=motion.velocity.at[row, :axes].set(velocity),
            acceleration=motion.acceleration.at[row].set(0.0),
        ),
        ahead=state.ahead.at[row].set(0.0),
        earlier=state.earlier.at[:, row].set(0.0),
        gap=forces.gaps(moved),
    )
