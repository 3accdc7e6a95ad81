"""A neural controller from the file of its policy, and the numbers that it observes."""

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.actuation import Follower, Input
from crinoid.assembly.arrays import array
from crinoid.assembly.description import KEY, Description, described, opened, refuse
from crinoid.assembly.plan import AssembledScenario
from crinoid.control import Neural, Observation
from crinoid.control.neural import Dense, Policy
from crinoid.foundation.atomic_file import atomic_write
from crinoid.foundation.axes import AXES, POSE
from crinoid.scenario import ScenarioError, refusal


class Entry(NamedTuple):
    """One number of an observation or an action."""

    name: str
    unit: str
    lower: float
    upper: float


class Observables:
    """Numbers of an observation: names, units and limits, and how they are computed."""

    def __init__(self, plan: AssembledScenario) -> None:
        scenario, system = plan.scenario, plan.system
        inputs, channels = system.inputs, system.base.servo.lower.size
        driven = [row for row, each in enumerate(inputs) if float(each.lower) < each.upper]
        if not driven:
            hint = "Give a channel a range, or add a chamber or a tendon."
            raise refusal("base.channels", f"none of the inputs can move. {hint}")
        moved = scenario.base.moved(scenario.arm.dimension)
        self.axes, self.driven = scenario.arm.dimension, driven
        self.observation = Observation(
            actuators=system.actuators,
            period=array(plan.period),
            axes=self.axes,
            driven=tuple(driven),
            servos=tuple(row for row in driven if row < channels),
            carried=tuple(k for k, each in enumerate(inputs[:channels]) if each.name in moved),
            ahead=plan.target.path is not None,
        )
        """Observation of a controller's input."""
        self.actions = tuple(map(_limited, [inputs[row] for row in driven]))
        """Name, unit and limits of each number of an action."""
        self.entries = tuple(self._entries(plan))  # name, unit and limits of each number

    def _entries(self, plan: AssembledScenario) -> Iterator[Entry]:
        system, axes, chosen = plan.system, self.axes, self.observation
        inputs, servo = system.inputs, system.base.servo
        names = POSE[axes]
        for name in AXES[axes]:
            yield _free(f"error.{name}", "m")
        if axes == 2:
            yield Entry("error.sin_angle", "1", -1.0, 1.0)
            yield Entry("error.cos_angle", "1", -1.0, 1.0)
        else:
            for name in names[axes:]:
                yield _free(f"error.{name}", "1")
        for column, name in enumerate(names):
            yield _free(f"rate.{name}", ("m" if column < axes else "rad" * (axes == 2)) + " s-1")
        for row in chosen.servos:
            each = inputs[row]
            yield Entry(f"{each.name}.position", each.unit, float(each.lower), float(each.upper))
        for row in chosen.servos:
            most = float(servo.max_speed[row])
            yield Entry(f"{inputs[row].name}.speed", f"{inputs[row].unit} s-1", -most, most)
        for column in chosen.carried:
            yield _free(f"{inputs[column].name}.pose", inputs[column].unit)
        for actuator in system.actuators:
            for index, each in enumerate(actuator.inputs):
                limits = -np.inf, np.inf
                if isinstance(actuator, Follower):
                    limits = float(actuator.lower[index]), float(actuator.upper[index])
                yield Entry(f"{each.name}.state", each.unit, *limits)
        for name, unit, lower, upper in self.actions:
            # before the first one a command is 0
            yield Entry(f"{name}.command", unit, min(lower, 0.0), max(upper, 0.0))
        for sensor in plan.sensors[1:]:
            for name, unit in sensor.measurand.names(axes):
                yield _free(f"{sensor.name}.{name}", unit)
        if chosen.ahead:
            for name in AXES[axes]:
                yield _free(f"ahead.{name}", "m")


def named(entries: Iterable[Entry]) -> list[list[str]]:
    """Return name and unit of each of some entries."""
    return [[each.name, each.unit] for each in entries]


def _free(name: str, unit: str) -> Entry:
    return Entry(name, unit.strip(), -np.inf, np.inf)


def _limited(given: Input) -> Entry:
    lower, upper = float(given.lower), float(given.upper)
    if not np.isfinite([lower, upper]).all():
        text = f"got commands from {lower:g} to {upper:g} {given.unit}; must have finite limits"
        raise refusal(given.name, text)
    return Entry(given.name, given.unit, lower, upper)


def write_policy(path: Path, policy: Policy, description: Description) -> None:
    """Write a policy to a file, whole or not at all."""
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        file.write(description.line)
        eqx.tree_serialise_leaves(file, policy)


def read_policy(path: Path) -> tuple[Policy, Description]:
    """Read a policy."""
    try:
        with opened(path) as file:
            description = described(path, file)
            # shapes only: a damaged line may ask for more than the memory
            like = jax.eval_shape(partial(_blank, description))
            policy = eqx.tree_deserialise_leaves(file, like)
            rest = file.read(1)
    except ScenarioError:
        raise
    except Exception:  # Equinox and NumPy raise many kinds for damage
        refuse(path, "is damaged: its numbers do not match its first line")
    if rest or not all(bool(jnp.all(jnp.isfinite(leaf))) for leaf in jax.tree.leaves(policy)):
        refuse(path, "is damaged: it contains more than its numbers, or some that are not finite")
    return policy, description


def _blank(description: Description) -> Policy:
    """Return a policy of zeros with the sizes of a description."""
    entries, driven = len(description.observations), len(description.actions)
    features = entries * (description.averages + 1)
    sizes = [features, *description.layers]
    return Policy(
        centre=jnp.zeros(entries),
        usual=jnp.zeros(features),
        kept=jnp.zeros(description.averages),
        linear=jnp.zeros((driven, features)),
        layers=tuple(
            Dense(jnp.zeros((after, before)), jnp.zeros(after)) for before, after in pairwise(sizes)
        ),
        swing=jnp.zeros(driven),
        fastest=jnp.zeros(driven),
    )


_SAME = 1e-6  # relative difference of two rates that counts as zero


def build_neural(plan: AssembledScenario) -> Neural:
    """Return the neural controller of an assembled scenario."""
    weights = plan.scenario.control.neural.weights
    assert weights is not None, "a scenario without is refused"
    policy, description = read_policy(Path(weights))
    observables = Observables(plan)
    for words, wanted, there in (
        ("observes", description.observations, named(observables.entries)),
        ("commands", description.actions, named(observables.actions)),
    ):
        if wanted != there:
            text = f"{weights}: it {words} {_listed(wanted)}; here there are {_listed(there)}"
            raise refusal(KEY, text)
    here = plan.scenario.control_rate_hz
    if abs(description.rate_hz - here) > _SAME * here:
        text = f"got {here:g}; must be {description.rate_hz:g}, as {weights} was trained"
        raise refusal("control.rate_hz", text)
    return Neural(observables.observation, policy)


def _listed(names: list[list[str]]) -> str:
    return ", ".join(f"{name} ({unit})" for name, unit in names)
