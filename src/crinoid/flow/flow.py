"""The interface of all flows, and the water in which they add up."""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.flow.current import Current
from crinoid.flow.jet import Jet
from crinoid.onset import Onset

Point = Float[Array, " b"]
Time = Float[Array, ""]

# of Gauss and Legendre, on [0, 1]
_NODES, _WEIGHTS = (0.5 * each for each in np.polynomial.legendre.leggauss(64))


def displacement(onset: Onset, path: Callable[[Time], Point], time: Time, panels: int = 1) -> Point:
    """Return the integral (m) of a velocity times its onset, up to a time (s).

    By parts: ``r P - int r' P dt``, with the factor ``r`` of the onset and an antiderivative
    ``P`` of the velocity, which is smoother than the velocity and so easier to integrate.

    Parameters
    ----------
    onset
        Its onset.
    path
        An antiderivative of the velocity (m).
    time
        The time (s).
    panels
        Panels of the quadrature of the ramp (`panels_of`).
    """
    since = jnp.where(time < onset.stop, time, onset.stop) - onset.start
    ramped = onset.ramp_time > 0
    # not `clip`, which has half the slope at its ends
    share = jnp.where(ramped, since / jnp.where(ramped, onset.ramp_time, 1.0), 1.0)
    share = jnp.where(since < 0, 0.0, jnp.where(share < 1, share, 1.0))
    begin = path(onset.start)
    shares = share / panels * jnp.ravel(0.5 + np.arange(panels)[:, None] + _NODES)
    paths = jax.vmap(path)(onset.start + shares * onset.ramp_time) - begin
    weights = share * 0.5 * jnp.pi * jnp.sin(jnp.pi * shares) * np.tile(_WEIGHTS / panels, panels)
    factor = 0.5 - 0.5 * jnp.cos(jnp.pi * share)
    return factor * (path(onset.start + since) - begin) - jnp.sum(weights[:, None] * paths, axis=0)


def panels_of(ramp_time: float, period: float) -> int:
    """Return how many panels resolve a ramp (s) of a velocity with a shortest period (s)."""
    return max(1, int(np.ceil(ramp_time / (10 * period))))


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
        """Whether it is a pattern that the water carries along, which hardly accelerates it."""
        return False

    def displacement(self, time: Time) -> Point | float:
        """Return how far the part that is the same everywhere has moved the water by a time (m).

        `crinoid.flow.Water` carries the patterns that drift by the displacement of the other flows.
        """
        return 0.0

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

    panels: int = eqx.field(static=True, default=1, kw_only=True)
    """Panels of the quadrature of its ramp (``displacement``)."""

    @abstractmethod
    def at(self, time: Time) -> Point:
        """Return the velocity (m/s) at a time (s), its onset aside."""

    def fully_on(self, point: Point, time: Time) -> Point:
        return self.at(time)

    def path(self, time: Time) -> Point:
        """Return an antiderivative of `at` (m).

        Raises
        ------
        NotImplementedError
            If a subclass leaves it out, and another flow drifts.
        """
        name = type(self).__name__
        raise NotImplementedError(f"{name}.path is missing; it must return the integral of `at`")

    def displacement(self, time: Time) -> Point:
        return displacement(self.onset, self.path, time, self.panels)

    def jet(self, point: Point, time: Time) -> Jet:
        moving = jax.jvp(lambda t: self.velocity(point, t), (time,), (jnp.ones_like(time),))
        return Jet.everywhere(*moving)


class Water(eqx.Module):
    """All flows together: velocities add up; the acceleration is that of their sum.

    ``Du/Dt = du/dt + (u . grad) u`` is not the sum of the flows' own accelerations: each flow is
    carried along by the others. A pattern ``v`` that drifts moves with the displacement ``X`` of
    the other flows, as far as these are the same everywhere: ``v(x - X(t), t)``.
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
        velocity = jnp.zeros_like(point)
        for flow in self.flows:
            carried = self._displacement(flow, time) if flow.drifts else 0.0
            velocity += flow.velocity(point - carried, time)
        return velocity

    def current(self, point: Point, time: Time) -> Current:
        """Return velocity, material acceleration and how both change with position, at once."""
        time = jnp.asarray(time if self.frozen_at is None else self.frozen_at, float)
        jets = [self._jet(flow, point, time) for flow in self.flows]
        nothing = Jet.everywhere(jnp.zeros_like(point), jnp.zeros_like(point))
        together = sum(jets, nothing)
        if self.frozen_at is None:
            return Current.of(together)
        lasting = [jet for flow, jet in zip(self.flows, jets, strict=True) if flow.steady]
        return Current.of(together, sum(lasting, nothing))

    def _displacement(self, flow: Flow, time: Time) -> Float[Array, "..."]:
        """Return how far the other flows carry a pattern (m)."""
        others = (other.displacement(time) for other in self.flows if other is not flow)
        return jnp.asarray(sum(others), float)

    def _jet(self, flow: Flow, point: Point, time: Time) -> Jet:
        """Return the jet of a flow where the other flows carry it."""
        if not flow.drifts or len(self.flows) == 1:
            return flow.jet(point, time)
        carried, velocity = jax.jvp(
            lambda t: jnp.zeros(point.shape) + self._displacement(flow, t),
            (time,),
            (jnp.ones_like(time),),
        )
        jet = flow.jet(point - carried, time)
        # d/dt v(x - X, t) = dv/dt - (X' . grad) v
        rate = jet.rate - jnp.sum(jet.gradient * velocity, axis=-1)
        return Jet(jet.velocity, jet.gradient, rate)
