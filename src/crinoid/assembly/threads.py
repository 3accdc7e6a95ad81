"""Chambers and tendons: their numbers, their actuator and its element."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Actuator, Follower, InputKind
from crinoid.assembly.arrays import array
from crinoid.assembly.door import build_part, check_actuator, expect
from crinoid.dynamics import LengthControlledThreads
from crinoid.elements import Bend, BendTwist, Element, PlanarThreads, Threads
from crinoid.rod import Rod
from crinoid.scenario import Chamber, Scenario, Tendon


class ActuatorParameters(eqx.Module):
    """The numbers of an actuator: a pytree of arrays (`crinoid.parameters`).

    Examples
    --------
    >>> chambers = crinoid.parameters("reach").actuator[0]
    >>> isinstance(chambers, crinoid.ActuatorParameters)
    True
    >>> (1e6 * chambers.area).round(1).tolist()  # mm2
    [300.0, 200.0]
    """

    def lines(self, rod: Rod, first: int) -> LengthControlledThreads | None:
        """Return which of the threads are lines, if there are any; arguments as of `assemble`."""
        return None

    @abstractmethod
    def assemble(self, rod: Rod, first: int) -> tuple[Actuator, tuple[Element, ...]]:
        """Return the actuator, and the elements through which it acts; traceable.

        Parameters
        ----------
        rod : Rod
            The arm: its reference shape and its sections.
        first : int
            Index at which its drive begins in `crinoid.Motion.drive`.

        Returns
        -------
        tuple of Actuator and tuple of Element
        """


def assemble_actuators(
    parameters: Iterable[ActuatorParameters], rod: Rod
) -> tuple[tuple[Actuator, ...], tuple[Element, ...], LengthControlledThreads | None]:
    """Return the actuators of an arm, all elements through which they act, and the lines."""
    actuators: list[Actuator] = []
    elements: list[Element] = []
    first, lines = 0, None
    for each in parameters:
        lines = lines or expect(each, ActuatorParameters, "actuators").lines(rod, first)
        actuator, through = build_part("actuator", 2, each.assemble, rod, first)
        check_actuator(actuator)
        actuators.append(actuator)
        elements.extend(through)
        first += actuator.drive(actuator.at_rest()).shape[0]
    return tuple(actuators), tuple(elements), lines


_UNLIMITED = 1e12
"""Rate that no step reaches (1/s)."""
_NONE = -1
"""Thread of an unused slot."""


class ThreadParameters(ActuatorParameters):
    """The numbers of all chambers and tendons of an arm, the chambers first."""

    span: Float[Array, "thread 2"]
    offset: Float[Array, "thread 2"]
    """At the ends of the span (m); of a chamber that bends only, 1."""
    angle: Float[Array, "thread 2"]
    """At the ends of the span (rad)."""
    area: Float[Array, " chamber"]
    """Of the section of a chamber (m2); 0 of one that bends only."""
    max_pressure: Float[Array, " chamber"]
    """Pressure at a share of 1 (Pa); 0 of a line (``crinoid.dynamics.threads``)."""
    max_tension: Float[Array, " tendon"]
    """Tension at a share of 1 (N); 0 of a line."""
    pretension: Float[Array, " thread"]
    """Tension of a tendon at a share of 0 (N)."""
    hold: Float[Array, " thread"]
    """Tension per load of a line: 1 of a tendon, minus the area of a chamber (m2); 0 of others."""
    shortening: Float[Array, " thread"]
    """Shortening (m) of a line at a share of 1, or its volume (m3)."""
    stiffness: Float[Array, " thread"]
    """Axial stiffness of a line (N), or bulk modulus (Pa)."""
    max_curvature: Float[Array, " thread"]
    """Curvature at a share of 1 of a chamber that bends only (1/m)."""
    stiffening: Float[Array, " thread"]
    """Share of the arm's bending stiffness that is added over the span at a share of 1."""
    friction: Float[Array, " thread"]
    """Coefficient of friction of a tendon in its channel (1), 0 of a chamber."""
    lower: Float[Array, " thread"]
    lag: Float[Array, " thread"]
    max_rate: Float[Array, " thread"]
    dead_band: Float[Array, " thread"]
    times: Float[Array, "thread point"]
    shares: Float[Array, "thread point"]
    names: tuple[str, ...] = eqx.field(static=True)
    chambers: int = eqx.field(static=True)
    """Number of chambers among them."""
    bends_only: tuple[bool, ...] = eqx.field(static=True)
    slots: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Threads at each node, twice the number of each, and one more on the other side of a pair."""
    lined: tuple[tuple[int, int], ...] = eqx.field(static=True)
    """Thread and side of each line."""
    pinned: bool = eqx.field(static=True)
    rubs: bool = eqx.field(static=True)
    """Whether any of them has friction in the scenario."""

    @staticmethod
    def of(scenario: Scenario) -> ThreadParameters | None:
        """Return the numbers of a scenario's threads; None where there are none."""
        threads: list[Chamber | Tendon] = [*scenario.chamber, *scenario.tendon]
        if not threads:
            return None
        times, shares = _schedules(threads)
        chambers, tendons = scenario.chamber, scenario.tendon
        return ThreadParameters(
            **{
                name: array([numbers[name] for numbers in map(_numbers, threads)])
                for name in _numbers(threads[0])
            },
            area=array([each.area or 0.0 for each in chambers]),
            max_pressure=array([0.0 if each.lined else each.max_pressure for each in chambers]),
            max_tension=array([each.max_tension or 0.0 for each in tendons]),
            times=array(times),
            shares=array(shares),
            names=scenario.thread_names,
            chambers=len(chambers),
            bends_only=tuple(getattr(each, "max_curvature", None) is not None for each in threads),
            slots=_slots(threads, scenario.arm.nodes),
            lined=tuple(
                (number, side)
                for number, thread in enumerate(threads)
                if thread.lined
                for side in range(1 + thread.pair)
            ),
            pinned=scenario.base.mount == "pinned",
            rubs=any(tendon.friction > 0 for tendon in tendons),
        )

    def assemble(self, rod: Rod, first: int) -> tuple[Actuator, tuple[Element, ...]]:
        """Return the actuator of all threads, and the element through which they act."""
        lined = {thread for thread, _ in self.lined}
        kinds: list[InputKind] = [
            "share" if k in lined else "pressure" if k < self.chambers else "tension"
            for k in range(len(self.names))
        ]
        follower = Follower(
            names=self.names,
            kinds=tuple(kinds),
            lower=self.lower,
            upper=jnp.ones(len(kinds)),
            lag=self.lag,
            max_rate=self.max_rate,
            dead_band=self.dead_band,
            times=self.times,
            values=self.shares,
        )
        return follower, (self._element(rod, first),)

    def lines(self, rod: Rod, first: int) -> LengthControlledThreads | None:
        """Return the threads of given length or volume, if there are any."""
        if not self.lined:
            return None
        element = self._element(rod, first)
        bend = (Bend if rod.axes == 2 else BendTwist).of(rod)
        behind = rod.chord_length
        before = jnp.concatenate([behind[:1], behind[:-1]])
        strains = bend.rest_strain.reshape(behind.size, -1)
        paths = jax.vmap(lambda e, *at: e.path(*at))(element, strains, before, behind)
        thread, side = np.array(self.lined).T
        return LengthControlledThreads(
            drives=tuple(int(first + k) for k in thread),
            fluid=tuple(bool(k < self.chambers) for k in thread),
            rest=jnp.sum(paths, axis=0),
            shortening=self.shortening[thread] * (1 - 2 * side),
            stiffness=self.stiffness[thread],
        )

    def _element(self, rod: Rod, first: int) -> Threads:
        """Build the element: a window for each node but the tip, a lane for each slot."""
        slots = np.asarray(self.slots)
        thread, other_side, taken = slots // 2, slots % 2, slots != _NONE
        # the part of the arm that belongs to each node, the last one up to the tip
        at = jnp.linspace(0.0, 1.0, rod.nodes)[:-1, None]
        half = 0.5 / (rod.nodes - 1)
        low, high = jnp.maximum(at - half, 0.0), at + half
        low_span, high_span = (self.span[thread, end] for end in (0, 1))
        covered = jnp.minimum(high, high_span) - jnp.maximum(low, low_span)
        weight = jnp.clip(covered / (high - low), 0.0, 1.0) * taken
        if self.pinned:
            weight = weight.at[0].set(0.0)  # they are fixed to the arm, not to the base

        def offset(where: Float[Array, "count 1"]) -> Float[Array, "count lane way"]:
            return at_share(jnp.clip((where - low_span) / (high_span - low_span), 0.0, 1.0))

        def at_share(along: Float[Array, "count lane"]) -> Float[Array, "count lane way"]:
            ends, angles = self.offset[thread], self.angle[thread]
            away = ends[..., 0] + along * (ends[..., 1] - ends[..., 0])
            angle = angles[..., 0] + along * (angles[..., 1] - angles[..., 0])
            away = away * (1 - 2 * other_side)
            cosine, sine = away * jnp.cos(angle), away * jnp.sin(angle)
            return jnp.stack([cosine, sine][: rod.axes - 1], axis=-1)

        offsets, bends_only = offset(at), np.asarray(self.bends_only)[thread]
        force = jnp.concatenate([-self.area * self.max_pressure, self.max_tension])
        bending = self.max_curvature[thread] * _stiffness(rod, offsets)
        tension = jnp.where(bends_only, -bending, force[thread])
        lanes = (weight * tension)[..., None] * jnp.eye(len(self.names))[thread]
        paired = (self.lower < 0)[thread][..., None]
        lines = np.array([[2 * number + side] for number, side in self.lined], int).reshape(-1)
        held = (weight * self.hold[thread])[..., None] * (slots[..., None] == lines)
        bend = (Bend if rod.axes == 2 else BendTwist).of(rod, pinned=self.pinned)
        stiffness = bend.stiffness.reshape(rod.nodes - 1, -1)[:, : rod.axes - 1]
        stiffer = (weight * ~other_side.astype(bool) * self.stiffening[thread])[..., None]
        stiffer = jnp.sum(stiffer * jnp.eye(len(self.names))[thread], axis=1)
        stiffening = stiffness[..., None] * stiffer[:, None]
        ends = jnp.full((rod.nodes - 1, 2), 0.5).at[0, 0].set(0.0).at[-1, 1].set(1.0)
        if self.pinned:
            ends = ends.at[1, 0].set(1.0)
        return (PlanarThreads if rod.axes == 2 else Threads)(
            first=0,
            at=first,
            pull=jnp.where(other_side[..., None], 0.0, lanes),
            # one that has no other side never goes below 0: it has one slope there, not two
            push_back=jnp.where(other_side[..., None], lanes, jnp.where(paired, 0.0, -lanes)),
            pretension=weight * self.pretension[thread],
            hold=held,
            offset=offsets,
            change=offset(high.at[-1].set(1.0)) - offset(low),
            routed=jnp.where(bends_only, 0.0, 1.0),
            stiffening=stiffening,
            rest_strain=bend.rest_strain.reshape(rod.nodes - 1, -1)[:, : rod.axes - 1],
            share=ends,
            **(self._friction(rod, at_share, weight) if self.rubs else {}),
        )

    def _friction(
        self,
        rod: Rod,
        offset: Callable[[Float[Array, "count lane"]], Float[Array, "count lane way"]],
        weight: Float[Array, "count lane"],
    ) -> dict[str, Array]:
        """Return what friction adds to the element, from offsets by shares of the spans."""
        slots = np.asarray(self.slots)
        thread = slots // 2
        low, high = (self.span[thread, end] for end in (0, 1))
        at = jnp.linspace(0.0, 1.0, rod.nodes)[:-1, None]
        along = (at - low) / (high - low)
        one, across = jnp.ones_like(along), rod.nodes - 1

        def slope(along: Float[Array, "count lane"]) -> Float[Array, "count lane way"]:
            return jax.jvp(offset, (along,), (one,))[1]

        per_span = ((high - low) ** 2 * across * jnp.sum(rod.rest_length))[..., None]
        return {
            "friction": self.friction[thread] * one,
            "winding": jax.jvp(slope, (along,), (one,))[1] / per_span,
            "cover": weight[..., None] * (slots[..., None] == np.unique(slots[slots != _NONE])),
        }


def _stiffness(rod: Rod, offset: Float[Array, "count lane way"]) -> Float[Array, "count lane"]:
    """Return the bending stiffness toward offsets of length 1 (N m2)."""
    stiffness = rod.EI[:-1].reshape(rod.nodes - 1, 1, -1)
    return jnp.sum(stiffness * offset**2, axis=-1)


def _numbers(thread: Chamber | Tendon) -> dict[str, Any]:
    """Return the numbers of a thread by their names in `ThreadParameters`."""
    low = high = 1.0
    if thread.offset is not None:
        low, high = np.broadcast_to(thread.offset, 2).tolist()
    angle, wound = math.radians(thread.angle_deg), 0.0
    lower, curvature = -1.0 if thread.pair else 0.0, 0.0
    if isinstance(thread, Tendon):
        pull, stiffness, wound = 1.0, thread.stiffness, thread.twist_deg
    else:
        pull, stiffness = -(thread.area or 0.0), thread.bulk_modulus
        curvature = thread.max_curvature or 0.0
        if not thread.lined:
            lower = lower or thread.min_pressure / thread.max_pressure
    rate = _UNLIMITED if thread.largest_rate is None else thread.largest_rate / thread.largest
    return {
        "span": thread.span,
        "offset": (low, high),
        "angle": (angle, angle + math.radians(wound)),
        "pretension": thread.pretension if isinstance(thread, Tendon) else 0.0,
        "hold": pull if thread.lined else 0.0,
        "shortening": thread.largest if thread.lined else 0.0,
        "stiffness": stiffness or 0.0,
        "max_curvature": curvature,
        "stiffening": thread.stiffening if isinstance(thread, Chamber) else 0.0,
        "friction": thread.friction if isinstance(thread, Tendon) else 0.0,
        "lower": lower,
        "lag": thread.time_constant,
        "max_rate": rate,
        "dead_band": thread.dead_band,
    }


def _schedules(
    threads: Sequence[Chamber | Tendon],
) -> tuple[Float[np.ndarray, "thread point"], Float[np.ndarray, "thread point"]]:
    """Return times and shares of all schedules, as long as the longest."""
    given = [(thread, thread.schedule) for thread in threads]
    count = max([2, *(len(each.time) for _, each in given if each is not None)])
    rows = []
    for thread, each in given:
        times, shares = ((0.0,), (0.0,)) if each is None else (each.time, each.share)
        more = count - len(times)
        later = times[-1] + np.arange(1, more + 1)
        held = np.append(shares, [shares[-1]] * more) + thread.constant
        rows.append((np.append(times, later), held))
    times, shares = zip(*rows, strict=True)
    return np.array(times), np.array(shares)


def _slots(threads: Sequence[Chamber | Tendon], nodes: int) -> tuple[tuple[int, ...], ...]:
    """Return which threads run past each node but the tip, as long as the longest list."""
    half = 0.5 / (nodes - 1)
    found = []
    for at in np.linspace(0.0, 1.0, nodes)[:-1]:
        here: list[int] = []
        for number, thread in enumerate(threads):
            low, high = thread.span
            if low < at + half and high > at - half:
                here += [2 * number] + [2 * number + 1] * thread.pair
        found.append(here)
    most = max(map(len, found))
    return tuple(tuple(here + [_NONE] * (most - len(here))) for here in found)
