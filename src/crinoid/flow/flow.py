"""The interface of all flows, and the water in which they add up."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from crinoid.flow.current import Current
from crinoid.flow.jet import Jet
from crinoid.onset import Onset

Point = Float[Array, " b"]
Time = Float[Array, ""]


class Flow(eqx.Module):
    """A model of a current: a velocity field that can be differentiated twice."""

    steady: ClassVar[bool] = False
    """Whether it stays as it is, its onset aside.

    Statics counts ``(u . grad) u`` of steady flows as a load that lasts; of others only the
    velocity of the moment.
    """
    onset: eqx.AbstractVar[Onset]
    """When and how it sets in: a factor on its velocity."""

    @abstractmethod
    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point in the world (m) and a time (s), its onset aside."""

    @property
    def drifts(self) -> bool:
        """Whether it is a pattern that drifts past, which hardly accelerates the water in it."""
        return False

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        """Return it with its derivatives; a flow may override this where it has cheaper ones."""
        return Jet.of(self.fully_on, point, time)

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point (m) and a time (s)."""
        return self.onset(time) * self.fully_on(point, time)

    def jet(self, point: Point, time: Time) -> Jet:
        """Return the velocity at a point (m) and a time (s) with its derivatives."""
        onset = jax.jvp(self.onset, (time,), (jnp.ones_like(time),))
        return self.fully_on_jet(point, time).times(*onset)


class Everywhere(Flow):
    """A flow that is the same everywhere: a velocity of time alone."""

    @abstractmethod
    def at(self, time: Time) -> Point:
        """Return the velocity (m/s) at a time (s), its onset aside."""

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.at(time)

    def jet(self, point: Point, time: Time) -> Jet:
        moving = jax.jvp(lambda t: self.velocity(point, t), (time,), (jnp.ones_like(time),))
        return Jet.everywhere(*moving)


class Water(eqx.Module):
    """All flows together: velocities add up; the acceleration is that of their sum.

    ``Du/Dt = du/dt + (u . grad) u`` is not the sum of the flows' own accelerations: each flow is
    carried along by the others.
    """

    flows: tuple[Flow, ...]
    """The flows that add up."""
    frozen_at: Time | None = None
    """A time (s) at which the flow stands still, for statics.

    The acceleration is then that of the steady flows among themselves. A pattern that is carried
    past the arm changes by ``du/dt = -(U . grad) u`` there, which all but cancels its
    ``(u . grad) u``: to leave out the one and keep the other would be a load that it never has.
    """

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s)."""
        time = time if self.frozen_at is None else self.frozen_at
        return sum((flow.velocity(point, time) for flow in self.flows), jnp.zeros_like(point))

    def current(self, point: Point, time: Time) -> Current:
        """Return velocity, material acceleration and how both change with position, at once."""
        time = jnp.asarray(time if self.frozen_at is None else self.frozen_at, float)
        jets = [flow.jet(point, time) for flow in self.flows]
        nothing = Jet.everywhere(jnp.zeros_like(point), jnp.zeros_like(point))
        together = sum(jets, nothing)
        if self.frozen_at is None:
            return Current.of(together)
        lasting = [jet for flow, jet in zip(self.flows, jets, strict=True) if flow.steady]
        return Current.of(together, sum(lasting, nothing))
