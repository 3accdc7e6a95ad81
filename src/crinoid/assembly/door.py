"""Checks of parts: each is checked once, where it is built or traced, never at run time."""

import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from crinoid.actuation import Actuator, Input
from crinoid.control import Controller, ControllerInput, Estimate, Sensor
from crinoid.dynamics import State, System
from crinoid.dynamics.resting import undeformed
from crinoid.dynamics.statics import static_motion
from crinoid.dynamics.windows import count, motion_windows
from crinoid.elements import Element
from crinoid.elements.element import ENERGIES, WORKS
from crinoid.flow import Flow
from crinoid.flow.flow import Jet
from crinoid.foundation.axes import POSE
from crinoid.scenario import ScenarioError, refusal
from crinoid.scenario.kinds import is_own

_LIBRARIES = {"crinoid", "jax", "jaxlib", "equinox", "jaxtyping", "beartype", "numpy"}


def part_name(part: object, place: str) -> str:
    """Return the name of a part: module, class or function, and its place in the scenario."""
    named: Any = part if hasattr(part, "__qualname__") else type(part)
    return f"{named.__module__}:{named.__qualname__} ({place})"


def expect(part: Any, base: type, name: str) -> Any:
    """Return a part of a class; raise `ScenarioError` under its name if its class is another."""
    require(isinstance(part, base), name, f"got {type(part).__name__}; must be of {base.__name__}")
    return part


def require(condition: object, name: str, text: str) -> None:
    """Refuse a part unless a condition is met."""
    if not condition:
        raise refusal(name, text)


def build_part(
    place: str, base: type | int, build: Callable[..., Any], /, *given: Any, **more: Any
) -> Any:
    """Build a part of a class, or a tuple of so many; an error inside is one line."""
    name = part_name(build, place)
    part = _call(name, build, *given, **more)
    if isinstance(base, type):
        return expect(part, base, name)
    fits = isinstance(part, tuple) and len(part) == base
    require(fits, name, f"returned {type(part).__name__}; must return {base} values")
    return part


def check_flow(flow: Flow, place: str, axes: int) -> None:
    """Refuse a flow that gives no velocity along each axis."""
    if is_own(expect(flow, Flow, place)):
        return
    name, point, time = part_name(flow, place), _shape(axes), _shape()
    _trace(name, flow, "fully_on", (point, time), point)
    _trace(name, flow, "jet", (point, time), jax.eval_shape(Jet.everywhere, point, point))


def check_element(element: Element, place: str, system: System) -> None:
    """Refuse an element that does not fit the arm, or gives no force on each node of a window."""
    name = part_name(expect(element, Element, place), place)
    first = {np.shape(leaf)[:1] for leaf in jax.tree.leaves(element)}
    text = f"got first axes {first}; must be one alike. Fields without windows are static."
    require(len(first) == 1 and () not in first, name, text)
    last, most = element.first + count(element) - 1 + element.stencil, system.reference.nodes
    text = f"got {count(element)} windows of {element.stencil} nodes from node {element.first} on"
    text += f"; must be within nodes 0, the ghost, to {most}"
    require(element.first >= 0 and last <= most + 1, name, text)
    if is_own(element):
        return
    for key, known in (("worked", WORKS), ("stored", ENERGIES)):
        given = getattr(element, key)
        require(given in known, f"{name} {key}", f"got {given!r}; must be one of {known}")
    windows = eqx.filter_eval_shape(
        lambda: motion_windows(element, static_motion(*undeformed(system, jnp.zeros(()))))
    )
    motion = jax.tree.map(lambda leaf: _shape(*leaf.shape[1:]), windows)
    window = jax.tree.map(lambda leaf: leaf[0], element)
    memory = _trace(name, window, "steady", (motion,), hint=" or None")
    if memory is not None:
        at = (lambda m: (m.memory, m.step), motion, (memory, _shape()))
        motion = eqx.tree_at(*at, is_leaf=lambda x: x is None)
        _trace(name, window, "advance", (motion,), memory)
    _trace(name, window, "residual", (motion,), motion.position)
    _trace(name, window, "energy", (motion,), _shape())
    _trace(name, window, "working", (motion,), motion.position, None)


def check_actuator(actuator: Actuator) -> None:
    """Refuse an actuator whose state changes its form, or that has no drive for each input."""
    if is_own(expect(actuator, Actuator, "actuator")):
        return
    name = part_name(actuator, "actuator")
    command = _shape(_call(f"{name} inputs", lambda: len(actuator.inputs)))
    state = _trace(name, actuator, "at_rest", ())
    _trace(name, actuator, "advance", (state, command, _shape()), state)
    _trace(name, actuator, "drive", (state,), command)


def check_sensor(sensor: Sensor, place: str, system: System, state: State) -> None:
    """Refuse a sensor that does not give a value for each of its names."""
    if is_own(measurand := expect(sensor, Sensor, place).measurand):
        return
    name, axes = part_name(measurand, f"sensor {sensor.name}"), system.forces.axes
    names = _call(f"{name} names", lambda: [(one, unit) for one, unit in measurand.names(axes)])
    _trace(name, measurand, "of", (system, state), _shape(len(names)))


def check_controller(
    controller: Controller, seen: ControllerInput, inputs: Sequence[Input], nodes: int
) -> None:
    """Refuse a controller that gives no command for each input, or changes its memory's form.

    Likewise one whose estimate does not fit the tip or the nodes of the arm.
    """
    if is_own(controller):
        return
    name, every = part_name(controller, "controller"), ", ".join(one.name for one in inputs)
    memory = _trace(name, controller, "start", (seen,))
    form, hint = (_shape(len(inputs)), memory), f", with a command for each of {every}"
    _trace(name, controller, "command", (memory, seen), form, hint=hint)
    found = _trace(name, controller, "estimate", (memory,))
    if found is None:
        return
    name = f"{name} estimate"
    axes = next(n for n, pose in POSE.items() if len(pose) == seen.measured.size)
    text = f"returned {type(found).__name__}; must return a crinoid.control.Estimate or None"
    require(isinstance(found, Estimate), name, text)
    shapes = {"tip": seen.measured.shape, "position": (nodes, axes), "flow_velocity": (axes,)}
    for part, shape in shapes.items():
        if (each := getattr(found, part)) is not None:
            forms = [list(each.value.shape), list(each.std.shape)]
            text = f"returned {part} with value and std of shapes {forms}; must be {list(shape)}"
            require(forms == [list(shape)] * 2, name, text)


def _shape(*shape: int) -> jax.ShapeDtypeStruct:
    return jax.ShapeDtypeStruct(shape, float)


def _trace(
    name: str, part: object, method: str, given: tuple[Any, ...], *forms: Any, hint: str = ""
) -> Any:
    """Trace a method of a part; return the form of its result, or refuse all but the given ones."""
    name = f"{name} {method}"
    got = _call(name, eqx.filter_eval_shape, getattr(part, method), *given)
    known = [_form_text(form) for form in forms]
    fits = all(hasattr(leaf, "dtype") for leaf in jax.tree.leaves(got))
    fits = _form_text(got) in known if known else fits
    require(fits, name, f"returned {_form_text(got)}; must return {[*known, 'arrays'][0]}{hint}")
    return got


def _form_text(tree: Any) -> str:
    def leaf(one: Any) -> str:
        return f"{one.dtype}{list(one.shape)}" if hasattr(one, "dtype") else type(one).__name__

    return " ".join(str(jax.tree.map(leaf, tree)).replace("'", "").split())


def _call(name: str, function: Callable[..., Any], /, *given: Any, **more: Any) -> Any:
    """Call a function of a user, whose errors become one line."""
    try:
        return function(*given, **more)
    except ScenarioError:
        raise
    except Exception as error:  # any mistake of the part
        raise refusal(name, _cause(error)) from error


def _cause(error: Exception) -> str:
    at = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        if frame.f_globals.get("__name__", "").partition(".")[0] not in _LIBRARIES:
            at = f" ({Path(frame.f_code.co_filename).name}, line {line})"
    leaked = isinstance(error, jax.errors.UnexpectedTracerError)
    if isinstance(error, jax.errors.JAXTypeError | jax.errors.JAXIndexError) and not leaked:
        hint = "jnp.where in place of if, and jax.numpy in place of numpy."
        hint += " A number that chooses a node or a size is bound by functools.partial."
        return f"got a traced array where Python needs its value{at}; must use {hint}"
    return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}{at}"
