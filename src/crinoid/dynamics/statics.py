"""Static equilibrium at large deflections, by load steps and pseudo-transient continuation."""

from dataclasses import replace
from operator import itemgetter
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from crinoid.dynamics.acting import ActingForces
from crinoid.dynamics.balance import Balance, implicit_derivative, zero_tangents
from crinoid.dynamics.integrator import StepMap
from crinoid.dynamics.newton import ReusedTangent, Settings, solve
from crinoid.dynamics.outcome import Outcome
from crinoid.dynamics.rows import Rows
from crinoid.dynamics.windows import Surroundings
from crinoid.elements import Motion
from crinoid.foundation.fixed_numbers import (
    FIRST_SHARE,
    KICK,
    LAST_SOLVES,
    LEAVING,
    MAX_SOLVES,
    NEARER,
    NO_MOVEMENT,
    SHIFT_FALL,
    SHIFT_RISE,
    SMALLEST_SHARE,
    TOLERANCE_SHARE,
)
from crinoid.numerics.frames import Frames
from crinoid.rod.reference import Reference


def static_stage(
    time: Array, position: Rows, frames: Frames | None, by_acceleration: Array | float = 0.0
) -> StepMap:
    """Return a stage without velocity whose correction is a displacement."""
    zero, one = jnp.zeros_like(position), jnp.ones(())
    shift = jnp.asarray(by_acceleration, float)
    return StepMap(time, position, zero, zero, one, jnp.zeros(()), shift, frames, ("velocity",))


def static_motion(
    forces: ActingForces, time: Array, position: Rows, frames: Frames | None
) -> Motion:
    """Return the motion of an arm at rest, in the water around it."""
    stage, none = static_stage(time, position, frames), jnp.zeros_like(position)
    return forces.motion(stage, none, forces.surroundings(stage, none))


def careful(forces: ActingForces, settings: Settings) -> Settings:
    """Return the settings of a static solve from those of a time step."""
    found = [each.finest for each in forces.far_contacts]
    found += [] if forces.obstacles is None else [forces.obstacles.finest]
    room = jnp.min(jnp.stack(found)) / 2 if found else None
    tolerance = TOLERANCE_SHARE * settings.tolerance
    return replace(settings, tolerance=tolerance, max_turn=jnp.asarray(0.5), max_move=room)


def find(
    reference: Reference,
    forces: ActingForces,
    settings: Settings,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
    *,
    follows: bool = False,
) -> tuple[Rows, Frames | None, Outcome]:
    """Find a stable `equilibrium` of an arm, with ``settings`` of a time step.

    One that ``follows`` is next to the start, an equilibrium of loads that hardly differ.
    """
    # stiffness and loads over mass: the squared rates at which an arm leaves an unstable shape lie
    # between the softer bending stiffness and the sum of both
    mass, length = forces.mass, reference.length
    bending = forces.bending_stiffness(reference) / (mass * length**3)
    rates = Rates(
        1e-3 * jnp.min(bending), 1e3 * jnp.max(bending), 1e3 * reference.nodes / (mass * length)
    )
    judged = careful(forces, settings)
    return equilibrium(forces, time, start, frames, judged, rates, jnp.asarray(follows))


class Rates(NamedTuple):
    """Squared rates at which an arm can leave an equilibrium, by stiffness and loads over mass."""

    slowest: Float[Array, ""]  # 1/s2
    stiffest: Float[Array, ""]
    """Without loads (1/s2)."""
    by_load: Float[Array, ""]
    """In addition, per largest force of the loads (1/(N s2))."""


class _Shape(eqx.Module):
    position: Rows
    frames: Frames | None


class _Continuation(eqx.Module):
    shape: _Shape
    first_loaded: _Shape
    """Shape that first bore the whole load."""
    bore_load: Bool[Array, ""]
    """Whether a shape bore the whole load."""
    load_factor: Float[Array, ""]
    share: Float[Array, ""]
    """Share of the loads to apply next."""
    loaded: Bool[Array, ""]
    """Whether the whole load is applied."""
    shift: Float[Array, ""]
    """Viscosity of the medium, times the mass (1/s2); negative while the loads are unknown."""
    moved: Float[Array, ""]
    """Displacement of the last solve with this shift (m); negative before the first."""
    settled: Bool[Array, ""]
    """Whether the arm has come to rest, or has given up: solves are without a medium."""
    solves: Int[Array, ""]
    iterations: Int[Array, ""]


@eqx.filter_custom_jvp
def equilibrium(
    forces: ActingForces,
    time: Float[Array, ""],
    start: Rows,
    frames: Frames | None,
    settings: Settings,
    rates: Rates,
    follows: Bool[Array, ""],
) -> tuple[Rows, Frames | None, Outcome]:
    """Find a stable equilibrium of the forces at ``time``.

    First the external forces are applied in shares, halved where Newton's method fails and doubled
    where it succeeds. Then the arm is pushed aside by a thousandth of its length and released in a
    very viscous medium (implicit Euler steps of ``s M dq/ds = -residual``, pseudo-transient
    continuation, Kelley and Keyes 1998). The viscosity ``s`` is halved from step to step while the
    arm comes to rest, and constant while two steps show it accelerating: it returns to a stable
    equilibrium, leaves an unstable one (a column past its buckling load), and passes a limit point
    where load shares fail. Follower loads may admit no stable equilibrium; if the arm still moves
    after all solves, the result is the shape that first bore the whole load.

    Each solve expands the water to first order at the arm. A solve that moves the arm to other
    water is accepted only if the imbalance there is smaller than before; otherwise the arm could
    wander from eddy to eddy forever.

    Where the arm ``follows`` changing loads, it bears them all from the beginning: from ``start``
    it creeps through the viscous medium to the equilibrium that it reaches there.

    Returns the positions (m; the first two as in ``start``, and those of the obstacles), in space
    the frames there, and the outcome: the balance in the water there, with all iterations counted.
    Positions and spins are differentiable as the solution of the balance.
    """
    tip = forces.nodes(start).shape[0] - 1
    along = jnp.linspace(0.0, 1.0, tip - 1)[1:, None]
    edges = jnp.diff(start[1 : tip + 1, : forces.axes], axis=0)
    reach = jnp.sum(jnp.sqrt(jnp.sum(edges**2, axis=1)))
    none = jnp.zeros_like(start)
    no_tangent = ReusedTangent.none(forces, start)
    no_water = Surroundings.none(start.shape[0], forces.axes)

    def kick(position: Rows) -> Rows:
        chord = position[tip] - position[1]
        aside = KICK * reach * along**2 * _aside(chord, reach, forces.axes)
        return jnp.pad(aside, ((3, position.shape[0] - tip - 1), (0, 0)))

    def allowed(search: _Continuation) -> Int[Array, ""]:
        return jnp.where(search.bore_load, MAX_SOLVES + LAST_SOLVES, MAX_SOLVES)

    def unfinished(carry: tuple[_Continuation, Outcome]) -> Bool[Array, ""]:
        search, outcome = carry
        return ~outcome.converged & (search.solves <= allowed(search))

    def advance(carry: tuple[_Continuation, Outcome]) -> tuple[_Continuation, Outcome]:
        search, _ = carry
        shape = search.shape
        # after the last solve the tolerance is that of a time step
        last = search.solves == allowed(search)
        judged = replace(
            settings,
            tolerance=jnp.where(last, 1 / TOLERANCE_SHARE, 1.0) * settings.tolerance,
            max_iterations=jnp.where(last, 0, settings.max_iterations),
        )
        load_factor = jnp.minimum(1.0, search.load_factor + search.share)
        load_factor = jnp.where(search.loaded | last, 1.0, load_factor)
        bare = last | search.settled | ~search.loaded

        def attempt(
            trial: tuple[Rows, Surroundings, Array, Rows], solves: Bool[Array, ""]
        ) -> tuple[tuple[Rows, Surroundings, Array, Rows], Outcome]:
            # a solve is most of the program, so it is traced once; without iterations it
            # evaluates the residual
            correction, around, shift, floor = trial
            medium = jnp.where(bare, 0.0, shift)
            stage = static_stage(time, shape.position, shape.frames, medium)
            around = jax.lax.cond(
                solves, lambda: around, lambda: forces.surroundings(stage, correction)
            )
            most = jnp.where(solves, judged.max_iterations, 0)
            correction, _, outcome, reused = solve(
                Balance(forces, around, stage, load_factor),
                correction,
                replace(judged, max_iterations=most),
                replace(no_tangent, floor=floor),
            )
            fastest = rates.stiffest + rates.by_load * outcome.scale / load_factor
            shift = jnp.where(shift < 0, fastest, shift)
            return (correction, around, shift, reused.floor), outcome

        # the residual of the shape, a solve, and the residual in the water at the new shape
        (correction, _, known_shift, _), outcomes = jax.lax.scan(
            attempt, (none, no_water, search.shift, none), jnp.array([False, True, False])
        )
        before, solved, outcome = (jax.tree.map(itemgetter(k), outcomes) for k in range(3))
        nearer = outcome.residual <= NEARER * before.residual
        good = solved.converged & (outcome.converged | nearer)
        position = shape.position + correction
        frames = shape.frames
        if frames is not None:
            nodes = forces.nodes(position)
            frames = Frames.of(nodes, frames.at(nodes))
        shape = _choose(good, _Shape(position, frames), shape)

        share = jnp.where(good, 2.0, 0.5) * search.share
        bears_load = good & (load_factor >= 1.0)
        loaded = search.loaded | bears_load | (share < SMALLEST_SHARE)
        just_loaded = loaded & ~search.loaded
        first_loaded = _choose(search.loaded, search.first_loaded, shape)

        moved = jnp.max(jnp.abs(correction[:, : forces.axes]))
        leaving = (moved > LEAVING * search.moved) & (moved > NO_MOVEMENT * reach)
        repeats = good & ((search.moved < 0) | leaving)
        fall = jnp.where(repeats, 1.0, jnp.where(good, SHIFT_FALL, SHIFT_RISE))
        shift = jnp.where(search.loaded, fall * known_shift, known_shift)

        # still moving after the allowed solves: give up, and return to the shape that first bore
        # the whole load
        wandering = good & (moved > KICK * reach) & ~search.settled
        gives_up = search.bore_load & wandering & (search.solves >= MAX_SOLVES)
        # the frames are those before the kick, which is small
        kicked = shape.position + jnp.where(just_loaded, kick(shape.position), 0.0)
        shape = _choose(gives_up, first_loaded, _Shape(kicked, shape.frames))
        iterations = search.iterations + solved.iterations
        return _Continuation(
            shape=shape,
            first_loaded=first_loaded,
            bore_load=search.bore_load | (just_loaded & bears_load),
            load_factor=jnp.where(good, load_factor, search.load_factor),
            share=share,
            loaded=loaded,
            shift=jnp.where(gives_up, 0.0, shift),
            moved=jnp.where(search.loaded & repeats, moved, -1.0),
            settled=gives_up | (search.loaded & good & (shift < rates.slowest)),
            solves=search.solves + 1,
            iterations=iterations,
        ), replace(
            outcome,
            # only a balance without a medium decides, in the water where the arm is
            converged=solved.converged & outcome.converged & (search.settled | last),
            iterations=iterations,
        )

    shape = _Shape(start + jnp.where(follows, kick(start), 0.0), frames)
    no, nothing, zero = jnp.asarray(False), jnp.asarray(0), jnp.zeros(())
    search, outcome = jax.lax.while_loop(
        unfinished,
        advance,
        (
            _Continuation(
                shape=shape,
                first_loaded=shape,
                bore_load=no,
                load_factor=jnp.where(follows, 1.0, 0.0),
                share=zero + FIRST_SHARE,
                loaded=follows,
                shift=zero - 1,
                moved=zero - 1,
                settled=no,
                solves=nothing,
                iterations=nothing,
            ),
            Outcome.of_nothing(converged=False),
        ),
    )
    return search.shape.position, search.shape.frames, outcome


@equilibrium.def_jvp
def _equilibrium_jvp(primals: Any, tangents: Any) -> Any:
    forces, time, start, *_ = primals
    t_forces, t_time, t_start, *_ = tangents
    position, frames, outcome = equilibrium(*primals)
    held = jnp.zeros_like(start) if t_start is None else t_start

    def begin(forces: ActingForces, time: Array, position: Rows) -> tuple[StepMap, Surroundings]:
        stage = static_stage(time, position, frames)
        return stage, forces.surroundings(stage, jnp.zeros_like(start))

    (stage, around), (t_stage, t_around) = eqx.filter_jvp(
        begin, (forces, time, position), (t_forces, t_time, held)
    )
    balance = Balance(forces, around, stage, jnp.ones(()))
    t_balance = Balance(t_forces, t_around, t_stage)
    none = jnp.zeros_like(start)
    tangent = balance.tangent(balance.motion(none))
    correction, _ = implicit_derivative(balance, t_balance, none, tangent)
    t_frames = jax.tree.map(jnp.zeros_like, frames)
    return (position, frames, outcome), (correction + held, t_frames, zero_tangents(outcome))


def _choose(first: Bool[Array, ""], one: Any, other: Any) -> Any:
    return jax.tree.map(lambda a, b: jnp.where(first, a, b), one, other)


def _aside(chord: Float[Array, " b"], reach: Float[Array, ""], axes: int) -> Float[Array, " b"]:
    """Return a direction across a chord: upward in the plane, in space with a small part of y.

    So the arm leaves a plane in which it is unstable, and buckles to the same side as a planar arm.
    The chord of a closed arm counts as forward.
    """
    up = axes - 1
    length = jnp.sqrt(jnp.sum(chord[:axes] ** 2))
    closed = length < 1e-6 * reach
    unit = np.eye(chord.size)
    chord = jnp.where(closed, unit[0], chord / jnp.where(closed, 1.0, length))
    across = chord[0] * unit[up] - chord[up] * unit[0]
    if axes == 3:
        aside = unit[1] - chord[1] * chord * (np.arange(chord.size) < axes)
        across += 0.3 * aside + chord[1] ** 8 * unit[0]
    return across / jnp.sqrt(jnp.sum(across**2))
