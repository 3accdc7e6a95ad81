"""The one interface between physics and numerics: a force law on a short run of nodes."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

ENERGIES = ("kinetic", "elastic", "potential")
"""Stored energies of the ledger."""
WORKS = ("drag", "damping", "actuation", "loads", "added_mass", "contact")
"""Running works of the ledger: together they equal the change of the stored energies."""


class Motion(eqx.Module):
    """How ``k`` nodes move, and how the water moves where they are. SI units.

    Of all windows of an element together the arrays have a leading axis, ``count``.
    """

    position: Float[Array, "*count k b"]
    velocity: Float[Array, "*count k b"]
    acceleration: Float[Array, "*count k b"]
    flow_velocity: Float[Array, "*count k d"]
    """Velocity of the undisturbed water at the nodes (m/s)."""
    flow_acceleration: Float[Array, "*count k d"]
    """Material acceleration Du/Dt of the undisturbed water at the nodes (m/s2)."""
    time: Float[Array, "*count"]


class Element(eqx.Module):
    """A force law that repeats along the arm.

    Every field that is an array has the windows of ``stencil`` consecutive nodes as its leading
    axis; the methods see one window, without that axis. The sum of the residuals of all elements
    vanishes where the arm moves as it should:
    ``M a + (internal forces) - (forces from outside) = 0``.

    Only ``residual`` matters to the motion: its tangent matrix is taken by forward-mode
    differentiation. The rest keeps the energy ledger.
    """

    stencil: ClassVar[int]
    """How many consecutive nodes one window holds (1 to 3)."""
    external: ClassVar[bool] = False
    """Whether this comes from outside, so that a static solve may bring it on step by step."""
    stored: ClassVar[str] = "potential"
    """Which of `ENERGIES` receives ``energy``."""
    worked: ClassVar[str] = "loads"
    """Which of `WORKS` receives ``power``."""

    first: eqx.AbstractVar[int]
    """The node at which the first window starts; node 0 is the ghost behind the root."""

    @abstractmethod
    def residual(self, motion: Motion) -> Float[Array, "k b"]:
        """Return minus the force on each node of a window (N)."""

    def energy(self, motion: Motion) -> Float[Array, ""]:
        """Return the energy that a window stores (J)."""
        return jnp.zeros(())

    def power(self, motion: Motion) -> Float[Array, ""]:
        """Return the power that a window feeds into the arm beyond what it stores (W)."""
        return -jnp.sum(self.residual(motion) * motion.velocity)
