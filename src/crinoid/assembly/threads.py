"""Chambers and tendons: their numbers, their actuator and its element."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from crinoid.actuation import Actuator, Follower, InputKind
from crinoid.assembly.actuators import ActuatorParameters
from crinoid.assembly.arrays import array, from_tables
from crinoid.dynamics import LengthControlledThreads
from crinoid.elements import Bend, Element, Threads
from crinoid.rod import Rod
from crinoid.scenario import Chamber, Scenario, Tendon

UNLIMITED = 1e30  # rate that no step reaches, in any unit
_NONE = -1  # thread of an unused slot


class ThreadParameters(ActuatorParameters):
    """The numbers of all chambers and tendons of an arm, the chambers first.

    Drives are in the unit of their keys: Pa or N, and of a line m3 or m (`crinoid.dynamics.lines`
    says what a line is). Commands and schedules are shares of the largest drive.
    """

    span: Float[Array, "thread 2"]
    offset: Float[Array, "thread 2"]  # at the ends of the span (m); of a chamber that bends only, 1
    angle: Float[Array, "thread 2"]  # at the ends of the span (rad)
    area: Float[Array, " chamber"]  # of the section of a chamber (m2); 0 of one that bends only
    max_pressure: Float[Array, " chamber"]  # pressure at a share of 1 (Pa); 0 of a line
    max_tension: Float[Array, " tendon"]  # tension at a share of 1 (N); 0 of a line
    max_volume: Float[Array, " chamber"]
    """Volume that a share of 1 adds to a line (m3); 0 of others."""
    max_shortening: Float[Array, " tendon"]
    """Length that a share of 1 of a line pulls in (m); 0 of others."""
    constant: Float[Array, " thread"]  # drive to which the schedule and the commands add
    pretension: Float[Array, " thread"]  # tension of a tendon at a share of 0 (N)
    stiffness: Float[Array, " thread"]  # axial stiffness of a line (N), or bulk modulus (Pa)
    max_curvature: Float[Array, " thread"]
    """Curvature at a share of 1 of a chamber that bends only (1/m)."""
    stiffening: Float[Array, " thread"]
    """Share of the arm's bending stiffness that is added over the span at a share of 1."""
    friction: Float[Array, " thread"] | None
    """Coefficient of friction of a tendon in its channel (1), 0 of a chamber; None where no
    tendon of the scenario has friction."""
    min_pressure: Float[Array, " chamber"]  # smallest pressure (Pa); 0 of a line
    lag: Float[Array, " thread"]
    max_rate: Float[Array, " thread"]
    """Greatest rate of the drive, per second; 1e30 if there is none."""
    dead_band: Float[Array, " thread"]
    times: Float[Array, "thread point"]
    shares: Float[Array, "thread point"]
    names: tuple[str, ...] = eqx.field(static=True)
    chambers: int = eqx.field(static=True)  # number of chambers among them
    bends_only: tuple[bool, ...] = eqx.field(static=True)
    slots: tuple[tuple[int, ...], ...] = eqx.field(static=True)
    """Threads at each node, twice the number of each, and one more on the other side of a pair."""
    lined: tuple[tuple[int, int], ...] = eqx.field(static=True)  # thread and side of each line
    pairs: tuple[bool, ...] = eqx.field(static=True)
    pinned: bool = eqx.field(static=True)

    @staticmethod
    def of(scenario: Scenario) -> ThreadParameters | None:
        """Return the numbers of a scenario's threads; None where there are none."""
        threads: list[Chamber | Tendon] = [*scenario.chamber, *scenario.tendon]
        if not threads:
            return None
        times, shares = _schedules(threads)
        chambers, tendons = scenario.chamber, scenario.tendon
        friction = [tendon.friction for tendon in tendons]
        return ThreadParameters(
            **{
                name: array([numbers[name] for numbers in map(_numbers, threads)])
                for name in _numbers(threads[0])
            },
            max_pressure=array([0.0 if each.lined else each.max_pressure for each in chambers]),
            **from_tables(chambers, "area", "min_pressure", "max_volume"),
            **from_tables(tendons, "max_tension", "max_shortening"),
            **from_tables(threads, "pretension", "max_curvature", "stiffening"),
            friction=array([0.0] * len(chambers) + friction) if any(friction) else None,
            times=array(times),
            shares=array(shares),
            names=tuple(scenario.threads),
            chambers=len(chambers),
            bends_only=tuple(getattr(each, "max_curvature", None) is not None for each in threads),
            slots=_slots(threads, scenario.arm.nodes),
            lined=tuple(
                (number, side)
                for number, thread in enumerate(threads)
                if thread.lined
                for side in range(1 + thread.pair)
            ),
            pairs=tuple(thread.pair for thread in threads),
            pinned=scenario.base.mount == "pinned",
        )

    @property
    def _content(self) -> Float[Array, " thread"]:
        return jnp.concatenate([self.max_volume, self.max_shortening])

    @property
    def _largest(self) -> Float[Array, " thread"]:
        """Drive at a share of 1."""
        lined = np.isin(np.arange(len(self.names)), [thread for thread, _ in self.lined])
        loads = jnp.concatenate([self.max_pressure, self.max_tension])
        return jnp.where(lined, self._content, loads)

    @property
    def lower(self) -> Float[Array, " thread"]:
        """Smallest share."""
        least = jnp.concatenate([self.min_pressure, jnp.zeros(len(self.names) - self.chambers)])
        return jnp.where(np.asarray(self.pairs), -1.0, least / self._largest)

    def assemble(self, rod: Rod, first: int) -> tuple[Actuator, tuple[Element, ...]]:
        """Return the actuator of all threads, and the element through which they act."""
        lined = {thread for thread, _ in self.lined}
        kinds: list[InputKind] = [
            "share" if k in lined else "pressure" if k < self.chambers else "tension"
            for k in range(len(self.names))
        ]
        largest = self._largest
        follower = Follower(
            names=self.names,
            kinds=tuple(kinds),
            lower=self.lower,
            upper=jnp.ones(len(kinds)),
            lag=self.lag,
            max_rate=self.max_rate / largest,
            dead_band=self.dead_band,
            times=self.times,
            values=self.shares + (self.constant / largest)[:, None],
        )
        return follower, (self._element(rod, first),)

    def lines(self, rod: Rod, first: int) -> LengthControlledThreads | None:
        """Return the threads of given length or volume, if there are any."""
        if not self.lined:
            return None
        element = self._element(rod, first)
        behind = rod.chord_length
        before = jnp.concatenate([behind[:1], behind[:-1]])
        lengths = jnp.stack([before, behind], axis=1)
        paths = jax.vmap(lambda e, *at: e.path(*at))(element, Bend.of(rod).rest_strain, lengths)
        thread, side = np.array(self.lined).T
        return LengthControlledThreads(
            drives=tuple(int(first + k) for k in thread),
            fluid=tuple(bool(k < self.chambers) for k in thread),
            rest=jnp.sum(paths, axis=0),
            shortening=self._content[thread] * (1 - 2 * side),
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
        toward = rod.EI[:-1].reshape(rod.nodes - 1, 1, -1)
        bending = self.max_curvature[thread] * jnp.sum(toward * offsets**2, axis=-1)
        tension = jnp.where(bends_only, -bending, force[thread])
        lanes = (weight * tension)[..., None] * jnp.eye(len(self.names))[thread]
        paired = np.asarray(self.pairs)[thread][..., None]
        lines = np.array([[2 * number + side] for number, side in self.lined], int).reshape(-1)
        # tension per load of a line: 1 of a tendon, minus the area of a chamber (m2)
        hold = jnp.concatenate([-self.area, jnp.ones(len(self.names) - self.chambers)])
        held = (weight * hold[thread])[..., None] * (slots[..., None] == lines)
        bend = Bend.of(rod, pinned=self.pinned)
        stiffness = bend.stiffness[:, : rod.axes - 1]
        stiffer = (weight * ~other_side.astype(bool) * self.stiffening[thread])[..., None]
        stiffer = jnp.sum(stiffer * jnp.eye(len(self.names))[thread], axis=1)
        stiffening = stiffness[..., None] * stiffer[:, None]
        ends = jnp.full((rod.nodes - 1, 2), 0.5).at[0, 0].set(0.0).at[-1, 1].set(1.0)
        if self.pinned:
            ends = ends.at[1, 0].set(1.0)
        return Threads(
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
            rest_strain=bend.rest_strain[:, : rod.axes - 1],
            share=ends,
            **self._friction(rod, at_share, weight),
        )

    def _friction(
        self,
        rod: Rod,
        offset: Callable[[Float[Array, "count lane"]], Float[Array, "count lane way"]],
        weight: Float[Array, "count lane"],
    ) -> dict[str, Array]:
        """Return what friction adds to the element, from offsets by shares of the spans."""
        if self.friction is None:
            return {}
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


def _numbers(thread: Chamber | Tendon) -> dict[str, Any]:
    """Return the numbers of a thread by their names in `ThreadParameters`."""
    low = high = 1.0
    if thread.offset is not None:
        low, high = np.broadcast_to(thread.offset, 2).tolist()
    angle, wound = math.radians(thread.angle_deg), getattr(thread, "twist_deg", 0.0)
    stiffness = thread.stiffness if isinstance(thread, Tendon) else thread.bulk_modulus
    return {
        "span": thread.span,
        "offset": (low, high),
        "angle": (angle, angle + math.radians(wound)),
        "constant": thread.constant,
        "stiffness": stiffness or 0.0,
        "lag": thread.time_constant,
        "max_rate": UNLIMITED if thread.largest_rate is None else thread.largest_rate,
        "dead_band": thread.dead_band,
    }


def _schedules(
    threads: Sequence[Chamber | Tendon],
) -> tuple[Float[np.ndarray, "thread point"], Float[np.ndarray, "thread point"]]:
    """Return times and shares of all schedules, as long as the longest."""
    given = [thread.schedule for thread in threads]
    count = max([2, *(len(each.time) for each in given if each is not None)])
    rows = []
    for each in given:
        times, shares = ((0.0,), (0.0,)) if each is None else (each.time, each.share)
        more = count - len(times)
        later = times[-1] + np.arange(1, more + 1)
        held = np.append(shares, [shares[-1]] * more)
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
