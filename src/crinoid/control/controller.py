"""The interface of all controllers, and the one that does nothing."""

from abc import abstractmethod
from typing import Any

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

Pose = Float[Array, " pose"]
Channels = Float[Array, " channel"]


class Controller(eqx.Module):
    """Turns what is measured and wanted of the tip into commands for the base's channels.

    Called once per control period; its command is held until the next call.
    """

    @abstractmethod
    def start(self, measured: Pose) -> Any:
        """Return the controller's memory at the start."""

    @abstractmethod
    def command(
        self, memory: Any, measured: Pose, wanted: Pose, forward: Channels
    ) -> tuple[Channels, Any]:
        """Return the commands (m, rad) and the memory for the next call.

        ``forward`` is what is known beforehand of the commands (`crinoid.control.FeedForward`): the
        motion of the target. It is zero where the target stands still or nothing is fed forward.
        Where something is, ``wanted`` is the target at the time that ``measured`` was measured.
        """


class Idle(Controller):
    """Commands nothing: the base stays where it is."""

    channels: int = eqx.field(static=True)

    def start(self, measured: Pose) -> None:
        return None

    def command(
        self, memory: None, measured: Pose, wanted: Pose, forward: Channels
    ) -> tuple[Channels, None]:
        return jnp.zeros(self.channels), None
