"""A head start for the program of a run that takes longest to compile."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np

from crinoid.assembly.numbers import array
from crinoid.assembly.prepared import Prepared
from crinoid.simulation.loop import Loop
from crinoid.simulation.setup import find_state, is_mapped, loop_about
from crinoid.simulation.stretch import CAPACITY, begun_with, stretch
from crinoid.space import POSE

__all__ = ["compile_ahead"]

_BUILT_ALIKE = ("none", "pid", "neural")
"""Controllers that are the same but for their numbers wherever the arm starts, and soon built."""


def compile_ahead(
    prepared: Prepared,
    capacity: int = CAPACITY,
    altered: Callable[[Loop], Loop] = lambda loop: loop,
) -> None:
    """Begin to compile the stretches of a run, if the search for its start must be compiled too.

    Compiled code depends on no number. So that of the stretches can be had for an arm that stands
    at zero, while the search for where it does stand is compiled, and a run waits less.

    Parameters
    ----------
    prepared
        What is to be run.
    capacity
        Most instants of a stretch.
    altered
        From the loop of the scenario to the one that is run.
    """
    scenario, parts = prepared.scenario, prepared.parts
    own = parts is not None and (parts.controller is not None or parts.sensors)
    if own or scenario.control.kind not in _BUILT_ALIKE:
        return
    prepared.check()
    system, size = prepared.system, len(POSE[scenario.arm.dimension])
    if not find_state.will_compile(system, scenario.simulation.start == "equilibrium"):
        return
    state, jacobian = _zeros(eqx.filter_eval_shape(system.rest)), None
    if is_mapped(scenario):  # by one in which every input moves all of the tip
        jacobian = array(np.random.default_rng(0).normal(size=(size, len(system.inputs))))
    loop, _ = loop_about(prepared, state, array(np.zeros(size)), jacobian, 1.0)
    loop = altered(loop)
    carry, _ = _zeros(eqx.filter_eval_shape(begun_with, loop, state))
    stretch.compile_ahead(loop, carry, carry.steps, carry.steps + 1, capacity)


def _zeros(shapes: Any) -> Any:
    """Return a tree with arrays of zeros where there are shapes."""

    def zeros(leaf: Any) -> Any:
        return np.zeros(leaf.shape, leaf.dtype) if isinstance(leaf, jax.ShapeDtypeStruct) else leaf

    return jax.tree.map(zeros, shapes)
