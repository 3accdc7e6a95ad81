"""Interface of all flows, and the water as their sum."""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.numerics.ramp import Onset


class Jet(eqx.Module):
    """First-order expansion of a velocity field ``u``. Derivatives are the last axes."""

    velocity: Float[Array, " b"]
    """``u`` (m/s)."""
    gradient: Float[Array, "b b"]
    """``grad u`` (1/s)."""
    rate: Float[Array, " b"]
    """``du/dt`` (m/s2)."""

    @staticmethod
    def of(
        field: Callable[[Array, Array], Array], point: Float[Array, " b"], time: Float[Array, ""]
    ) -> "Jet":
        """Differentiate a velocity field at a point (m) and a time (s)."""
        velocity, rate = jax.jvp(lambda t: field(point, t), (time,), (jnp.ones_like(time),))
        return Jet(velocity, jax.jacfwd(field)(point, time), rate)

    @staticmethod
    def everywhere(velocity: Float[Array, " b"], rate: Float[Array, " b"]) -> "Jet":
        """Return the jet of a uniform velocity, from its rate."""
        size = velocity.shape[0]
        return Jet(velocity, jnp.zeros((size, size)), rate)

    def __add__(self, other: "Jet") -> "Jet":
        return jax.tree.map(jnp.add, self, other)

    def times(self, factor: Float[Array, ""], rate: Float[Array, ""]) -> "Jet":
        """Return the jet of the flow times a factor of time with a given rate."""
        return Jet(
            factor * self.velocity,
            factor * self.gradient,
            factor * self.rate + rate * self.velocity,
        )


class Current(eqx.Module):
    """Velocity of the water to first order in the position, and its material acceleration."""

    velocity: Float[Array, " b"]
    """Velocity ``u`` (m/s)."""
    acceleration: Float[Array, " b"]
    """Material acceleration ``Du/Dt`` (m/s2)."""
    velocity_slope: Float[Array, "b b"]
    """Derivative of the velocity along the axes of space, the last index (1/s)."""

    @staticmethod
    def of(jet: Jet, lasting: Jet | None = None) -> "Current":
        """Return the current of the jet of all flows together.

        ``Du/Dt = du/dt + (grad u) u``. With ``lasting``, the jet of the steady flows among them,
        the acceleration is ``(grad u) u`` of these alone.
        """
        advected = jet if lasting is None else lasting
        # a sum of products and not `@`: many small matrices are quicker that way
        acceleration = jnp.sum(advected.gradient * advected.velocity, axis=-1)
        if lasting is None:
            acceleration += jet.rate
        return Current(jet.velocity, acceleration, jet.gradient)


Point = Float[Array, " b"]
Time = Float[Array, ""]

# Gauss-Legendre rule on [0, 1]
_NODES, _WEIGHTS = (0.5 * each for each in np.polynomial.legendre.leggauss(64))


def displacement(onset: Onset, path: Callable[[Time], Point], time: Time, panels: int = 1) -> Point:
    """Return the integral (m) of a velocity times its onset, up to a time (s).

    By parts: ``r P - int r' P dt``, with the factor ``r`` of the onset and an antiderivative
    ``P`` of the velocity, which is smoother than the velocity and easier to integrate.

    ``path`` is that antiderivative (m), ``panels`` the number of panels of the quadrature of the
    ramp (`panels_of`).
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
    """Return the number of panels for a ramp (s) of a velocity with a shortest period (s)."""
    return max(1, int(np.ceil(ramp_time / (10 * period))))


class Flow(eqx.Module):
    """Model of a current: a velocity field that can be differentiated twice.

    Subclasses define ``onset``, ``steady`` and ``fully_on``.

    Examples
    --------
    A current that grows with the height above a bottom at z = -12 m:

    >>> class Layer(crinoid.Flow):
    ...     onset: crinoid.Onset
    ...     rate: jax.Array
    ...     steady = True
    ...
    ...     def fully_on(self, point, time):
    ...         return jnp.stack([self.rate * (point[1] + 12.0), jnp.zeros(())])
    >>> layer = Layer(crinoid.Onset.of(), jnp.array(0.1))
    >>> layer.velocity(jnp.array([0.0, -10.0]), jnp.array(0.0)).round(3).tolist()
    [0.2, 0.0]
    """

    steady: ClassVar[bool]
    """Whether its velocity never changes in time, its onset aside; each class must say so.

    For statics ``(u . grad) u`` of steady flows is a lasting load; other flows have their velocity
    of the moment only.
    """
    onset: eqx.AbstractVar[Onset]
    """Onset in time: a factor on its velocity."""

    def __check_init__(self) -> None:
        if not hasattr(type(self), "steady"):
            text = "must be declared: `steady: ClassVar[bool]`, True if its velocity never changes"
            raise TypeError(f"{type(self).__name__}.steady {text} in time, else False")

    @abstractmethod
    def fully_on(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) without onset at a point of the world (m) and a time (s)."""

    @property
    def drifts(self) -> bool:
        """Whether it is a pattern that drifts with the water."""
        return False

    @property
    def uniform_mean(self) -> Point | None:
        """Its mean velocity (m/s) if that is the same everywhere; surface waves ride on it."""
        return None

    def displacement(self, time: Time) -> Point | float:
        """Return the displacement of the water by the uniform part of the flow up to a time (m).

        `crinoid.flow.Water` moves the patterns that drift by the displacement of the other flows.
        """
        return 0.0

    def fully_on_jet(self, point: Point, time: Time) -> Jet:
        """Return it with its derivatives; a flow may override this with cheaper ones."""
        return Jet.of(self.fully_on, point, time)

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s) at a point (m) and a time (s).

        Parameters
        ----------
        point : array (axis)
            Position in the world (m).
        time : scalar array
            Time (s).

        Returns
        -------
        array (axis)
        """
        return self.onset(time) * self.fully_on(point, time)

    def jet(self, point: Point, time: Time) -> Jet:
        """Return the velocity at a point (m) and a time (s) with its derivatives."""
        return self.fully_on_jet(point, time).times(*self.onset.with_rate(time))


class Everywhere(Flow):
    """Uniform flow: a velocity that depends on time only."""

    panels: int = eqx.field(static=True, default=1, kw_only=True)
    """Panels of the quadrature of its ramp (``displacement``)."""

    @abstractmethod
    def at(self, time: Time) -> Point:
        """Return the velocity (m/s) at a time (s), without its onset."""

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
        velocity, rate = jax.jvp(self.at, (time,), (jnp.ones_like(time),))
        factor, rising = self.onset.with_rate(time)
        return Jet.everywhere(factor * velocity, factor * rate + rising * velocity)


class Water(eqx.Module):
    """Sum of flows: velocities add up; the acceleration is that of the sum.

    ``Du/Dt = du/dt + (u . grad) u`` is not the sum of the flows' accelerations: each flow is
    advected by the others. A pattern ``v`` that drifts moves with the displacement ``X`` of the
    uniform part of the other flows: ``v(x - X(t), t)``.
    """

    flows: tuple[Flow, ...]
    frozen_at: Time | None = None
    """Time (s) at which the flow is frozen, for statics.

    The acceleration is then that of the steady flows alone. A pattern that drifts past the arm
    changes by ``du/dt = -(U . grad) u`` there, which nearly cancels its ``(u . grad) u``: one
    without the other would be a load that never occurs.
    """

    def velocity(self, point: Point, time: Time) -> Point:
        """Return the velocity (m/s)."""
        time = time if self.frozen_at is None else self.frozen_at
        velocity = jnp.zeros_like(point)
        for flow in self.flows:
            displacement = self._displacement(flow, time) if flow.drifts else 0.0
            velocity += flow.velocity(point - displacement, time)
        return velocity

    def current(self, point: Point, time: Time) -> Current:
        """Return velocity, material acceleration and velocity gradient."""
        time = jnp.asarray(time if self.frozen_at is None else self.frozen_at, float)
        jets = [self._jet(flow, point, time) for flow in self.flows]
        nothing = Jet.everywhere(jnp.zeros_like(point), jnp.zeros_like(point))
        together = sum(jets, nothing)
        if self.frozen_at is None:
            return Current.of(together)
        lasting = [jet for flow, jet in zip(self.flows, jets, strict=True) if flow.steady]
        return Current.of(together, sum(lasting, nothing))

    def _displacement(self, flow: Flow, time: Time) -> Float[Array, "..."]:
        """Return the displacement of a pattern by the other flows (m)."""
        others = (other.displacement(time) for other in self.flows if other is not flow)
        return jnp.asarray(sum(others), float)

    def _jet(self, flow: Flow, point: Point, time: Time) -> Jet:
        """Return the jet of a flow that drifts with the others."""
        if not flow.drifts or len(self.flows) == 1:
            return flow.jet(point, time)
        displacement, velocity = jax.jvp(
            lambda t: jnp.zeros(point.shape) + self._displacement(flow, t),
            (time,),
            (jnp.ones_like(time),),
        )
        jet = flow.jet(point - displacement, time)
        # d/dt v(x - X, t) = dv/dt - (X' . grad) v
        rate = jet.rate - jnp.sum(jet.gradient * velocity, axis=-1)
        return Jet(jet.velocity, jet.gradient, rate)
