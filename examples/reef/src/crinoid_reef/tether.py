"""A load: a spring from the tip to a fixed point."""

from typing import Annotated, ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from pydantic import Field

from crinoid import Element, Motion, Onset, load_onset
from crinoid.tables import LoadTable, Position, Quantity


class Tether(Element):
    """A spring without a rest length: force ``-stiffness (q - anchor)`` on the tip."""

    stencil: ClassVar[int] = 1
    external: ClassVar[bool] = True
    worked: ClassVar[str] = "loads"
    first: int = eqx.field(static=True)
    stiffness: Float[Array, "*count"]
    """Spring stiffness (N/m)."""
    anchor: Float[Array, "*count d"]
    """Where the spring is fixed, in the coordinates of the arm (m)."""
    onset: Onset

    @staticmethod
    def of(rod, *, stiffness, anchor, onset):
        """Build the tether of a rod's tip."""
        together = Onset.of(onset.start, onset.ramp_time, onset.stop, shape=(1,))
        return Tether(rod.nodes, stiffness[None], anchor[None], together)

    def residual(self, motion: Motion) -> Float[Array, "1 d"]:
        return self.onset(motion.time) * self.stiffness * (motion.position - self.anchor)


class TetherLoad(LoadTable):
    """A spring from the tip to a fixed point."""

    kind: Literal["tether"] = Field(default="tether", description="A spring on the tip.")
    anchor: Position = Field(description="Where the spring is fixed.")
    stiffness: Annotated[float, Quantity("N/m")] = Field(gt=0, description="Stiffness.")

    def build(self, scenario):
        anchor = np.subtract(self.anchor, scenario.base.position)
        return Tether.of, {
            "stiffness": jnp.asarray(self.stiffness),
            "anchor": jnp.asarray(anchor),
            "onset": load_onset(self),
        }
