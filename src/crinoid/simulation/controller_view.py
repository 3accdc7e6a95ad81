"""What a program in the loop sees: of the inputs only those that can move."""

from dataclasses import replace

import numpy as np
from jaxtyping import Array, Int

from crinoid.compilation import OFTEN, compiled
from crinoid.control.controller import ControllerInput
from crinoid.simulation.loop import Loop, LoopState

_OF_INPUTS = ("feedforward", "command", "lower", "upper")
"""Fields of what a controller sees that have a number for each input."""


@compiled(**OFTEN)
def see(
    loop: Loop, state: LoopState, rows: Int[Array | np.ndarray, " input"]
) -> tuple[ControllerInput, Int[Array, ""], Int[Array, ""]]:
    """Return what a controller of some inputs sees, and the time steps of two commands.

    These are the present one and the next.
    """
    seen = loop.seen(state.state, loop.sensed(state), state.command)
    seen = replace(seen, **{name: getattr(seen, name)[rows] for name in _OF_INPUTS})
    return seen, loop.command_step(state.ticks), loop.command_step(state.ticks + 1)
